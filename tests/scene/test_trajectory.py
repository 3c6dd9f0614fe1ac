"""Computed poses are rigid, follow the axis conventions, and have the configured speeds and rotations."""

import numpy as np
import pytest

from radartwin.errors import PoseError
from radartwin.scene.trajectories import trajectory


def assert_rigid(poses):
    rotation = poses[..., :3, :3]
    assert poses.dtype == np.float64
    assert np.allclose(rotation @ np.swapaxes(rotation, -1, -2), np.eye(3))
    assert np.allclose(np.linalg.det(rotation), 1)
    assert np.array_equal(poses[..., 3, :], np.broadcast_to([0, 0, 0, 1], poses[..., 3, :].shape))


@pytest.mark.parametrize("target", [[3, 0, 1], [0, 5, 1], [-2, -2, 0], [1, 2, 40.0]])
def test_look_at_points_the_boresight_and_stays_level(target):
    position = np.array([0.5, 0.25, 1.0])
    pose = trajectory.look_at(position, target)
    assert_rigid(pose)
    assert np.allclose(pose[:3, 3], position)
    forward = (np.array(target) - position) / np.linalg.norm(target - position)
    assert np.allclose(pose[:3, 0], forward)
    assert pose[2, 1] == pytest.approx(0, abs=1e-12)
    assert pose[2, 2] > 0


def test_look_at_works_straight_up_and_refuses_no_direction():
    assert_rigid(trajectory.look_at([0, 0, 0], [0, 0, 2]))
    with pytest.raises(PoseError):
        trajectory.look_at([1, 1, 1], [1, 1, 1])


def test_turntable_completes_a_revolution_in_its_period_about_its_position():
    poses = trajectory.turntable([2.0, 0.0, 0.9], 251, 10.0, 25.0, start_rad=np.pi)
    assert_rigid(poses)
    assert np.allclose(poses[:, :3, 3], [2.0, 0.0, 0.9])
    assert np.allclose(poses[0], poses[250])
    assert np.allclose(poses[0, :3, 0], [-1, 0, 0])
    quarter = trajectory.turntable([0, 0, 0], 2, 1.0, 4.0)[1]
    assert np.allclose(quarter @ [1, 0, 0, 1], [0, 1, 0, 1])  # counter-clockwise from above


def test_sweeps_have_about_50_frames_at_the_stated_speed():
    start = trajectory.look_at([1, 0, 0.4], [1, 3, 0.4])
    depth = trajectory.depth_sweep(start)
    lateral = trajectory.lateral_sweep(start)
    for poses, speed, axis in ((depth, 0.2, start[:3, 0]), (lateral, 0.24, start[:3, 1])):
        assert poses.shape == (50, 4, 4)
        assert_rigid(poses)
        velocity = np.diff(poses[:, :3, 3], axis=0) * 10.0
        assert np.allclose(velocity, speed * axis)
    assert np.allclose(depth[0], start)
    assert np.allclose(lateral[:, :3, 3].mean(axis=0), start[:3, 3])


def test_rail_keeps_orientation_and_spans_its_length():
    start = trajectory.look_at([0, 0, 1], [1, 1, 1])
    poses = trajectory.rail(start, [1, 1, 0], 0.6, 31)
    assert np.allclose(poses[:, :3, :3], start[:3, :3])
    assert np.allclose(poses[-1, :3, 3] - poses[0, :3, 3], 0.6 * np.array([1, 1, 0]) / np.sqrt(2))


@pytest.mark.parametrize("frames", [0, -1, 1.5])
def test_zero_frames_are_refused(frames):
    with pytest.raises(PoseError, match="frames"):
        trajectory.static(np.eye(4), frames)
