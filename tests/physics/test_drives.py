"""Radar drives along one planned track share their propagation paths. The tests compare them with paths traced for each drive alone."""

import dataclasses

import numpy as np
import pytest
from physics_helpers import relative_error

import radartwin as rt
from radartwin.radar.if_filter import IfFilter
from radartwin.scene import objects, rooms
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.mitsuba import TraceSettings
from radartwin.simulation.backends.static_scene import StaticScene
from radartwin.simulation.backends.track_paths import Track, along_line
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import trace_paths
from radartwin.testbed.motion_errors import RoverErrors, rover

RADAR = rt.Radar.iwr1843()
SETTINGS = TraceSettings(max_bounces=2)
NEAR = slice(22, 26)  # four of the 50 frames of a drive
PLACE = trajectory.pose(rooms.bench("lab").target_position(1.0))
CAN = rt.Surface(objects.cylinder(0.033, 0.12).apply_transform(PLACE), "metal", "can", role="object")


@pytest.fixture(scope="module")
def drive():
    """Return a part of a nominal drive past the object through the empty laboratory, and the actual poses of a rover with its motion
    errors.
    """
    nominal = trajectory.lateral_sweep(rooms.bench("lab").sensor_pose)
    actual = rover(nominal, RoverErrors(), np.random.default_rng(1))[NEAR]
    return list(rooms.room("lab", detail="shell")), nominal[NEAR], actual


def test_room_of_a_drive_matches_separate_tracing(drive):
    room, nominal, actual = drive
    shared = received(Track.of_drives(room, RADAR, nominal, SETTINGS).room(actual), RADAR, len(actual))
    alone = received(trace_paths(rt.Scene(room), RADAR, actual, None, SETTINGS)[0], RADAR, len(actual))
    # the actual positions differ from the logged positions by more than half a wavelength
    assert np.abs(actual[:, :3, 3] - nominal[:, :3, 3]).max() > 2e-3
    assert relative_error(shared, alone) < 0.02


def test_moved_paths_over_the_room_match_separate_tracing(drive):
    room, nominal, actual = drive
    drives, still = Track.of_drives(room, RADAR, nominal, SETTINGS), np.eye(4)[None]
    echo = received(drives.moving([CAN], actual, still, coupled=False), RADAR, len(actual))
    over = received(drives.over_room([CAN]).seen(actual, RADAR.frame_rate_hz), RADAR, len(actual))
    together = received(trace_paths(rt.Scene([*room, CAN]), RADAR, actual, {"can": still}, SETTINGS)[0], RADAR, len(actual))
    without = received(trace_paths(rt.Scene(room), RADAR, actual, None, SETTINGS)[0], RADAR, len(actual))
    assert relative_error(echo + over, together - without) < 0.05
    assert relative_error(over, together - without - echo) < 0.3
    assert relative_error(over, np.roll(over, 1, axis=0)) > 0.5  # the signal of the next frame is clearly different


def test_places_reach_beyond_both_ends():
    nominal = trajectory.lateral_sweep(rooms.bench("lab").sensor_pose)
    places = along_line(nominal, 0.02)
    along = places[:, 1, 3]
    assert along.min() < nominal[:, 1, 3].min() - 0.03
    assert along.max() > nominal[:, 1, 3].max() + 0.03
    assert np.allclose(np.diff(along), 0.02 * np.sign(along[-1] - along[0]))


def there_and_back() -> np.ndarray:
    """Return the 17 poses (F, 4, 4) of a drive by 48 cm towards the target and back."""
    start = rooms.bench("lab").sensor_pose
    return trajectory.at_distances(start, start[:3, 0], 0.06 * np.minimum(np.arange(17), 16 - np.arange(17)))


