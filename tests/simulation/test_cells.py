"""The search for sequences of faces and edges from a cell of sensor positions."""

from itertools import pairwise, product

import numpy as np
import pytest

import radartwin as rt
from experiments.validation.oracles import fullwave
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import variant
from radartwin.simulation.backends.static_scene import static_scene
from radartwin.simulation.flat.room import CELL_M, TEST_M, FlatRoom
from radartwin.simulation.flat.search import Sequences, near
from radartwin.simulation.pruning import PRUNE

RADAR = rt.Radar.iwr1843("isotropic")
MIRRORS = 14


@pytest.fixture(scope="module")
def mirrors() -> FlatRoom:
    """Return a room of upright metal mirrors, 12 to 30 cm wide, that face the origin within 12 degrees."""
    variant.activate("auto")
    rng, lines = np.random.default_rng(5), []
    for angle in 2 * np.pi * np.arange(MIRRORS) / MIRRORS:
        turn = angle + np.pi / 2 + np.radians(rng.uniform(-12, 12))
        half = rng.uniform(0.06, 0.15) * np.array([np.cos(turn), np.sin(turn)])
        middle = rng.uniform(0.7, 1.3) * np.array([np.cos(angle), np.sin(angle)])
        lines.append(np.stack([middle - half, middle + half]))
    surfaces = [rt.Surface(fullwave.extruded(line[None], 0.5), "metal", f"mirror {i}", role="room") for i, line in enumerate(lines)]
    return static_scene(surfaces, RADAR).room


def chains(longest: int) -> Sequences:
    """Return all sequences of at most `longest` mirrors, no mirror twice in a row, without edges."""
    rows = [
        chain for m in range(1, longest + 1) for chain in product(range(MIRRORS), repeat=m) if all(a != b for a, b in pairwise(chain))
    ]  # fmt: skip
    chain = np.array([[*row, *[-1] * (longest - len(row))] for row in rows])
    count = np.stack([np.count_nonzero(chain >= 0, axis=1), *np.zeros((2, len(rows)), int)], axis=1)
    return Sequences(count, np.full((len(rows), 2), -1), chain, np.zeros(len(rows), bool))


def test_a_cell_finds_every_mirror_path_of_its_places(mirrors):
    """All sequences of up to three mirrors are tried at places of a cell. Places at its border see other sequences than its centre."""
    rng = np.random.default_rng(6)
    places = np.stack([np.eye(4), *(trajectory.pose(CELL_M * way / np.linalg.norm(way)) for way in rng.normal(size=(16, 3)))])
    places[1:, 2, 3] *= 0.1  # the mirrors are upright, so the places differ most within the horizontal plane
    every = chains(3)
    found = mirrors._sequences(places, places, RADAR, 3, PRUNE, False)
    known = {tuple(row) for row in found.chain[found.edge[:, 0] < 0].tolist()}
    seen = {tuple(row) for place in places for row in every.chain[mirrors.levels(every, place, RADAR) > 0].tolist()}
    only = {tuple(row) for row in every.chain[mirrors.levels(every, places[0], RADAR) > 0].tolist()}
    assert len(seen) > len(only) + 5
    assert seen <= known


def test_paths_beside_a_test_place_are_near_it(mirrors):
    """Every path that exists within the margin of a test place is near the place; some of them do not exist at the place itself."""
    rng, every, missing = np.random.default_rng(7), chains(2), 0
    for at in rng.uniform(-0.1, 0.1, (60, 3)):
        way = rng.normal(size=3)
        place, beside = trajectory.pose(at), trajectory.pose(at + 0.99 * TEST_M * way / np.linalg.norm(way))
        there, here = (mirrors.levels(every, pose, RADAR) > 0 for pose in (beside, place))
        missing += np.count_nonzero(there & ~here)
        assert near(mirrors.faces, mirrors.wavenumber, every, at, TEST_M)[there].all()
    assert missing > 5
