"""Outlines of bodies, and shadows of movers, against quadrature of Kirchhoff's integral and geometry."""

from typing import Any

import numpy as np
import pytest
import trimesh
from physics_helpers import picture

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
    out, count = np.empty((1, silhouette.MAX_SEGMENTS, 2, 3)), np.zeros(1, int)
    shadows._outlines(0, 1, body, np.array([viewer], float), K, out, count)
    return out[0, : count[0]]


def area(body, distance):
    """Return the area in square metres of an outline seen from the -x axis, projected on the plane x = 0 through the body's middle."""
    edges = outline(body, (-distance, 0, 0))
    flat = edges[..., 1:] * distance / (edges[..., :1] + distance)
    return 0.5 * float((flat[:, 0, 0] * flat[:, 1, 1] - flat[:, 1, 0] * flat[:, 0, 1]).sum())


def one_way(body, source, receiver):
    """Return the factor of the line from a sensor to a point behind a body, which a closed path passes twice."""
    both = shadows.factors(body, np.array([source], float), np.array([[receiver]], float), False, K)[0]
    return np.sqrt(both)


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


def test_outline_counts_overlapping_parts_once_and_leaves_holes_out():
    box = objects.box([-0.03, -0.05, -0.08], [0.03, 0.05, 0.08])
    inside = objects.box([-0.02, -0.03, -0.05], [0.02, 0.03, 0.05])
    beside = objects.box([-0.03, 0.0, -0.02], [0.03, 0.09, 0.02])
    assert area(skin(box), 2.0) == pytest.approx(0.1 * 0.16 * (2 / 1.97) ** 2, rel=1e-4)
    assert area(skin(box, inside), 2.0) == pytest.approx(area(skin(box), 2.0), rel=1e-9)
    assert area(skin(box, beside), 2.0) - area(skin(box), 2.0) == pytest.approx(0.04 * 0.04 * (2 / 1.97) ** 2, rel=0.02)
    ring = trimesh.creation.annulus(0.03, 0.05, 0.01)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    assert area(skin(ring), 2.0) == pytest.approx(np.pi * (0.05**2 - 0.03**2), rel=0.02)


def test_shadow_of_an_object_as_made_is_that_of_its_picture():
    """The factor of a line agrees with quadrature over a picture of the object, which holds the object's triangles one by one."""
    mesh: Any = trimesh.util.concatenate([s.mesh for s in as_made(catalogue()["mug"], 1.0, np.random.default_rng(3))])
    mesh.apply_translation((1.0, 0.0, -mesh.bounds[:, 2].mean()))
    body, pixel = skin(mesh), 0.25e-3
    screen, *axes = picture(mesh, 1.0, pixel)
    y, z = (x[screen > 0] for x in np.meshgrid(*axes, indexing="ij"))
    for aside in (0.0, 0.04, 0.1):
        receiver = np.array([2.5, aside, 0.02])
        to, back = np.sqrt(1 + y**2 + z**2), np.sqrt(1.5**2 + (y - receiver[1]) ** 2 + (z - receiver[2]) ** 2)
        whole = np.linalg.norm(receiver)
        dark = (np.exp(1j * K * (to + back - whole)) / (to * back)).sum() * pixel**2 * whole / (1j * WAVELENGTH)
        exact = (1 - dark) ** 2
        found = shadows.factors(body, np.zeros((1, 3)), receiver[None, None], False, K)[0]
        assert abs(found - exact) < 0.06 * max(1, abs(exact))


def test_shadow_is_reciprocal_on_lines_to_the_sensor():
    """Both directions of a path over two mirrors have the same factor, although the body is thick."""
    body = skin(objects.box([0.8, -0.05, -0.06], [1.2, 0.05, 0.06]))
    points = np.array([[2.5, 0.04, 0.0], [2.5, 1.5, 0.3]])
    there, back = (shadows.factors(body, np.zeros((1, 3)), way[None], False, K)[0] for way in (points, points[::-1]))
    assert there == pytest.approx(back, abs=1e-3)
    assert abs(there - 1) > 0.1


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
    assert one_way(skin(behind), (0, 0, 0), (2, 0.2, 0)) == pytest.approx(1, abs=1e-6)
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
