"""Compare the outlines of bodies, and the shadows of movers, with quadrature of Kirchhoff's integral and with geometry."""

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.polynomial.legendre import leggauss

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene import objects
from radartwin.scene.objects.catalogue import catalogue
from radartwin.simulation import geometry
from radartwin.simulation.flat import shadows, silhouette
from radartwin.testbed.object_shape import as_made
from tests.physics import test_shadows as plates

WAVELENGTH = SPEED_OF_LIGHT / Radar.iwr1843("isotropic").center_frequency_hz
K = 2 * np.pi / WAVELENGTH


def skin(*meshes):
    return silhouette.skin(geometry.build(list(meshes)))


def outline(body, viewer):
    """Return the edges (N, 2, 3) of the outline of a body."""
    out = np.empty((silhouette.MAX_SEGMENTS, 2, 3))
    return out[: silhouette.outline(body, np.array(viewer, float), K, out)]


def area(body, distance):
    """Return the area in square metres of an outline seen from the -x axis, projected on the plane x = 0 through the body's middle."""
    edges = outline(body, (-distance, 0, 0))
    flat = edges[..., 1:] * distance / (edges[..., :1] + distance)
    return 0.5 * float((flat[:, 0, 0] * flat[:, 1, 1] - flat[:, 1, 0] * flat[:, 0, 1]).sum())


def one_way(body, source, receiver):
    """Return the factor of the line from a sensor to a point behind a body, which a closed path passes twice."""
    both = shadows.factors(body, np.array([source], float), np.array([[receiver]], float), False, K)[0]
    return np.sqrt(both)


def over_wall(body, wall):
    """Return the factor of the path from the origin to a mirror at x = `wall` and back."""
    return shadows.factors(body, np.zeros((1, 3)), np.array([[[wall, 0, 0]]], float), True, K)[0]


def exact_over_wall(low, high, distance, wall):
    """Return the same factor of a rectangular screen at x = `distance`, by quadrature of the paraxial integral over both passages.

    The screen covers low[i] to high[i] along y and z. The integrals over y and z are factors.
    """
    nodes, weights = leggauss(1200)
    single, double = 1 + 0j, 1 + 0j
    for a, b in zip(low, high, strict=True):
        x, w = 0.5 * (a + b) + 0.5 * (b - a) * nodes, 0.5 * (b - a) * weights
        one = 1 / distance + 1 / (2 * wall - distance)
        single *= (w * np.exp(0.5j * K * one * x * x)).sum() / np.sqrt(2j * np.pi / (K * one))
        ends, between = 1 / distance, 1 / (2 * (wall - distance))
        phase = (x[:, None] ** 2 + x[None] ** 2) * ends + (x[:, None] - x[None]) ** 2 * between
        spread = np.sqrt(ends * (ends + 2 * between))
        double *= (w @ np.exp(0.5j * K * phase) @ w) / (2j * np.pi / (K * spread))
    return 1 - 2 * single + double


@pytest.mark.parametrize("name", plates.SHAPES)
def test_shadow_of_a_plate_matches_quadrature(name):
    shape = 0.4 * np.array(plates.SHAPES[name])
    body, width = skin(plates.traced.polygon(plates.lifted(shape))), np.ptp(shape[:, 0])
    for near, far in ((0.7, 1.0), (1.0, 2.0), (2.0, 2.0)):
        for share in (0.0, 0.25, 0.45, 0.55, 1.0):
            ends = (-near, share * width, 0.004), (far, share * width + 0.02, -0.008)
            exact = plates.exact_shadow(shape, *ends) ** 2
            found = shadows.factors(body, np.array([ends[0]]), np.array([[ends[1]]]), False, K)[0]
            assert abs(found - exact) < 0.05 * max(1, abs(exact))


def test_outline_of_a_box_is_its_nearest_face():
    for distance in (0.5, 2.0):
        body = skin(objects.box([-0.03, -0.05, -0.08], [0.03, 0.05, 0.08]))
        assert area(body, distance) == pytest.approx(0.1 * 0.16 * (distance / (distance - 0.03)) ** 2, rel=1e-4)


