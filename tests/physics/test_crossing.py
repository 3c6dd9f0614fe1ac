"""Waves that cross panes against an independent transfer matrix: tables, counts of panes, tubes, rooms, points and simulations."""

from functools import cache

import numpy as np
import pytest
from panes import PANES, C, transmitted
from physics_helpers import FREQUENCY, coherent, tube_hits

import radartwin as rt
from radartwin.materials import Layered, common_sheet
from radartwin.scene import objects
from radartwin.scene.rooms import rectangle
from radartwin.scene.trajectories.trajectory import pose
from radartwin.simulation import diffuse, geometry, reflection_table, variant
from radartwin.simulation.backends.static_scene import StaticScene
from radartwin.simulation.flat import crossing, obstacles

LOW_HZ, HIGH_HZ = 77e9, 80.44e9
SWEEP_HZ = np.linspace(LOW_HZ, HIGH_HZ, 23)


@pytest.mark.parametrize("name", PANES)
def test_transmission_tables_agree_with_the_transfer_matrix_over_angle_and_sweep(name):
    table = reflection_table.build([("metal", 0.0), (Layered(PANES[name]), 0.0)], LOW_HZ, HIGH_HZ)
    assert list(table.opaque) == [True, False]
    basis = reflection_table.lagrange_basis(table.frequencies_hz, SWEEP_HZ)
    for cosine in (1.0, 0.8, 0.5, 0.2):
        last = table.te.shape[1] - 1
        index = round(cosine * last)
        exact = np.array([transmitted(PANES[name], index / last, one) for one in SWEEP_HZ]).T
        for values, expected in zip((table.through_te, table.through_tm), exact, strict=True):
            assert np.abs(values[1, index] @ basis - expected).max() < 4e-3
            assert np.abs(values[1, index] ** 4 @ basis - expected**4).max() < 1e-2


def test_half_spaces_backed_stacks_metal_and_thick_walls_are_opaque():
    entries = ["concrete", "metal", Layered([], backing="glass"), Layered([("glass", 0.004)], backing="metal"), Layered([("metal", 1e-3)])]
    table = reflection_table.build([(entry, 0.0) for entry in [*entries, Layered([("concrete", 0.2)])]], LOW_HZ, HIGH_HZ)
    assert table.opaque.all()
    assert not table.through_te.any()
    assert not table.through_tm.any()
    names = ("door", "stud wall", "fabric", "double glazing")
    assert not reflection_table.build([(common_sheet(name), 0.0) for name in names], LOW_HZ, HIGH_HZ).opaque.any()


