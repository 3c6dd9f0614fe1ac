"""A moving radar traces the paths between objects and room at some of its poses (places), and moves them to the other poses."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from physics_helpers import relative_error
from posing import placed, turning

import radartwin as rt
from radartwin.errors import InputError
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends import mitsuba
from radartwin.simulation.backends.backend import paths_of_frames
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.backends.track_paths import SPACING_M, TURNED_RAD, Track, closest, covering
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import trace_paths
from radartwin.store import array_cache

RADAR = replace(rt.Radar.iwr1843(), num_chirps=4, num_samples=128)
EXACT = TraceSettings(max_bounces=2, place_spacing_m=0)


def sideways(steps_m: np.ndarray) -> np.ndarray:
    return placed(steps_m[:, None] * np.eye(3)[1])


def scene() -> rt.Scene:
    """Return a can between a floor and a metal wall, both parallel to the line of sight."""
    sizes, where = {"floor": (4, 4, 0.1), "wall": (4, 0.1, 3)}, {"floor": [2, 0, -0.55], "wall": [2, 0.7, 1]}
    room = [rt.Surface(trimesh.creation.box(size).apply_translation(where[name]), "metal", name) for name, size in sizes.items()]
    can = rt.Surface(trimesh.creation.cylinder(0.05, 0.2).apply_translation([1.5, 0, 0]), "metal", "can")
    return rt.Scene([*room, can])


def signal(poses: np.ndarray, settings: TraceSettings, radar: rt.Radar = RADAR) -> np.ndarray:
    return received(trace_paths(scene(), radar, poses, None, settings)[0], radar, len(poses))


def over_room(poses: np.ndarray, radar: rt.Radar = RADAR) -> tuple[np.ndarray, np.ndarray]:
    """Return the signals of the paths between can and room: traced at every pose, and traced at places and moved."""
    alone = signal(poses, replace(EXACT, coupling=False), radar)
    moved = replace(EXACT, place_spacing_m=SPACING_M, coupled_rays_per_wavelength2=1.0)
    return signal(poses, EXACT, radar) - alone, signal(poses, moved, radar) - alone


def test_every_pose_of_a_line_is_within_half_a_spacing_of_a_place():
    poses = sideways(np.arange(0, 1.001, 0.004))
    chosen = covering(poses, SPACING_M)
    along = poses[chosen, 1, 3]
    assert np.abs(along[closest(poses[chosen], SPACING_M, poses)] - poses[:, 1, 3]).max() <= SPACING_M / 2 + 1e-9
    assert np.diff(along) == pytest.approx(SPACING_M, abs=0.005)
    assert list(covering(sideways(np.arange(5) * 0.05), SPACING_M)) == [0, 1, 2, 3, 4]


def test_a_turning_radar_has_a_place_for_every_few_degrees():
    angles = np.radians(np.arange(0, 41, 1.0))
    poses = np.stack([trajectory.look_at([0, 0, 0], [np.cos(a), np.sin(a), 0]) for a in angles])
    place = covering(poses, SPACING_M)
    off = np.abs(angles[place][closest(poses[place], SPACING_M, poses)] - angles)
    assert off.max() <= 1.01 * TURNED_RAD  # a chord is a little shorter than its arc
    assert 6 <= len(place) <= 8


def test_moved_paths_have_the_signal_of_paths_traced_at_every_pose():
    poses = sideways(0.3 + np.arange(6) * 0.015)
    every, alone = signal(poses, EXACT), signal(poses, replace(EXACT, coupling=False))
    moved = signal(poses, replace(EXACT, place_spacing_m=SPACING_M, coupled_rays_per_wavelength2=1.0))
    fast = signal(poses, TraceSettings(max_bounces=2))
    coupled = np.linalg.norm(every - alone)
    assert coupled > 0.01 * np.linalg.norm(every)  # the paths that are moved matter
    assert 0 < np.linalg.norm(moved - every) < 0.1 * coupled
    assert np.linalg.norm(fast - every) < 0.15 * coupled


def test_paths_of_flat_objects_are_traced_at_every_pose():
    """The mirror point of a flat face moves with the radar."""
    box = rt.Surface(trimesh.creation.box((0.3, 0.3, 0.3)).apply_translation([1.15, 0, -0.345]), "metal", "box", role="object")
    poses, settings = sideways(np.arange(4) * 0.015), (EXACT, replace(EXACT, coupling=False), TraceSettings(max_bounces=2))
    parts = (trace_paths(rt.Scene([next(iter(scene())), box]), RADAR, poses, None, each)[0] for each in settings)
    every, alone, usual = (received(part, RADAR, len(poses)) for part in parts)
    assert relative_error(alone, every) > 0.1  # the paths over the floor matter
    assert relative_error(usual, every) < 1e-4  # one of both is merged


def test_moved_paths_have_their_doppler():
    """The radar moves by 0.9 m/s, and a frame takes 13 ms."""
    radar = replace(RADAR, num_chirps=32, chirp_interval=2e-4, frame_rate_hz=60.0)
    every, moved = over_room(sideways(0.3 + np.arange(5) * 0.015), radar)
    assert relative_error(moved, every) < 0.15


def test_a_rolling_radar_traces_a_place_for_every_few_degrees():
    """A roll turns the antenna and with it the polarisation, not the heading."""
    angles = np.radians(np.arange(0, 31, 2.0))
    poses = turning("x", angles, (0, 0.3, 0))
    assert len(covering(poses, SPACING_M)) >= 5
    every, moved = over_room(poses)
    assert relative_error(moved, every) < 0.1


def test_blocks_of_frames_have_the_paths_of_the_whole_recording():
    """A block of four frames of 6 mm has one place or two."""
    poses, tracer = sideways(0.3 + np.arange(16) * 0.006), MitsubaBackend(TraceSettings(max_bounces=2))
    whole = signal(poses, tracer.settings)
    blocks = []
    for k in range(0, 16, 4):
        mitsuba._tracks.clear()  # the paths at places that the whole recording has left
        blocks.append(received(paths_of_frames(tracer, scene(), RADAR, poses, {}, k, k + 4), RADAR, 4))
    assert relative_error(np.concatenate(blocks), whole) < 1e-3


def test_clutter_has_the_threshold_of_the_strongest_path_of_its_own_pose():
    """Close to the wall, the echo of the wall is 30 dB stronger than elsewhere, and hides the paths between can and room."""
    facing = trajectory.look_at([1.5, 0.64, 0.4], [1.5, 1.64, 0.4])[None]
    poses = np.concatenate([sideways(np.array([0.3])), facing])
    both, alone = (Track(list(scene()), RADAR, poses[:k], EXACT).static(poses[:k])[0][2:] for k in (2, 1))
    assert [len(part.frames(0, 1)) for part in both] == [len(part) for part in alone]
    assert sum(map(len, alone)) > 0


def test_the_length_of_the_frame_is_part_of_the_key_of_cached_paths(tmp_path):
    poses = sideways(0.3 + np.arange(3) * 0.25)
    short, long = (replace(RADAR, num_chirps=chirps, frame_rate_hz=20.0) for chirps in (2, 200))
    with array_cache.in_folder(tmp_path / "used"):
        signal(poses, TraceSettings(max_bounces=2), short)
        after = signal(poses, TraceSettings(max_bounces=2), long)
    with array_cache.in_folder(tmp_path / "empty"):
        assert np.array_equal(after, signal(poses, TraceSettings(max_bounces=2), long))


def test_nothing_is_moved_if_object_and_room_are_uncoupled(monkeypatch):
    monkeypatch.setattr(Track, "_clutter", None)
    signal(sideways(0.3 + np.arange(3) * 0.01), TraceSettings(max_bounces=1))
    signal(sideways(0.3 + np.arange(3) * 0.01), TraceSettings(max_bounces=2, coupling=False))


def test_a_radar_at_rest_traces_every_path():
    poses = np.repeat(sideways(np.array([0.3])), 3, axis=0)
    assert np.array_equal(signal(poses, TraceSettings(max_bounces=2)), signal(poses, EXACT))


@pytest.mark.parametrize("spacing", [-0.01, 0.5, float("nan"), True, "0.04"])
def test_a_wrong_spacing_is_refused(spacing):
    with pytest.raises(InputError, match="place_spacing_m must be"):
        TraceSettings(place_spacing_m=spacing)


def test_a_drive_passes_close_to_one_object_and_far_from_another():
    """The ball is too close for a grid of tubes at some places, and the box has other frequency nodes than the ball."""
    wall = rt.Surface(trimesh.creation.box((0.1, 6, 3)).apply_translation([3.0, 0, 0]), "metal", "wall", role="room")
    ball = rt.Surface(trimesh.creation.icosphere(3, 0.1).apply_translation([0.115, 0.6, 0]), "metal", "ball", role="object")
    box = rt.Surface(trimesh.creation.box((0.2, 0.2, 0.2)).apply_translation([1.2, 0.3, 0]), "metal", "box", role="object")
    poses = sideways(np.arange(31) * 0.04)
    parts, _ = trace_paths(rt.Scene([wall, ball, box]), RADAR, poses, None, TraceSettings(max_bounces=2))
    assert np.isfinite(received(parts, RADAR, len(poses))).all()


def test_a_resting_track_stores_samples_and_shaded_paths_for_all_chirp_timings(tmp_path, monkeypatch):
    """A second process with another chirp timing traces nothing, and gets the same bytes. The large paths stay off the disk."""
    pose, other = sideways(np.array([0.3])), replace(RADAR, num_chirps=7, chirp_interval=2e-4, frame_rate_hz=5.0)
    ball = [rt.Surface(trimesh.creation.icosphere(2, 0.05), "metal", "ball")]
    there = np.stack([trajectory.pose([1.0, y, 0.0]) for y in (0.0, 0.1)])

    def results(radar):
        track = Track.of_drives([*scene()], radar, pose, EXACT)
        shadows = track.shadow(ball, pose, there)
        assert sum(map(len, shadows)) > 0
        return track.room_samples(pose), received(shadows, radar, 2)

    expected = results(other)
    assert np.array_equal(expected[0], received(Track.of_drives([*scene()], other, pose, EXACT).room(pose), other, 1))
    with array_cache.in_folder(tmp_path):
        results(RADAR)
    monkeypatch.setattr(Track, "_static", None)
    monkeypatch.setattr(Track, "searched", None)
    with array_cache.in_folder(tmp_path):
        for stored, made in zip(results(other), expected, strict=True):
            assert np.array_equal(stored, made)
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 300_000
