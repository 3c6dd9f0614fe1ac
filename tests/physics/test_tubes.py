"""Tests of ray tubes: their spreading after curved surfaces, energy, polarisation and reciprocity."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from physics_helpers import FREQUENCY, UP, WAVELENGTH, K, coherent, geometric_optics_of_a_sphere, tube_hits

import radartwin as rt
from radartwin.scene import objects
from radartwin.simulation import geometry, reflection_table, variant
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.hits import Antennas, TraceOptions


@pytest.mark.parametrize(
    ("density", "bound_db"),
    [(4.0, {"S": 0.1, "S W": 0.5, "W S": 0.2, "W S W": 0.5}), (16.0, {"S": 0.1, "S W": 0.25, "W S": 0.1, "W S W": 0.2})],
)
def test_sphere_and_wall_match_geometric_optics(density, bound_db):
    """A sphere of 5 cm, 30 cm from a wall, is seen from the side, where the reflections on the sphere are far from its shadow line."""
    variant.activate()
    sensor, centre, radius, wall_x = np.zeros(3), np.array([0.3, 1.0, 0.0]), 0.05, 0.6
    image = np.array([2 * wall_x, 0, 0])
    wall, ball = objects.plate(3, 3).apply_translation([wall_x, 0, 0]), objects.sphere(radius, 5).apply_translation(centre)
    built = geometry.build([wall, ball])
    table = reflection_table.build([("metal", 0.0)] * 2, FREQUENCY)
    antenna = Antennas(sensor[None], UP)
    hits = {}  # by the first letter of the names in `bound_db`
    for letter, first, at in (("S", 1, centre), ("W", 0, centre * [-1, 1, 1] + [2 * wall_x, 0, 0])):
        target = geometry.build([objects.sphere(radius, 4).apply_translation(at)])
        grid = tube_grid.towards(target.hull_points(), sensor[None], target.centre, WAVELENGTH / np.sqrt(density), (0.14, 0.95))
        assert grid is not None
        hits[letter] = tubes.trace(built, table, grid, antenna, antenna, TraceOptions(3, built.surface, first))
    for name, bound in bound_db.items():
        source, receiver = (image if name[end] == "W" else sensor for end in (0, -1))
        level, length, _ = geometric_optics_of_a_sphere(centre, radius, source, receiver)
        # every reflection on metal changes the sign of the vertical field
        expected = -((-1) ** name.count("W")) * level * np.exp(1j * K * length)
        # Neither the sphere nor the wall reflects a tube twice in a row, so that the first surface and the number of bounces give the path.
        found = hits[name[0]]
        value = coherent(found, found.bounce == len(name.split()))
        assert abs(20 * np.log10(abs(value / expected))) < bound, name
        assert abs(np.degrees(np.angle(value / expected))) < 20, name


@pytest.mark.parametrize("bounces", [1, 2])
def test_divided_tubes_sum_to_one(bounces):
    """The radar sees the side and the upper end of a can; the weights of whole, narrow and cut tubes are summed at random points."""
    variant.activate()
    from radartwin.simulation.curved import borders, division
    from radartwin.simulation.curved.borders import PIECES
    from radartwin.simulation.curved.device import Device
    from radartwin.simulation.curved.flight import WHOLE

    built = geometry.build([objects.cylinder(0.02, 0.05)])
    source = np.array([[1.0, 0.2, 0.7], [0.8, -0.1, 0.9]])
    grid = tube_grid.towards(built.hull_points(), source, built.centre, WAVELENGTH, (0.25, 0.25))
    assert grid is not None
    options = TraceOptions(bounces)
    device, poses = Device.of(built, options), (0, 2)
    sequences = division.patch_sequences(device, grid, poses, options, None) if bounces > 1 else None
    index, share, cut = division.divided(borders.cut(built, grid, poses), sequences, grid, poses, True, True)
    at = np.random.default_rng(1).uniform(1, np.array([grid.count_u, grid.count_v]) - 3, (500, 2))
    if sequences is not None:  # cells beside the body have no tubes
        met = sequences[1, : grid.per_pose].reshape(grid.count_v, grid.count_u) > 0
        i, j = np.floor(at).astype(int).T
        at = at[met[j, i] & met[j + 1, i] & met[j, i + 1] & met[j + 1, i + 1]]
    total, kinds = np.zeros(len(at)), set()
    for i, s in zip(index, share, strict=True):
        if i // grid.per_pose != 1:
            continue
        number = s // (WHOLE + 1) - 1
        cell = i - grid.per_pose
        centre = np.array([cell % grid.count_u, cell // grid.count_u]) if number < 0 else cut.centre[number]
        off = at - centre
        if s & WHOLE:
            off *= PIECES if number >= 0 else 1
            square = (off[:, 0] > 0) + 2 * (off[:, 1] > 0)
            total += np.clip(1 - np.abs(off), 0, None).prod(axis=1) * (s >> square & 1)
        else:
            a, b = cut.corner[number], np.roll(cut.corner[number], -1, axis=0)
            total += ((b - a)[:, 0] * (off[:, None] - a)[..., 1] - (b - a)[:, 1] * (off[:, None] - a)[..., 0] >= 0).all(axis=1)
        kinds.add((number >= 0, bool(s & WHOLE)))
    np.testing.assert_allclose(total, 1, atol=1e-5)
    assert len(kinds) == bounces + 1


def tube(direction, footprint, **more):
    """Return a tube that has met no facet. footprint: derivatives of its position and of its direction along u and v."""
    variant.activate()
    import mitsuba as mi

    from radartwin.simulation.curved import flight

    names = "index", "pose", "origin", "weight", "share", "departure", "across", "encounters", "length", "first"
    none: Any = dict.fromkeys(names)
    fields = dict(zip(("position_du", "position_dv", "direction_du", "direction_dv"), (mi.Vector3f(*x) for x in footprint), strict=True))
    return flight.Tubes(**(none | more), direction=mi.Vector3f(*direction), **fields, caustics=mi.UInt32(0))


def caustics(direction, footprint, way):
    """Return the number of caustics of a tube on a way, with the arguments of `tube`."""
    moving = tube(direction, footprint)
    import mitsuba as mi

    from radartwin.simulation.curved import contact

    contact.count_caustics(moving, mi.Float(way))
    return int(moving.caustics.numpy()[0])


@pytest.mark.parametrize("phase", [1e2, 1e4, 1e6, 1e8, 1e10])
def test_a_tube_of_any_width_has_at_most_the_echo_of_its_footprint_in_phase(phase):
    """A tube between the walls of a mug can spread by metres, and the sine of Dr.Jit exceeds 1 for phases above 1e7 rad."""
    variant.activate()
    import mitsuba as mi

    from radartwin.simulation.curved import scatter
    from radartwin.simulation.curved.contact import Contact

    width = phase / K
    footprint = (width, 0, 0), (0, 0.8, 0.6), (width, 0, 0), (0, 0, 0)
    spread = tube((0, 0.6, -0.8), footprint, weight=mi.Float(1e-6), across=mi.Vector3f(1, 0, 0))
    up, none = mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 0)
    facet = Contact(mi.UInt32(0), mi.Bool(True), up, up, none, none, mi.Float(0.8), [none, none], [none, none])
    device: Any = SimpleNamespace(curved=False)
    reception = scatter.Reception(mi.Vector3f(0.6, 0, 0.8), mi.Float(1.0), mi.Vector3f(0, 1, 0), False)
    re, im, *_ = scatter.scatter(device, spread, facet, reception, mi.Float(K), mi.Bool(True))
    assert np.hypot(re.numpy(), im.numpy())[0] <= np.sqrt(1e-6 * width) / (8 * np.pi * 0.8)


@pytest.mark.parametrize("foci_m", [(np.inf, np.inf), (1.0, np.inf), (3.0, 1.0), (1.0, 1.5), (1.0, 1.0), (3.0, 4.0), (-1.0, 1.0)])
def test_field_advances_a_quarter_cycle_at_each_focal_line(foci_m):
    """The phase behind the focus less that before it is that of the diffraction integral exp(-j k x^2 (1/z - 1/f)/2) of each axis."""
    way = 2.0
    expected = np.prod([np.sqrt(1 / (1e-9 + 1j * (1 / way - 1 / f))) / np.sqrt(1 / (1e-9 + 1j * (1 / 1e-3 - 1 / f))) for f in foci_m])
    expected /= abs(expected)
    turn = np.radians(25.0)  # angle between the focal lines and the axes of the ray grid
    axes = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0]])
    foot_u, foot_v = (-(axes.T / np.array(foci_m)) @ axes)[:2].tolist()
    assert 1j ** caustics((0, 0, 1), [(1, 0, 0), (0, 1, 0), foot_u, foot_v], way) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_diverging_tube_passes_no_caustic_within_nanometres(sign):
    """The cross-section has terms of 1e-6 and 1e-22, whose product is subnormal, as at an edge of two faces."""
    cross_section = [(sign * 0.00230769, 0, sign * 0.00386094), (0.00153846, 0, -1.7e-10)]
    cross_section += [(sign * 0.0009777, 0, sign * 0.00163578), (0.00475697, 0, -0.00245366)]
    assert caustics((0, 1, 0), cross_section, 3.6e-9) == 0


@pytest.mark.parametrize("material", ["metal", rt.Layered([("glass", 0.003)], "water"), rt.Layered([("pet", 0.001)])])
def test_poses_of_a_grid_are_independent(material):
    """With pruning, several frequency nodes and hollow objects too."""
    table = reflection_table.build([(material, 0.0)], 77e9, 80.4e9)
    at = np.random.default_rng(0).normal([1.5, 0, 0], 0.3, (6, 3))
    values = []
    for poses in ([0, 1, 2, 3, 4, 5], [4]):
        hits = tube_hits([objects.cylinder(0.033, 0.12)], table, at[poses], width=WAVELENGTH, options=TraceOptions(3, prune=1e-4))
        assert set(hits.pose) == set(range(len(poses)))
        values.append(coherent(hits, hits.pose == poses.index(4)))
    assert values[0] == pytest.approx(values[1], rel=2e-2)


def test_receivers_of_one_source_see_the_echoes_that_each_sees_alone():
    variant.activate()
    surfaces = objects.plate(3, 3).apply_translation([0.6, 0, 0]), objects.sphere(0.05, 4).apply_translation([0.3, 1.0, 0.0])
    built, table = geometry.build(surfaces), reflection_table.build([("metal", 0.0)] * 2, FREQUENCY)
    target = geometry.build(surfaces[1:])
    source, receivers = np.zeros((3, 3)), np.array([[0.0, 0.2, 0.0], [-0.5, 0.3, 0.1], [0.1, 0.0, 0.4]])
    axis, bounces = np.repeat(UP, 3, axis=0), np.array([2, 1, 2])

    def echoes(rows: np.ndarray) -> np.ndarray:
        grid = tube_grid.towards(target.hull_points(), source[rows], target.centre, WAVELENGTH, (0.25, 0.25))
        assert grid is not None
        transmit, receive = (Antennas(place[rows], axis[rows]) for place in (source, receivers))
        hits = tubes.trace(built, table, grid, transmit, receive, TraceOptions(2, built.surface, 1, bounces=bounces[rows]))
        value = hits.amplitude[:, 0] * np.exp(1j * K * (hits.length_in_m + hits.length_out_m))
        return np.array([value[hits.pose == row].sum() for row in range(len(rows))])

    alone = np.concatenate([echoes(np.array([row])) for row in range(3)])
    assert np.abs(alone).min() > 0
    assert echoes(np.arange(3)) == pytest.approx(alone, rel=1e-4)
