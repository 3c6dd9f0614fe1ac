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
from radartwin.simulation.flat.search import CONE, Sequences, _cone
from radartwin.simulation.pruning import EARLY, PRUNE

RADAR = rt.Radar.iwr1843("isotropic")
MIRRORS = 14
WEAK = 0.1 * PRUNE  # share of the strongest path above which sequences with edges are compared


def upright(mirrors: int) -> FlatRoom:
    """Return a room of upright metal mirrors, 12 to 30 cm wide, that face the origin within 12 degrees."""
    variant.activate("auto")
    rng, lines = np.random.default_rng(5), []
    for angle in 2 * np.pi * np.arange(mirrors) / mirrors:
        turn = angle + np.pi / 2 + np.radians(rng.uniform(-12, 12))
        half = rng.uniform(0.06, 0.15) * np.array([np.cos(turn), np.sin(turn)])
        middle = rng.uniform(0.7, 1.3) * np.array([np.cos(angle), np.sin(angle)])
        lines.append(np.stack([middle - half, middle + half]))
    surfaces = [rt.Surface(fullwave.extruded(line[None], 0.5), "metal", f"mirror {i}", role="room") for i, line in enumerate(lines)]
    return static_scene(surfaces, RADAR).room


@pytest.fixture(scope="module")
def mirrors() -> FlatRoom:
    return upright(MIRRORS)


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
        assert mirrors._levels(every, np.arange(len(every)), place, RADAR, 0.0, None, TEST_M)[0][there].all()
    assert missing > 5


def edged(room: FlatRoom, most: int) -> Sequences:
    """Return all sequences over one or two edges with at most `most` reflections, of which at most one is between the edges."""
    faces, edges = range(len(room.faces.offset)), range(len(room.faces.length))
    ways = [chain for m in range(most + 1) for chain in product(faces, repeat=m) if all(a != b for a, b in pairwise(chain))]
    # a face reflects no ray from or to an edge of its own
    beside = [[way for way in ways if not way or way[-1] not in room.faces.sides[e]] for e in edges]
    rows = [
        ((len(a), 0, len(b)), (e, -1), (*a, *b[::-1]))
        for e in edges for a in beside[e] for b in beside[e] if len(a) + len(b) <= most and a <= b
    ]  # fmt: skip
    rows += [
        ((len(a), len(c), len(b)), (e, f), (*a, *c, *b[::-1]))
        for e in edges for f in range(e, len(edges)) for a in beside[e] for b in beside[f]
        for c in [(), *((p,) for p in faces if p not in (*room.faces.sides[e], *room.faces.sides[f]))]
        if len(a) + len(b) + len(c) <= most and (e != f or (c and a <= b))
    ]  # fmt: skip
    count, edge, chain = zip(*rows, strict=True)
    chains = np.array([[*way, *[-1] * (most - len(way))] for way in chain])
    return Sequences(np.array(count), np.array(edge), chains, np.ones(len(rows), bool))


def test_a_cell_finds_every_edge_and_every_pair_of_edges_of_its_places():
    """All sequences of at most two edges and one reflection are tried at places of a cell."""
    room, rng = upright(4), np.random.default_rng(8)
    ways = rng.normal(size=(8, 3))
    places = np.stack([np.eye(4), *(trajectory.pose(CELL_M * way / np.linalg.norm(way)) for way in ways)])
    every = edged(room, 1)
    found = room._sequences(places, places, RADAR, 2, EARLY * WEAK, True)

    def key(sequences, k, way=1):
        used, edges = sequences.count[k].sum(), sequences.edge[k][::way]
        return tuple(sequences.count[k][::way]), tuple(edges[edges >= 0]), tuple(sequences.chain[k, :used][::way])

    known = {key(found, k, way) for k in range(len(found)) for way in (1, -1)}
    for place in places:
        levels = room.levels(every, place, RADAR)
        strong = np.flatnonzero(levels > WEAK * room.levels(found, place, RADAR).max())
        assert np.count_nonzero(every.edge[strong, 1] >= 0) > 20
        assert {key(every, k) for k in strong} <= known


@pytest.mark.parametrize("away_m", [1.0, 5.0])
def test_the_beam_over_a_face_that_is_seen_edge_on_holds_every_ray_of_the_cell(away_m: float) -> None:
    """Each plane touches the rays from the ball that stay closest to it. A ball that overlaps the face has no bounds."""
    rng, at, radius = np.random.default_rng(7), np.array([0.3, -0.2, 0.05]), 0.12
    across = rng.uniform(-0.3, 0.3, (4, 2))
    polygon = np.array([[away_m, 0.0, 0.0]]) + np.column_stack([across[np.argsort(np.arctan2(*across.T))], np.zeros(4)])
    planes = np.empty((CONE, 4))
    assert _cone(tuple(at), radius, polygon, 4, planes) == CONE
    ball = rng.normal(size=(20_000, 3))
    start = at + radius * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    through = rng.dirichlet(np.ones(4), 20_000) @ polygon
    ends = start + rng.uniform(1, 20, (20_000, 1)) * (through - start)
    height = ends @ planes[:, :3].T - planes[:, 3]
    assert height.min() > 0
    middle = polygon.mean(axis=0)
    size = np.linalg.norm(polygon - middle, axis=1).max()
    np.testing.assert_allclose(planes[:, :3] @ middle - planes[:, 3], size)
    np.testing.assert_allclose(planes[:, :3] @ at - planes[:, 3], -radius)
    assert _cone(tuple(at), away_m, polygon, 4, planes) == 0
