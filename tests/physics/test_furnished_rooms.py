"""The seeded furnished rooms: their layouts, their stored full-wave fields, and the score of the simulator in these rooms."""

import json
from dataclasses import replace

import numpy as np
import pytest
from posing import placed, turning

from experiments.validation import furnished_rooms
from experiments.validation.oracles import fullwave, furnished, moments_2d
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import variant
from radartwin.simulation.backends.static_scene import static_scene
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.flat import room
from radartwin.simulation.pruning import PRUNE
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import trace_paths

GIVEN_ROOMS = ("corner", "corner_panel", "corner_cabinet", "corner_cabinet_post", "post_before_wall", "alcove")
NAMES = [furnished.name(seed) for seed in furnished.SEEDS]


def test_stored_rooms_are_the_rooms_of_their_seeds():
    stored = json.loads((furnished.ROOMS / "scenes.json").read_text())["scenes"]
    assert list(stored) == NAMES
    for seed in (1, 14, 25):
        room = furnished.room(seed)
        assert {part: strips.tolist() for part, strips in room.items()} == stored[furnished.name(seed)]


def test_stored_field_is_the_solution_of_its_room():
    check_against_stored("free_25", [30], moments_2d.PER_WAVELENGTH, 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wall_01", "corner_12", "corridor_23", "alcove_14", "free_05"])
def test_finer_nodes_do_not_change_the_stored_field(name):
    check_against_stored(name, [0, 17, 40, 63], 8.0, 5e-3)


def check_against_stored(name, samples, per_wavelength, limit):
    frequency, stored = fullwave.field(furnished.ROOMS, name)
    nodes = moments_2d.nodes(fullwave.strips(furnished.ROOMS, name).values(), float(frequency[-1]), per_wavelength)
    described = json.loads((furnished.ROOMS / "scenes.json").read_text())
    found = moments_2d.sweep(nodes, frequency[samples], np.array(described["transmitter_m"]), np.array(described["receiver_m"]))
    assert np.abs(found - stored[samples]).max() < limit * np.abs(stored).max()


TARGET = (1.5, 0.06)  # largest rms difference of the profiles in dB, and largest complex error
SINGLE = (1.0, 0.05)  # the same for single strips
# Rooms in which the simulator misses the target, with the difference and the error that the simulator must not exceed.
MISSED = {
    "corner_cabinet_post": (1.51, 0.06), "post_before_wall": (1.5, 0.07),
    "wall_01": (7.0, 0.07), "corner_02": (8.0, 0.18), "corridor_03": (4.6, 0.07),
    "alcove_04": (3.9, 0.06), "free_05": (2.5, 0.06), "corner_07": (4.9, 0.13), "corridor_08": (6.6, 0.07),
    "free_10": (3.8, 0.07), "wall_11": (2.0, 0.06), "corner_12": (3.0, 0.06), "corridor_13": (7.5, 0.35),
    "alcove_14": (2.5, 0.06), "wall_16": (8.2, 0.21), "corridor_18": (2.9, 0.06), "wall_21": (2.5, 0.1),
    "free_25": (8.6, 0.06), "alcove_29": (3.7, 0.32),
}  # fmt: skip


def scored(name):
    folder = furnished.ROOMS if name in NAMES else fullwave.GIVEN
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here: the reference fields are not part of the repository")
    return furnished_rooms.score(folder, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*(f"strip_{angle}" for angle in (20, 45, 70)), *GIVEN_ROOMS, *NAMES])
def test_furnished_rooms_match_full_wave(name):
    found = scored(name)
    largest_db, largest = MISSED.get(name, SINGLE if name.startswith("strip") else TARGET)
    assert found.worst("profile_db") < largest_db
    assert found.worst("error") < largest


@pytest.mark.parametrize("name", [*GIVEN_ROOMS, *NAMES[1::4]])
def test_a_frame_of_a_track_is_as_right_as_a_frame_at_rest(name):
    """The radar sees through gaps, and past edges, which it does not see from its other poses."""
    found = scored(name)
    assert found.on_track.profile_db == pytest.approx(found.compared.profile_db, abs=0.2)
    assert found.on_track.error == pytest.approx(found.compared.error, abs=0.01)


def test_interpolated_channels_agree_with_exact_ones(monkeypatch):
    """The fields of most paths are interpolated between the outermost channels; here they are computed at every channel."""
    variant.activate("auto")
    radar, poses = furnished.radar(), np.eye(4)[None]
    flat = static_scene(list(fullwave.scene(furnished.ROOMS, "alcove_19").surfaces), radar).room
    searched = flat.searched(poses, radar, 4, PRUNE)

    def signal():
        return received(flat.paths(poses, np.zeros((1, 3)), radar, PRUNE, searched), radar, 1)[0, 0]

    usual = signal()
    monkeypatch.setattr(room, "CHANNELS", 0.0)
    monkeypatch.setattr(room, "UNEVEN", -1.0)
    exact = signal()
    assert np.linalg.norm(exact[0, 0] - exact[1, 3]) > 0.1 * np.linalg.norm(exact[0, 0])
    assert (np.linalg.norm(usual - exact, axis=2) < 0.01 * np.linalg.norm(exact, axis=2)).all()


def test_a_wall_seen_through_a_gap_narrower_than_the_array():
    """Only the channels in the middle of the array see the wall. Each channel agrees with a single antenna at its place."""
    strip = {"left": [[1.2, 0.003], [1.2, 0.6]], "right": [[1.2, -0.6], [1.2, -0.003]], "wall": [[2.5, -1.5], [2.5, 1.5]]}
    scene = Scene([Surface(fullwave.extruded(np.array([line])), "metal", name, role="room") for name, line in strip.items()])
    radar = furnished.radar()
    every = received(trace_paths(scene, radar, np.eye(4)[None], None, TraceSettings())[0], radar, 1)[0, 0]
    for t, r in ((0, 0), (1, 0), (1, 3)):
        place = (radar.tx_positions[t] + radar.rx_positions[r]) / 2
        single = replace(radar, tx_positions_m=((0.0, 0.0, 0.0),), rx_positions_m=((0.0, 0.0, 0.0),))
        alone = received(trace_paths(scene, single, placed([place]), None, TraceSettings())[0], single, 1)[0, 0, 0, 0]
        assert np.linalg.norm(every[t, r] - alone) < 0.05 * np.linalg.norm(alone)


def test_a_rolling_radar_has_the_paths_of_its_antenna_axis():
    scene, turn = fullwave.scene(furnished.ROOMS, "corner_17"), np.radians([0, 30, 60, 90])
    poses = turning("x", turn)
    radar = replace(furnished.radar(), frame_rate_hz=1e-3)
    track = [part.frames(3, 4) for part in trace_paths(scene, radar, poses, None, TraceSettings())[0]]
    rest = trace_paths(scene, radar, poses[3:], None, TraceSettings())[0]
    rolled, still = (received(parts, radar, 1)[0, 0] for parts in (track, rest))
    assert np.linalg.norm(rolled - still) < 0.01 * np.linalg.norm(still)