def sheet(x, y=(-5.0, 5.0), z=(-5.0, 5.0)):
    """Return two triangles of a rectangle in the plane x, whose common side goes through the point (x, 0, 0)."""
    a, b, c, d = ([x, y[i], z[j]] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.array([[a, b, c], [a, c, d]])


def passing(triangles, labels, materials, end=(2.0, 0, 0), unit=(0, 0, 1.0), start=(0, 0, 0), ways=1):
    """Return panes and factor of one line at one frequency; `unit` is the direction of the field at its start."""
    table = reflection_table.build([(material, 0.0) for material in materials], LOW_HZ)
    tree = obstacles.build(np.concatenate(triangles), np.concatenate([np.full(len(t), k) for t, k in zip(triangles, labels, strict=True)]))
    panes, factor = crossing.factors(tree, table, *(np.array([v], float) for v in (start, end, unit)), ways=ways)
    return panes[0], factor[0, 0]


def test_panes_multiply_seams_count_once_and_opaque_surfaces_block():
    glass = Layered(PANES["glass 6 mm"])
    once = transmitted(PANES["glass 6 mm"], 1.0, LOW_HZ)[0]
    panes, factor = passing([sheet(0.5)], [0], [glass])
    assert panes == 2, "the line hits the common side of two triangles"
    assert factor == pytest.approx(once, abs=1e-6)
    # two sheets of one surface, two surfaces, and two surfaces at one place
    for triangles, labels in (([sheet(0.5), sheet(0.8)], [0, 0]), ([sheet(0.5), sheet(0.8)], [0, 1]), ([sheet(0.5), sheet(0.5)], [0, 1])):
        _, factor = passing(triangles, labels, [glass, glass])
        assert factor == pytest.approx(once**2, abs=1e-6)
    box = np.asarray(objects.box([0.5, -1, -1], [0.52, 1, 1]).triangles)
    assert passing([box], [0], [glass])[1] == pytest.approx(once**2, abs=1e-6), "a closed box has two walls"
    for materials, expected in ((["metal", glass], (-1, 0)), (["concrete", glass], (-1, 0)), ([glass, "metal"], (-1, 0))):
        assert passing([sheet(0.5), sheet(0.8)], [0, 1], materials) == expected
    assert passing([sheet(3.0)], [0], [glass]) == (0, 1)
    assert passing([sheet(2.0)], [0], [glass]) == (0, 1), "the line ends on the sheet"
    many = [sheet(0.1 * k) for k in range(1, obstacles.MAX_PANES + 2)]
    assert passing(many, range(len(many)), [glass] * len(many))[0] == -1


def turned(angle_deg, axis):
    """Return the rotation by an angle about the y axis (1) or the z axis (2)."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) if axis == 1 else np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@cache
def free_echo(cross=False, end=None):
    return tube_echo([], end, cross)


def tube_echo(panes, end=None, cross=False):
    """Return the field of a metal plate at the origin, seen from x = 2 m through panes given as (mesh, layers), by ray tubes."""
    table = reflection_table.build([("metal", 0.0), *((Layered(layers), 0.0) for _, layers in panes)], FREQUENCY)
    ends = np.array([[[2.0, 0.0, 0.0]], [end or [2.0, 0.0, 0.0]]])
    hits = tube_hits([objects.plate(0.05, 0.05), *(mesh for mesh, _ in panes)], table, *ends, cross=cross)
    return coherent(hits, hits.first_m > 1.9)


@pytest.mark.parametrize("angle_deg", [0.0, 60.0])
@pytest.mark.parametrize("name", PANES)
def test_tubes_reach_a_plate_behind_a_pane(name, angle_deg):
    """The echo of the plate behind a pane over its echo in free space is the squared transmission, in both polarisations."""
    for axis, cross in ((2, False), (2, True), (1, False)):
        pane = objects.plate(0.3, 0.3).apply_transform(pose([0.4, 0.0, 0.0], turned(angle_deg, axis)))
        te, tm = transmitted(PANES[name], np.cos(np.radians(angle_deg)), FREQUENCY)
        expected = np.conj((te if (axis == 2) != cross else tm) ** 2)
        ratio = tube_echo([(pane, PANES[name])], cross=cross) / free_echo(cross)
        assert 20 * np.log10(abs(ratio / expected)) == pytest.approx(0, abs=0.3)
        assert np.angle(ratio / expected) == pytest.approx(0, abs=0.05)


def test_tubes_cross_several_panes_and_stop_at_opaque_ones():
    panes = [objects.plate(0.2, 0.2).apply_translation([0.3 + 0.1 * k, 0, 0]) for k in range(5)]
    hdpe = PANES["HDPE 2 mm"]
    once = np.conj(transmitted(hdpe, 1.0, FREQUENCY)[0])
    for count in (1, 2, 4):
        assert tube_echo([(pane, hdpe) for pane in panes[:count]]) / free_echo() == pytest.approx(once ** (2 * count), rel=0.02)
    assert tube_echo([(pane, hdpe) for pane in panes]) == 0, "five panes are too many"
    assert tube_echo([(panes[0], hdpe), (panes[1], [("metal", 1e-3)])]) == 0
    bistatic = (1.99, 0.05, 0.0)
    assert tube_echo([(panes[0], hdpe)], end=bistatic) / free_echo(end=bistatic) == pytest.approx(once**2, rel=0.02)


def room_paths(surfaces, poses=None, bounces=1, prune=1e-4):
    """Return the paths of a room of flat faces, given as (mesh, material), at sensor poses (F, 4, 4)."""
    poses = np.eye(4)[None] if poses is None else poses
    radar = rt.Radar.iwr1843(element="isotropic")
    table = reflection_table.build([(material, 0.0) for _, material in surfaces], LOW_HZ, HIGH_HZ)
    things = [rt.Surface(mesh, material, f"thing {i}", role="room") for i, (mesh, material) in enumerate(surfaces)]
    static = StaticScene(things, geometry.build([mesh for mesh, _ in surfaces]), table)
    return static.room.paths(poses, np.zeros((len(poses), 3)), radar, prune, static.room.searched(poses, radar, bounces, prune))


def swept(parts, low_m, high_m):
    """Return the sum of the paths between two lengths at the frequencies SWEEP_HZ."""
    total = np.zeros(len(SWEEP_HZ), complex)
    for part in parts:
        some = (part.length_m > low_m) & (part.length_m < high_m)
        amplitude = part.amplitude[some] @ reflection_table.lagrange_basis(part.frequencies_hz, SWEEP_HZ)
        total += (amplitude * np.exp(2j * np.pi * SWEEP_HZ / C * part.length_m[some, None])).sum(axis=0)
    return total


@pytest.mark.parametrize("angle_deg", [0.0, 60.0])
@pytest.mark.parametrize("name", PANES)
def test_a_wall_behind_a_pane_returns_the_squared_transmission_over_the_sweep(name, angle_deg):
    """The sensor is upright, and rolled by 90 degrees."""
    wall = objects.plate(3.0, 3.0).apply_transform(pose([3.0, 0.0, 0.0])), "metal"
    pane = objects.plate(2.5, 2.5).apply_transform(pose([1.5, 0.0, 0.0], turned(angle_deg, 2))), Layered(PANES[name])
    exact = np.array([transmitted(PANES[name], np.cos(np.radians(angle_deg)), one) for one in SWEEP_HZ]).T
    for kind, axes in enumerate((np.eye(3), np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))):
        ratio, alone = (swept(room_paths(things, pose([0, 0, 0], axes)[None])[:1], 5.9, 6.1) for things in ([wall, pane], [wall]))
        ratio /= alone
        expected = np.conj(exact[kind] ** 2)
        assert np.abs(20 * np.log10(np.abs(ratio / expected))).max() < 0.3
        assert np.abs(np.angle(ratio / expected)).max() < 0.03


def test_edges_of_panes_join_the_field_beside_them_to_that_behind_them():
    """A metal wall at 3 m is seen past the side of a pane at 1 m. While the sensor moves across, the sum of all paths over the wall changes
    without a jump, and a sheet of 0.1 um changes it by at most 0.012. The mirror paths alone jump by 1 - T^2.
    """
    y, z = -np.eye(3)[1], np.eye(3)[2]
    wall = rectangle([3, 2, -2], y, z, (4, 4)), "metal"
    poses = np.tile(np.eye(4), (41, 1, 1))
    poses[:, 1, 3] = np.arange(-20, 21) * 4e-4 + 1.3e-4
    poses[:, 2, 3] = 0.4

    def seen(material, every=True):
        things = [wall] if material is None else [wall, (rectangle([1, 2, -1.5], y, z, (2, 3)), material)]
        parts = room_paths(things, poses, 3)
        out = np.zeros(len(poses), complex)
        for part in parts if every else parts[:1]:
            some = (part.length_m > 5.5) & (part.length_m < 6.6)
            middle = part.amplitude[some, len(part.frequencies_hz) // 2]
            k = 2 * np.pi * part.frequencies_hz.mean() / C
            np.add.at(out, part.pose[some], middle * np.exp(1j * k * (part.length_m[some] - 6)))
        return out

    alone = seen(None)
    for name in ("HDPE 2 mm", "wood 8 mm"):
        jump, sharp = (np.abs(np.diff(seen(Layered(PANES[name]), every) / alone)).max() for every in (True, False))
        assert jump < 0.025
        assert sharp > 0.8
    # far from its mirror direction, the wedge takes the reflection at grazing incidence, which is -1 even for the thinnest sheet
    assert np.abs(seen(Layered([("hdpe", 1e-7)])) / alone - 1).max() < 0.012


@pytest.mark.parametrize("name", ["plasterboard 15 mm", "double glazing"])
def test_diffuse_points_behind_a_pane_have_the_squared_transmission_and_its_delay(name):
    variant.activate()
    radar = rt.Radar.iwr1843(element="isotropic")
    plate = rt.Surface(objects.plate(0.4, 0.4).apply_transform(pose([3.0, 0.0, 0.0])), "metal", "plate", 0.3e-3)

    def found(*panes):
        surfaces = [plate, *(rt.Surface(objects.plate(2, 2).apply_transform(pose([1.5, 0.0, 0.0])), pane, "pane") for pane in panes)]
        built = geometry.build([surface.mesh for surface in surfaces])
        strength = diffuse.strengths(surfaces, radar)
        return diffuse.paths(diffuse.cloud(surfaces, built, 300), strength, built, radar, np.eye(4)[None]), strength.frequency_hz

    (alone, middle), (behind, _) = found(), found(Layered(PANES[name]))
    assert len(alone) == len(behind) > 100
    cosine = alone.departure[:, 0]
    checks = [(middle, 0.02)]
    if name != "double glazing":  # one frequency node does not hold the ripple of two panes over the sweep
        checks += [(middle - 1e9, 0.2), (middle + 1e9, 0.2)]
    for f, limit in checks:
        exact = np.array([transmitted(PANES[name], c, f)[0] ** 2 for c in cosine])
        turn = np.exp(2j * np.pi * f / C * (behind.length_m - alone.length_m))
        assert np.abs(behind.amplitude[:, 0] / alone.amplitude[:, 0] * turn / exact.conj() - 1).max() < limit
    assert not len(found(Layered([], backing="glass"))[0])


@pytest.mark.parametrize("material", [Layered(PANES["glass 6 mm"]), "concrete"])
def test_a_simulated_plate_behind_a_wall_of_glass_is_heard(material):
    """With ray tubes in all directions."""
    radar = rt.Radar.iwr1843(element="isotropic")
    plate = rt.Surface(objects.plate(0.08, 0.08).apply_transform(pose([2.0, 0.0, 0.0], turned(180, 2))), "metal", "plate", role="object")
    pane = rt.Surface(objects.plate(1.0, 1.0).apply_transform(pose([0.8, 0.0, 0.0], turned(20, 2))), material, "pane", role="room")
    f = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(256) / radar.sample_rate_hz
    window = np.hanning(256) * np.exp(-2j * np.pi * np.outer(np.linspace(3.9, 4.1, 201), f) / C)
    alone, behind = (
        np.abs(window @ rt.simulate(rt.Scene(things), radar, np.eye(4)[None], rays=100_000).iq[0, 0, 0, 0]).max()
        for things in ([plate], [pane, plate])
    )
    if material == "concrete":
        assert behind < 1e-3 * alone
    else:
        expected = np.mean([abs(transmitted(PANES["glass 6 mm"], np.cos(np.radians(20)), one)[0]) ** 2 for one in f])
        assert 20 * np.log10(behind / alone / expected) == pytest.approx(0, abs=0.5)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 60.0])
@pytest.mark.parametrize("name", PANES)
def test_a_line_through_a_pane_has_the_transmission_of_each_polarisation(name, angle_deg):
    """The field across the plane of incidence has the TE, the field within it the TM coefficient. At 45 degrees between them, the received
    component is their mean, and after two crossings the mean of their squares.
    """
    angle = np.radians(angle_deg)
    end, te, tm = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0, 0, 1.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    expected = np.array(transmitted(PANES[name], np.cos(angle), LOW_HZ))
    for unit, value in ((te, expected[0]), (tm, expected[1]), ((te + tm) / np.sqrt(2), expected.mean())):
        # off the common side of the triangles, and from either end
        for start, stop in ((np.array([0, 0.1, 0.02]), 2 * end + [0, 0.1, 0.02]), (2 * end + [0, 0.1, 0.02], np.array([0, 0.1, 0.02]))):
            panes, factor = passing([sheet(0.5)], [0], [Layered(PANES[name])], stop, unit, start)
            assert panes == 1
            assert factor == pytest.approx(value, abs=1e-4)
    _, factor = passing([sheet(0.5)], [0], [Layered(PANES[name])], 2 * end, (te + tm) / np.sqrt(2), ways=2)
    assert factor == pytest.approx((expected**2).mean(), abs=2e-4)


def test_delay_of_layers_is_the_slope_of_the_phase():
    nodes = 79e9 - 2e9 * np.cos(np.pi * (np.arange(12) + 0.5) / 12)
    rng = np.random.default_rng(0)
    extra, ripple = rng.uniform(0, 0.05, (20, 1)), rng.normal(0, 0.1, (20, 12))
    factor = np.exp(-2j * np.pi * nodes / C * extra + 1j * ripple)
    found = crossing.delayed(factor, nodes, 79e9)[1]
    slope = np.polyfit(2 * np.pi * nodes / C, np.unwrap(np.angle(factor), axis=1).T, 1)[0]
    assert found == pytest.approx(-slope, rel=1e-6)
