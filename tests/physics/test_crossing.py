"""Check waves that cross panes against an independent transfer matrix: tables, polarisation, counts of panes, and simulated echoes."""

import numpy as np
import pytest
from panes import PANES, C, transmitted
from physics_helpers import FREQUENCY, UP, WAVELENGTH, coherent

from radartwin.materials import Layered, common_sheet
from radartwin.scene import objects
from radartwin.scene.trajectories.trajectory import pose
from radartwin.simulation import geometry, reflection_table, variant
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.curved.hits import Antennas, TraceOptions
from radartwin.simulation.flat import crossing, obstacles

LOW_HZ, HIGH_HZ = 77e9, 80.44e9


@pytest.mark.parametrize("name", PANES)
def test_transmission_tables_agree_with_the_transfer_matrix_over_angle_and_sweep(name):
    """The interpolated tables have the transmission of four crossings within 0.01, relative to the incident field."""
    table = reflection_table.build([("metal", 0.0), (Layered(PANES[name]), 0.0)], LOW_HZ, HIGH_HZ)
    assert list(table.opaque) == [True, False]
    f = np.linspace(LOW_HZ, HIGH_HZ, 23)
    basis = reflection_table.lagrange_basis(table.frequencies_hz, f)
    for cosine in (1.0, 0.8, 0.5, 0.2):
        last = table.te.shape[1] - 1
        index = round(cosine * last)
        exact = np.array([transmitted(PANES[name], index / last, one) for one in f]).T
        for values, expected in zip((table.through_te, table.through_tm), exact, strict=True):
            assert np.abs(values[1, index] @ basis - expected).max() < 4e-3
            assert np.abs(values[1, index] ** 4 @ basis - expected**4).max() < 1e-2


def test_the_frequency_nodes_carry_the_delay_of_a_pane():
    """The phase of the transmission of 6 mm glass over the sweep is that of the 9 mm by which glass lengthens the path."""
    table = reflection_table.build([("glass", 0.0)], LOW_HZ, HIGH_HZ)
    f = np.linspace(60e9, 90e9, 3001)  # a mean over many fringes of the sheet
    exact = np.array([transmitted([("glass", 0.006)], 1.0, one)[0] for one in f])
    slope = -np.polyfit(f, np.unwrap(np.angle(exact)), 1)[0] * C / (2 * np.pi)
    assert slope == pytest.approx(0.006 * (np.sqrt(6.31) - 1), rel=0.02)
    f = np.linspace(LOW_HZ, HIGH_HZ, 41)
    ours = table.through_te[0, -1] @ reflection_table.lagrange_basis(table.frequencies_hz, f)
    exact = np.array([transmitted([("glass", 0.006)], 1.0, one)[0] for one in f])
    assert np.abs(np.angle(ours / exact)).max() < 0.01


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


def passing(triangles, labels, materials, end, unit, start=(0.0, 0.0, 0.0), ways=1, frequency=LOW_HZ):
    """Return panes and factor of one line at one frequency."""
    table = reflection_table.build([(material, 0.0) for material in materials], frequency)
    tree = obstacles.build(np.concatenate(triangles), np.concatenate([np.full(len(t), k) for t, k in zip(triangles, labels, strict=True)]))
    panes, factor = crossing.factors(tree, table, *(np.array([v], float) for v in (start, end, unit)), ways=ways)
    return panes[0], factor[0, 0]


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