def test_outline_of_a_sphere_is_a_circle():
    body = skin(trimesh.creation.icosphere(5, 0.05))
    assert area(body, 1.0) == pytest.approx(np.pi * 0.05**2 / (1 - 0.05**2), rel=3e-3)


def test_outline_counts_overlapping_parts_once_and_leaves_holes_out():
    box = objects.box([-0.03, -0.05, -0.08], [0.03, 0.05, 0.08])
    inside = objects.box([-0.02, -0.03, -0.05], [0.02, 0.03, 0.05])
    beside = objects.box([-0.03, 0.0, -0.02], [0.03, 0.09, 0.02])
    assert area(skin(box, inside), 2.0) == pytest.approx(area(skin(box), 2.0), rel=1e-9)
    assert area(skin(box, beside), 2.0) - area(skin(box), 2.0) == pytest.approx(0.04 * 0.04 * (2 / 1.97) ** 2, rel=0.02)
    ring = trimesh.creation.annulus(0.03, 0.05, 0.01)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    assert area(skin(ring), 2.0) == pytest.approx(np.pi * (0.05**2 - 0.03**2), rel=0.02)


def test_open_meshes_hide_from_both_sides():
    """Two plates of a corner reflector overlap in the picture, and the third one faces away."""
    corner = objects.trihedral(0.1)
    corner.apply_translation(-corner.bounds.mean(axis=0))
    flat = trimesh.Trimesh(corner.vertices, corner.faces[:, ::-1], process=False)
    assert area(skin(corner), 2.0) == pytest.approx(area(skin(flat), 2.0), rel=1e-9)
    assert area(skin(corner), 2.0) > 0.0049  # the plate across the view


def test_shadow_does_not_depend_on_the_facets():
    """A column of 64 sides has the same shadow with divided faces, and nearly that of a column of 1,024 sides."""
    coarse, fine = (trimesh.creation.cylinder(0.033, 0.1, sections=n) for n in (64, 1024))
    divided = coarse.subdivide().subdivide()
    for mesh in (coarse, divided, fine):
        mesh.apply_translation((1, 0.01, 0.02))
    for wall in (1.5, 2.5):
        values = [over_wall(skin(mesh), wall) for mesh in (coarse, divided, fine)]
        assert values[1] == pytest.approx(values[0], abs=1e-3)
        assert values[2] == pytest.approx(values[0], abs=0.01)


@pytest.mark.parametrize("name", ["can_211_300", "mustard", "mug"])
def test_shadow_of_an_object_as_made_is_that_of_its_picture(name):
    """The factor of a line agrees with quadrature over a picture of the object, which holds the object's triangles one by one."""
    mesh: Any = trimesh.util.concatenate([s.mesh for s in as_made(catalogue()[name], 1.0, np.random.default_rng(3))])
    mesh.apply_translation((1.0, 0.0, -mesh.bounds[:, 2].mean()))
    body = skin(mesh)
    pixel = 0.25e-3
    grid = np.arange(-0.1, 0.1, pixel) + pixel / 2
    covered = np.zeros((len(grid), len(grid)), bool)
    for triangle in mesh.triangles:
        flat = triangle[:, 1:] / triangle[:, :1]
        low, high = np.searchsorted(grid, flat.min(axis=0)), np.searchsorted(grid, flat.max(axis=0))
        y, z = np.meshgrid(grid[low[0] : high[0]], grid[low[1] : high[1]], indexing="ij")
        a, b = flat[1] - flat[0], flat[2] - flat[0]
        size = a[0] * b[1] - a[1] * b[0]
        if abs(size) < 1e-12 or not y.size:
            continue
        u = ((y - flat[0, 0]) * b[1] - (z - flat[0, 1]) * b[0]) / size
        v = ((z - flat[0, 1]) * a[0] - (y - flat[0, 0]) * a[1]) / size
        covered[low[0] : high[0], low[1] : high[1]] |= (u >= 0) & (v >= 0) & (u + v <= 1)
    y, z = (x[covered] for x in np.meshgrid(grid, grid, indexing="ij"))
    for aside in (0.0, 0.04, 0.1):
        receiver = np.array([2.5, aside, 0.02])
        to, back = np.sqrt(1 + y**2 + z**2), np.sqrt(1.5**2 + (y - receiver[1]) ** 2 + (z - receiver[2]) ** 2)
        whole = np.linalg.norm(receiver)
        dark = (np.exp(1j * K * (to + back - whole)) / (to * back)).sum() * pixel**2 * whole / (1j * WAVELENGTH)
        exact = (1 - dark) ** 2
        found = shadows.factors(body, np.zeros((1, 3)), receiver[None, None], False, K)[0]
        assert abs(found - exact) < 0.06 * max(1, abs(exact))


