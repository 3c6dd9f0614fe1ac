"""Tests of flats of many rooms: the search leaves out only paths below the pruning threshold, and large rooms are traced by faces."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.speed.flat_of_rooms import flat
from radartwin.radar.chirp import Radar
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import variant
from radartwin.simulation.backends import mitsuba, static_scene
from radartwin.simulation.backends.static_scene import StaticScene
from radartwin.simulation.flat import search
from radartwin.simulation.flat.room import FlatRoom, RoomWarning
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import PRUNE

RADAR = Radar.iwr1843()


def of_flat(surfaces: int) -> tuple[StaticScene, np.ndarray]:
    """Return the static scene of a flat, and ten poses of a radar that drives through 10 cm in its middle room."""
    variant.activate("auto")
    scene, place = flat(surfaces)
    poses = np.array([trajectory.pose(place + np.array([x, 0.0, 0.0])) for x in np.linspace(0, 0.1, 10)])
    return StaticScene(list(scene.surfaces), *mitsuba.target(list(scene.surfaces), RADAR)), poses


def strengths(parts: list[Paths]) -> np.ndarray:
    """Return the sorted amplitudes of all paths."""
    return np.sort(np.abs(np.concatenate([part.amplitude for part in parts])).max(axis=1))


@pytest.mark.parametrize(("surfaces", "frames"), [(10, 1), (100, 1), (100, 10)])
def test_bounds_of_fields_leave_out_no_path_above_the_pruning_threshold(
    surfaces: int, frames: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    static, poses = of_flat(surfaces)
    bounded = static.room_paths(poses[:frames], RADAR, 3, PRUNE)
    for name in ("beams", "closed", "reached"):
        part: Any = getattr(search, name)
        unbounded = lambda walls, cell, *rest, part=part: part(walls, cell._replace(front=0 * cell.front, least=0.0), *rest)  # noqa: E731
        monkeypatch.setattr(search, name, unbounded)
    np.testing.assert_allclose(strengths(bounded), strengths(static.room_paths(poses[:frames], RADAR, 3, PRUNE)), rtol=1e-9)


def test_a_lower_threshold_of_the_search_changes_the_paths_as_little_as_pruning_states() -> None:
    """`radartwin.simulation.pruning` states that a fifth of its thresholds changes signals by 0.009 to 0.027."""
    static, poses = of_flat(100)
    found = [static.room.searched(poses, RADAR, 4, PRUNE / factor) for factor in (1, 10)]
    assert len(found[1].sequences) > len(found[0].sequences)
    few, many = (strengths(static.room_paths(poses, RADAR, 4, PRUNE, one)) for one in found)
    assert abs(few.sum() - many.sum()) < 0.027 * many.sum()


def test_last_beams_that_nothing_leads_back_carry_no_path(monkeypatch: pytest.MonkeyPatch) -> None:
    static, poses = of_flat(100)
    poses = poses[::9]  # one of the two is not at the centre of their cell
    weak = PRUNE / 20  # no path above PRUNE needs a last beam for an edge alone
    found, beams = [static.room.searched(poses, RADAR, 4, weak, diffractions=1)], search.beams
    monkeypatch.setattr(search, "beams", lambda walls, cell, longest, twice: beams(walls, cell, longest))
    found.append(static.room.searched(poses, RADAR, 4, weak, diffractions=1))
    np.testing.assert_array_equal(*(strengths(static.room_paths(poses, RADAR, 4, weak, one)) for one in found))


def test_sequences_left_out_behind_panes_carry_no_path(monkeypatch: pytest.MonkeyPatch) -> None:
    static, poses = of_flat(100)
    found = [static.room.searched(poses, RADAR, 4, PRUNE)]
    monkeypatch.setattr(FlatRoom, "_panes", FlatRoom._unblocked)
    found.append(replace(static.room).searched(poses, RADAR, 4, PRUNE))
    assert sum(map(len, found[0].of_test)) < 0.7 * sum(map(len, found[1].of_test))
    np.testing.assert_array_equal(*(strengths(static.room_paths(poses, RADAR, 4, PRUNE, one)) for one in found))


def test_room_of_too_many_faces_is_traced_by_tubes_with_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    static, _ = of_flat(10)
    assert static.is_flat
    monkeypatch.setattr(static_scene, "MAX_FACES", 11)
    with pytest.warns(RoomWarning, match="12 flat faces, over MAX_FACES = 11; ray tubes trace it, without edge diffraction"):
        assert not replace(static).is_flat


@pytest.mark.slow
def test_flat_of_ten_thousand_surfaces_is_traced_by_faces() -> None:
    static, poses = of_flat(10_000)
    assert static.is_flat
    with pytest.warns(RoomWarning, match="over MAX_EDGES = 1000; its paths have at most one diffraction"):
        parts = static.room_paths(poses[:2], RADAR, 2, PRUNE)
    assert min(len(part) for part in parts) > 0
