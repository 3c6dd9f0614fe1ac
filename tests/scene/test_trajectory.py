"""Computed poses are rigid, follow the axis conventions and have the configured speeds. Files are read with their formats and axes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from radartwin.scene.trajectories import trajectory
from radartwin.scene.trajectories.file import read_track
from radartwin.scene.trajectories.track import OPTICAL, Track
from radartwin.scene.trajectories.trajectory import look_at, pose


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


def test_turntable_completes_a_revolution_in_its_period_about_its_position():
    poses = trajectory.turntable([2.0, 0.0, 0.9], 251, 10.0, 25.0, start_rad=np.pi)
    assert_rigid(poses)
    assert np.allclose(poses[:, :3, 3], [2.0, 0.0, 0.9])
    assert np.allclose(poses[0], poses[250])
    assert np.allclose(poses[0, :3, 0], [-1, 0, 0])
    quarter = trajectory.turntable([0, 0, 0], 2, 1.0, 4.0)[1]
    assert np.allclose(quarter @ [1, 0, 0, 1], [0, 1, 0, 1])  # counter-clockwise from above


def test_sweeps_and_rails_have_the_stated_speed_and_length():
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
    assert_rigid(trajectory.look_at([0, 0, 0], [0, 0, 2]))  # straight up
    rail = trajectory.rail(start, [1, 1, 0], 0.6, 31)
    assert np.allclose(rail[:, :3, :3], start[:3, :3])
    assert np.allclose(rail[-1, :3, 3] - rail[0, :3, 3], 0.6 * np.array([1, 1, 0]) / np.sqrt(2))


TUM = "# t x y z qx qy qz qw\n0.0 0 0 0.4 0 0 0 1\n0.5 0.1 0 0.4 0 0 0.3826834 0.9238795\n1.0 0.2 0 0.4 0 0 0.7071068 0.7071068\n"


def test_tum_is_read_with_comments_and_interpolated(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text(TUM)
    track = read_track(path)
    assert track.times_s.tolist() == [0, 0.5, 1]
    assert np.allclose(track.poses[2, :3, 3], [0.2, 0, 0.4])
    assert np.allclose(track.poses[2, :3, 0], [0, 1, 0], atol=1e-6)  # turned left by 90 degrees: forward is now +y
    poses = track.frames(10.0)
    assert np.allclose(poses[:, 0, 3], 0.02 * np.arange(11))
    assert np.allclose(np.degrees(np.arctan2(poses[:, 1, 0], poses[:, 0, 0])), 9 * np.arange(11), atol=1e-4)  # along the shortest arc


def test_csv_columns_are_found_by_name_in_any_order(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("tz,ty,tx,Timestamp,qw,qz,qy,qx,comment_id\n0.4,0,0,10,1,0,0,0,7\n0.4,0,0.2,11,1,0,0,0,8\n")
    track = read_track(path)
    assert track.times_s.tolist() == [10, 11]
    assert np.allclose(track.poses[1, :3, 3], [0.2, 0, 0.4])
    path.write_text("t,x,y,z,yaw_deg\n0,0,0,0.4,90\n1,0,0.1,0.4,90\n")
    assert np.allclose(read_track(path).poses[0, :3, 0], [0, 1, 0])


def test_camera_axes_are_converted_and_a_mounted_sensor_moves_with_its_body():
    want = look_at([1, 2, 0.4], [3, 5, 0.4])
    camera = want.copy()
    camera[:3, :3] = np.stack([-want[:3, 1], -want[:3, 2], want[:3, 0]], axis=1)  # x right, y down, z forward
    track = Track(np.array([0.0, 1.0]), np.stack([camera, camera]))
    assert np.allclose(track.from_axes("optical").poses[0], want)
    assert np.allclose(OPTICAL @ OPTICAL.T, np.eye(3))
    body = np.stack([np.eye(4), pose([0, 0, 0], Rotation.from_euler("z", 90, degrees=True).as_matrix())])
    radar = Track(np.array([0.0, 1.0]), body).mounted(pose([0.3, 0, 0.1]))
    assert np.allclose(radar.poses[:, :3, 3], [[0.3, 0, 0.1], [0, 0.3, 0.1]])