@pytest.mark.parametrize(("size", "limit"), [((0.03, 0.03), 0.025), ((0.0686, 0.076), 0.11), ((0.1, 0.1), 0.14)])
def test_shadow_on_both_passages_of_a_path_matches_quadrature(size, limit):
    """The path to a wall behind the body and back passes the body twice. Edge waves of the first passage meet the second one."""
    for distance, wall, aside in ((1.0, 2.5, (0.0, 0.0)), (1.0, 2.5, (0.02, 0.01)), (1.0, 2.5, (0.05, 0.0)), (0.5, 3.0, (0.0, 0.0))):
        low, high = (np.array(aside) + s * np.array(size) / 2 for s in (-1, 1))
        plate = objects.box([distance - 5e-5, *low], [distance + 5e-5, *high])
        assert abs(over_wall(skin(plate), wall) - exact_over_wall(low, high, distance, wall)) < limit


def test_shadow_is_reciprocal_on_lines_to_the_sensor():
    """Both directions of a path over two mirrors have the same factor, although the body is thick."""
    body = skin(objects.box([0.8, -0.05, -0.06], [1.2, 0.05, 0.06]))
    points = np.array([[2.5, 0.04, 0.0], [2.5, 1.5, 0.3]])
    there, back = (shadows.factors(body, np.zeros((1, 3)), way[None], False, K)[0] for way in (points, points[::-1]))
    assert there == pytest.approx(back, abs=1e-3)
    assert abs(there - 1) > 0.1


def test_bodies_behind_either_end_hide_nothing():
    for x in (-1.5, 4.0):
        body = skin(objects.box([x - 0.1, -0.3, -0.3], [x + 0.1, 0.3, 0.3]))
        assert one_way(body, (0, 0.01, 0.02), (2, 0.01, 0.02)) == pytest.approx(1, abs=1e-6)
    aside = skin(objects.box([0.9, 1.0, -0.3], [1.1, 1.3, 0.3]))
    assert one_way(aside, (0, 0.01, 0.02), (2, 0.01, 0.02)) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("bars", [20, 60])
def test_outline_of_a_fence_has_the_area_of_its_bars(bars):
    """More bars than MAX_INTERVALS hide at least as much as their own area, and at most as much as the closed gaps beside them."""
    fence = [objects.box([-0.002, y, -0.1], [0.002, y + 0.002, 0.1]) for y in 0.01 * (np.arange(bars) - bars / 2)]
    exact = bars * 0.002 * 0.2
    assert 0.95 * exact < area(skin(*fence), 2.0) < (1.2 * exact if bars < silhouette.MAX_INTERVALS else 0.2 * 0.01 * bars)
    assert len(outline(skin(*fence), (-2, 0, 0))) <= silhouette.MAX_SEGMENTS


