"""Drives along one track: what is shared between them against tracing each by itself."""

import numpy as np
import pytest

import radartwin as rt
from radartwin.measured.motion_errors import RoverErrors, rover
from radartwin.scene import objects, rooms, trajectory
from radartwin.simulation.drives import Drives, places_along
from radartwin.simulation.mitsuba import TraceSettings
from radartwin.simulation.simulate import trace_paths
from radartwin.simulation.synthesis import received

RADAR = rt.Radar.iwr1843()
SETTINGS = TraceSettings(max_bounces=2)
NEAR = slice(22, 26)  # of a drive's 50 frames


@pytest.fixture(scope="module")
def drive():
    """A nominal piece of a lateral drive through the empty lab, and where a rover with its errors is."""
    nominal = trajectory.lateral_sweep(rooms.bench("lab").sensor_pose)
    actual = rover(nominal, RoverErrors(), np.random.default_rng(1))[NEAR]
    return list(rooms.room("lab", detail="shell")), nominal[NEAR], actual


def relative(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt((np.abs(one - other) ** 2).sum() / (np.abs(other) ** 2).sum()))


def signal(parts, frames):
    return received(parts, RADAR, frames)


def test_a_room_is_the_same_on_every_drive(drive):
    room, nominal, actual = drive
    shared = signal(Drives(room, RADAR, nominal, SETTINGS).room(actual), len(actual))
    alone = signal(trace_paths(rt.Scene(room), RADAR, actual, None, SETTINGS)[0], len(actual))
    assert np.abs(actual[:, :3, 3] - nominal[:, :3, 3]).max() > 2e-3  # more than half a wavelength off the log
    assert relative(shared, alone) < 0.02


def test_a_thing_is_carried_with_the_sensor(drive):
    room, nominal, actual = drive
    at = rooms.bench("lab").target_position(1.0)
    can = rt.Surface(objects.cylinder(0.033, 0.12).apply_transform(trajectory.pose(at)), "metal", "can", role="object")
    shared = signal(Drives(room, RADAR, nominal, SETTINGS).thing([can]).seen(actual, RADAR.frame_rate_hz), len(actual))
    moving = {"can": np.eye(4)[None]}
    together = signal(trace_paths(rt.Scene([*room, can]), RADAR, actual, moving, SETTINGS)[0], len(actual))
    without = signal(trace_paths(rt.Scene(room), RADAR, actual, None, SETTINGS)[0], len(actual))
    assert relative(shared, together - without) < 0.08
    assert relative(shared, np.roll(together - without, 1, axis=0)) > 0.5  # the next frame is another signal


def test_images_move_exactly(drive):
    """Lengths and directions of wall echoes, moved by 3 cm and turned by 2 degrees, against those found there."""
    room, nominal, _ = drive
    there = nominal[:1].copy()
    there[0, :3, :3] = trajectory.look_at([0, 0, 0], [1, np.tan(np.radians(2)), 0])[:3, :3]
    there[0, :3, 3] += [0.02, -0.02, 0.01]
    radar = rt.Radar.iwr1843(element="isotropic")  # which sees the walls beside it in both poses
    before, after = (trace_paths(rt.Scene(room), radar, p, None, TraceSettings(1, diffuse=False))[0][0] for p in (nominal[:1], there))
    shift = nominal[0, :3, :3].T @ (there[0, :3, 3] - nominal[0, :3, 3])
    moved = before.moved(shift[None], (there[0, :3, :3].T @ nominal[0, :3, :3])[None], np.zeros((1, 3)))
    assert len(after) >= 5
    for path in range(len(after)):
        away = np.abs(moved.length_m - after.length_m[path]) + np.linalg.norm(moved.arrival - after.arrival[path], axis=1)
        nearest = int(np.argmin(away))
        assert moved.length_m[nearest] == pytest.approx(after.length_m[path], abs=1e-9)
        assert moved.arrival[nearest] == pytest.approx(after.arrival[path], abs=1e-9)
        assert moved.departure[nearest] == pytest.approx(after.departure[path], abs=1e-9)


def test_places_reach_beyond_both_ends():
    nominal = trajectory.lateral_sweep(rooms.bench("lab").sensor_pose)
    places = places_along(nominal, 0.02)
    along = places[:, 1, 3]
    assert along.min() < nominal[:, 1, 3].min() - 0.03
    assert along.max() > nominal[:, 1, 3].max() + 0.03
    assert np.allclose(np.diff(along), 0.02 * np.sign(along[-1] - along[0]))