def test_panes_multiply_seams_count_once_and_opaque_surfaces_block():
    glass, up, end = Layered(PANES["glass 6 mm"]), [0, 0, 1.0], [2.0, 0, 0]
    once = transmitted(PANES["glass 6 mm"], 1.0, LOW_HZ)[0]
    panes, factor = passing([sheet(0.5)], [0], [glass], end, up)
    assert panes == 2, "the line hits the common side of two triangles"
    assert factor == pytest.approx(once, abs=1e-6)
    # two sheets of one surface, two surfaces, and two surfaces at one place
    for triangles, labels in (([sheet(0.5), sheet(0.8)], [0, 0]), ([sheet(0.5), sheet(0.8)], [0, 1]), ([sheet(0.5), sheet(0.5)], [0, 1])):
        _, factor = passing(triangles, labels, [glass, glass], end, up)
        assert factor == pytest.approx(once**2, abs=1e-6)
    box = np.asarray(objects.box([0.5, -1, -1], [0.52, 1, 1]).triangles)
    assert passing([box], [0], [glass], end, up)[1] == pytest.approx(once**2, abs=1e-6), "a closed box has two walls"
    for materials, expected in ((["metal", glass], (-1, 0)), (["concrete", glass], (-1, 0)), ([glass, "metal"], (-1, 0))):
        assert passing([sheet(0.5), sheet(0.8)], [0, 1], materials, end, up) == expected
    assert passing([sheet(3.0)], [0], [glass], end, up) == (0, 1)
    assert passing([sheet(2.0)], [0], [glass], end, up) == (0, 1), "the line ends on the sheet"
    many = [sheet(0.1 * k) for k in range(1, obstacles.MAX_PANES + 2)]
    assert passing(many, range(len(many)), [glass] * len(many), end, up)[0] == -1


def turned(angle_deg, axis):
    """Return the rotation by an angle about the y axis (1) or the z axis (2)."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) if axis == 1 else np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def tube_echo(panes, end=None, frequency=FREQUENCY, cross=False, bounces=1):
    """Return the field of a metal plate at the origin, seen from x = 2 m through panes given as (mesh, layers), by ray tubes."""
    variant.activate()
    built = geometry.build([objects.plate(0.05, 0.05), *(mesh for mesh, _ in panes)])
    table = reflection_table.build([("metal", 0.0), *((Layered(layers), 0.0) for _, layers in panes)], frequency)
    start = np.array([[2.0, 0.0, 0.0]])
    end = start if end is None else np.array([end])
    grid = tube_grid.towards(built.hull_points(), start, built.centre, WAVELENGTH / 4, built.grid_shift)
    assert grid is not None
    hits = tubes.trace(built, table, grid, Antennas(start, UP, cross), Antennas(end, UP, cross), TraceOptions(bounces, pieces=3))
    return coherent(hits, hits.first_m > 1.9)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 60.0])
@pytest.mark.parametrize("name", PANES)
def test_tubes_reach_a_plate_behind_a_pane(name, angle_deg):
    """The echo of the plate behind a pane over its echo in free space is the squared transmission, in both polarisations."""
    for axis, cross in ((2, False), (2, True), (1, False)):
        pane = objects.plate(0.3, 0.3).apply_transform(pose([0.4, 0.0, 0.0], turned(angle_deg, axis)))
        te, tm = transmitted(PANES[name], np.cos(np.radians(angle_deg)), FREQUENCY)
        expected = np.conj((te if (axis == 2) != cross else tm) ** 2)
        ratio = tube_echo([(pane, PANES[name])], cross=cross) / tube_echo([], cross=cross)
        assert 20 * np.log10(abs(ratio / expected)) == pytest.approx(0, abs=0.3)
        assert np.angle(ratio / expected) == pytest.approx(0, abs=0.05)


def test_tubes_cross_several_panes_and_stop_at_opaque_ones():
    panes = [objects.plate(0.2, 0.2).apply_translation([0.3 + 0.1 * k, 0, 0]) for k in range(5)]
    hdpe = PANES["HDPE 2 mm"]
    once = np.conj(transmitted(hdpe, 1.0, FREQUENCY)[0])
    alone = tube_echo([])
    for count in (1, 2, 4):
        assert tube_echo([(pane, hdpe) for pane in panes[:count]]) / alone == pytest.approx(once ** (2 * count), rel=0.02)
    assert tube_echo([(pane, hdpe) for pane in panes]) == 0, "five panes are too many"
    assert tube_echo([(panes[0], hdpe), (panes[1], [("metal", 1e-3)])]) == 0
    bistatic = [1.99, 0.05, 0.0]
    assert tube_echo([(panes[0], hdpe)], end=bistatic) / tube_echo([], end=bistatic) == pytest.approx(once**2, rel=0.02)