def test_outline_is_whole_if_a_face_is_seen_edge_on():
    """The viewer is in the plane of a side of a turned box, so that rounding decides whether it sees this side."""
    rng = np.random.default_rng(5)
    for _ in range(100):
        size, yaw = rng.uniform(0.05, 0.3, 3), rng.uniform(0, 2 * np.pi)
        box = trimesh.creation.box(size)
        box.apply_transform(trimesh.transformations.rotation_matrix(yaw, [0, 0, 1]))
        turn = np.array(trimesh.transformations.rotation_matrix(yaw, [0, 0, 1]))[:3, :3]
        viewer = turn @ [-1.5, size[1] / 2, 0.1]
        aside = turn @ [-1.5, size[1] / 2 + 1e-4, 0.1]
        found = [len(outline(skin(box), place)) for place in (viewer, aside)]
        assert min(found) > 0
        factor = [one_way(skin(box), place, turn @ [1.0, 0.0, 0.0]) for place in (viewer, aside)]
        assert factor[0] == pytest.approx(factor[1], abs=0.02)


def test_open_meshes_with_opposite_windings_have_one_outline():
    """Two triangles of separate surfaces share an edge, along which they are folded."""
    corners = np.array([[0, 0, -0.1], [0, 0, 0.1], [0.1, 0.15, 0], [-0.1, 0.15, 0]], float)
    areas = [area(skin(trimesh.Trimesh(corners, [[0, 1, 2]]), trimesh.Trimesh(corners, [way])), 2.0) for way in ([0, 1, 3], [1, 0, 3])]
    assert areas[0] == pytest.approx(areas[1], rel=1e-6)
    assert areas[0] > 0.01


def test_shadow_is_continuous_where_an_edge_ends_behind_the_sensor():
    """The lines pass close to the vertical edge of a wide box. The far ends of the box are behind the sensor."""
    body = skin(objects.box([-0.2, 0.3, -0.5], [0.2, 0.4, 0.5]))
    values = [one_way(body, (0, 0, 0), (-1.04 + step, 1.51, -1.77)) for step in np.linspace(-0.1, 0.1, 41)]
    assert np.abs(np.diff(np.square(values))).max() < 0.15
    assert max(np.abs(values)) > 0.5 > min(np.abs(values))


def test_parts_behind_the_sensor_hide_nothing():
    front, behind = objects.box([1.0, -0.1, -0.1], [1.01, 0.1, 0.1]), objects.box([-0.71, -0.1, -0.1], [-0.7, 0.1, 0.1])
    alone, both = (one_way(skin(*meshes), (0, 0, 0), (2, 0.2, 0)) for meshes in ((front,), (front, behind)))
    assert both == pytest.approx(alone, abs=1e-6)
    assert one_way(skin(front, behind), (0, 0, 0), (0.05, 0.02, 1.5)) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("axis", [1, 2])
def test_path_exactly_over_an_edge_keeps_a_quarter(axis):
    """One half of the field remains on each of both ways, also if the path hits the edge of a body exactly."""
    low, high = np.array([-0.1, -3, -3.0]), np.array([0.1, 3, 3.0])
    high[axis] = 0.0
    for mesh in (objects.box(low.tolist(), high.tolist()), objects.plate(3.0, 3.0).apply_translation(-1.5 * np.eye(3)[axis])):
        found = shadows.factors(skin(mesh), np.array([[-2.0, 0, 0]]), np.array([[[2.0, 0, 0]]]), False, K)[0]
        assert found == pytest.approx(0.25, abs=0.03)


def test_path_exactly_over_a_corner_is_that_of_its_neighbours():
    high, sensor = np.array([0.1, 0.05, 0.07]), np.array([-2.0, 0.1, 0.05])
    corners = high * np.stack(np.meshgrid(*[(-1, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    body, ends = skin(objects.box((-high).tolist(), high.tolist())), sensor + 2 * (corners - sensor)
    exactly, *aside = (
        shadows.factors(body, np.tile(sensor + offset, (8, 1)), ends[:, None], False, K)
        for offset in 1e-4 * np.array([(0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
    )
    assert np.abs(np.array(aside) - exactly).max() < 0.01


def test_equal_rows_are_evaluated_once():
    rows = np.random.default_rng(0).random((50, 9))
    rows[:, 6:] = np.nan
    order = np.random.default_rng(1).integers(0, 50, 200)
    first, which = shadows.distinct(rows[order])
    assert len(first) == len(np.unique(order))
    assert np.array_equal(rows[order][first][which], rows[order], equal_nan=True)
