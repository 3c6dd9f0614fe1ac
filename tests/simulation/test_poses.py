"""Tests of rigid poses: inverse poses, and the velocity of a sensor relative to rotating and sliding objects."""

from __future__ import annotations

import numpy as np
import pytest
from posing import placed, turning
from scipy.spatial.transform import Rotation

from radartwin.simulation import poses

RATE_HZ = 20.0


def test_pose_times_inverse_is_the_identity() -> None:
    rng = np.random.default_rng(0)
    turn = Rotation.random(8, rng)
    some = placed(rng.normal(size=(8, 3)), turn)
    assert poses.inverse(some) @ some == pytest.approx(np.tile(np.eye(4), (8, 1, 1)), abs=1e-12)


def test_resting_sensor_circles_a_turning_object() -> None:
    """In the frame of an object that rotates at the rate w about z, a resting sensor at p has the position q = Rz(-w t) p and the velocity
    -w z x q.
    """
    speed, place, frames = 0.7, np.array([2.0, 0.5, 0.3]), 6
    angle = speed * np.arange(frames) / RATE_HZ
    object_poses = turning("z", angle)
    sensor = placed([place] * frames)
    now, velocity = poses.relative(sensor, object_poses, RATE_HZ)
    expected = Rotation.from_euler("z", -angle[:, None]).apply(place)
    assert now[:, :3, 3] == pytest.approx(expected, abs=1e-12)
    assert velocity == pytest.approx(np.cross([0, 0, -speed], expected), abs=1e-5)


def test_sliding_sensor_keeps_its_speed_relative_to_a_turned_object() -> None:
    frames, way = 5, np.array([0.3, -0.2, 0.1])
    sensor = placed(np.arange(frames)[:, None] / RATE_HZ * way)
    turned = Rotation.from_euler("z", 30, degrees=True)
    _, velocity = poses.relative(sensor, placed(np.ones((frames, 3)), turned), RATE_HZ)
    assert velocity == pytest.approx(np.tile(turned.inv().apply(way), (frames, 1)), abs=1e-9)