def test_the_way_back_has_the_paths_of_the_way_there_with_the_opposite_doppler():
    poses = there_and_back()
    drives = Track.of_drives(list(rooms.room("lab", detail="shell")), RADAR, poses, SETTINGS)
    both, there = drives.over_room([CAN], poses), drives.over_room([CAN], poses[:9])
    assert sum(map(len, both.parts)) == sum(map(len, there.parts)) > 0  # the places are traced once for both ways
    for part in both.seen(poses, RADAR.frame_rate_hz):
        for frame in range(1, 8):
            first, second = part.pose == frame, part.pose == 16 - frame
            assert np.allclose(part.amplitude[first], part.amplitude[second], rtol=1e-9)
            assert np.allclose(part.length_in_m[first], part.length_in_m[second], rtol=1e-9)
            assert np.allclose(part.rate_mps[first], -part.rate_mps[second], atol=1e-6)
            assert np.abs(part.rate_mps[first]).max() > 0.1


def test_paths_of_one_drive_over_the_room_equal_those_of_the_whole_track(drive):
    room, nominal, actual = drive
    drives = Track.of_drives(room, RADAR, nominal, SETTINGS)
    every, some = drives.over_room([CAN]), drives.over_room([CAN], actual)
    assert sum(map(len, some.parts)) < sum(map(len, every.parts))
    ones, others = (received(track.seen(actual, RADAR.frame_rate_hz), RADAR, len(actual)) for track in (some, every))
    assert relative_error(ones, others) < 1e-5  # the kernels of the ray tracer have single precision


def test_room_samples_are_the_received_paths_of_the_room(drive):
    room, nominal, actual = drive
    drives = Track.of_drives(room, RADAR, nominal, SETTINGS)
    samples = drives.room_samples(actual)
    assert np.array_equal(samples, received(drives.room(actual), RADAR, len(actual), elements="exact", oscillator=None))
    assert drives.room_samples(actual.copy()) is samples  # the result is cached by the poses
    assert not np.array_equal(drives.room_samples(nominal), samples)


def test_stored_samples_are_those_of_the_radars_band_and_of_the_correlation_length():
    """The receive filter of a radar with real sampling passes half of the band. The wall at 7 m lies in the other half."""
    pose, mesh = trajectory.look_at([0, 0, 0], [7, 0, 0])[None], objects.box((7, -1.5, -1), (7.1, 1.5, 1))
    radar = dataclasses.replace(RADAR, num_chirps=2, if_filter=IfFilter((175e3, 350e3)))

    def samples(of, correlation_m):
        track = Track.of_drives([rt.Surface(mesh, "concrete", "wall", 1e-3, "room", {}, correlation_m)], of, pose, SETTINGS)
        stored, computed = track.room_samples(pose), received(track.room(pose), of, 1, elements="exact", oscillator=None)
        assert relative_error(stored, computed) < 1e-9
        return stored

    usual, half, smooth = samples(radar, 5e-3), samples(dataclasses.replace(radar, real_sampling=True), 5e-3), samples(radar, 20e-3)
    assert np.linalg.norm(half) < 0.01 * np.linalg.norm(usual)
    assert relative_error(smooth, usual) > 0.01


def test_a_similar_room_shares_its_sequences(drive, monkeypatch):
    """The sensor rests, and all surfaces of the room are shifted by 0.02 wavelengths along each axis."""
    room, nominal, _ = drive
    at_rest, shift = nominal[:1], np.full(3, 0.02 * RADAR.wavelength_m)
    shifted = [surface.moved(trajectory.pose(shift)) for surface in room]
    first = Track.of_drives(room, RADAR, at_rest, SETTINGS)
    before, alone = (one.room_samples(at_rest) for one in (first, Track.of_drives(shifted, RADAR, at_rest, SETTINGS)))
    searches, search = [], StaticScene.searched
    monkeypatch.setattr(StaticScene, "searched", lambda scene, *rest: searches.append(scene) or search(scene, *rest))
    shared = Track.of_drives(shifted, RADAR, at_rest, SETTINGS, searched=first.searched).room_samples(at_rest)
    assert not searches
    assert relative_error(shared, alone) < 1e-3  # share of the paths that pruning leaves out
    assert relative_error(shared, before) > 0.1  # the signal is that of the shifted room
