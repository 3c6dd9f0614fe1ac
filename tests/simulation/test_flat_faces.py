"""The wedge coefficients, and the faces and edges that are found in meshes."""

import numpy as np
import pytest
import trimesh
from shapely import LineString, Polygon, box, from_wkt, union_all

from radartwin.scene import objects
from radartwin.simulation import geometry
from radartwin.simulation.flat import faces
from radartwin.simulation.flat.wedge import coefficients, half_plane

K = 2 * np.pi / 0.0039


@pytest.mark.parametrize("phi", [0.3, 1.0, np.pi - 0.7, np.pi - 0.7 + 1e-9, 3.5, np.pi + 0.7, 5.0, 6.0])
def test_half_plane_of_metal_is_sommerfelds_solution(phi):
    """The incident, reflected and diffracted fields of a plane wave add up to the exact field, also on both shadow boundaries."""
    phi0, r = 0.7, 0.5
    shadow, mirror_0, mirror_n, *_ = coefficients(phi, phi0, 2.0, K, 1.0, r)
    total = (shadow - mirror_0 - mirror_n) * np.exp(-1j * K * r) / np.sqrt(r)
    total += np.exp(1j * K * r * np.cos(phi - phi0)) if phi <= np.pi + phi0 else 0
    total -= np.exp(1j * K * r * np.cos(phi + phi0)) if phi <= np.pi - phi0 else 0
    steps = [half_plane(2 * np.sqrt(K * r / np.pi) * np.cos((phi - s * phi0) / 2)) for s in (1, -1)]
    exact = steps[0] * np.exp(1j * K * r * np.cos(phi - phi0)) - steps[1] * np.exp(1j * K * r * np.cos(phi + phi0))
    assert abs(total - exact) < 1e-6


def found(*meshes):
    return faces.find(geometry.build(meshes))[0]


def test_inner_corners_of_a_room_diffract_nothing():
    walls = [[[0, 0, 0], [2, 0, 0], [2, 0, 2], [0, 0, 2]], [[0, 0, 0], [0, 2, 0], [0, 2, 2], [0, 0, 2]]]
    corner = found(*(trimesh.Trimesh(wall, [[0, 1, 2], [0, 2, 3]]) for wall in walls))
    common = (np.abs(corner.start[:, :2]).max(axis=1) < 1e-9) & (np.abs(corner.along[:, 2]) > 0.9)
    assert corner.opening[common] == pytest.approx([1.5])  # the outer side only
    assert np.sum(corner.opening == 2) == 6  # free edges


@pytest.mark.parametrize(("first", "second"), [(1e-4, 0), (0.003, 0.003), (0.01, 0.01), (0.005, -0.5)])
def test_perpendicular_plates_with_a_gap_between_them_share_an_edge(first, second):
    """A negative gap: the second plate crosses the plane of the first one. The plates overlap along a part of their common line only."""
    one, two = sheet(box(first, 0, 2, 2), np.eye(4)), sheet(box(second, 0.5, 2, 3), np.eye(4))
    two.vertices = two.vertices[:, [2, 1, 0]]
    of = found(one.apply_transform(TURNED), two.apply_transform(TURNED))
    assert sorted(areas(of)) == pytest.approx(sorted([2 * (2 - first) + 1.5 * first, 2.5 * (2 - second) + 1.5 * max(second, 0)]))
    assert found(one, two.apply_translation([0, 0, 5])).length.sum() == pytest.approx(8 - 2 * first + 9 - 2 * second)


def test_face_remains_whose_overlap_leaves_a_line_too():
    """Two overlapping faces of a scanned floor: their difference is a polygon and a line of 0.1 um, which shapely cannot subtract again."""
    floor = (
        "-.467272 -.7087844, -.5142893 -.6617671, -.5028552 -.6617665, -.5028705 -.3877608, -.5142899 -.3877608, -.4662787 -.3397495, "
        "-.4662787 -.0376196, -.5142899 .0103917, -.4662787 .1544255, -.4662787 .1544256, -.4662786 .1544257, -.5142898 .2024369, "
        "-.5142899 .202437, -.5142898 .202437, -.5028655 .202437, -.5028665 .4764426, -.5142899 .4764426, -.4662787 .5865274, "
        "-.5382143 .7303987, -.5287786 .7303987, -.5287786 1.3081241, 2.4073546 1.3081241, 2.4143801 -.8538311, 2.3473544 -.920857, "
        "-.4232391 -.920857, -.4892908 -.8548051, -.4782814 -.8548051, -.4782814 -.7087844, -.467272 -.7087844"
    )
    strip = (
        "-.5028466264648641 -1.0119078850290733, -.514287826464864 -1.0119057850290731, -.4232390264648608 -.9208570850290803, "
        "2.407129973535099 -1.2449331850290235, -.5028877264648746 -1.2449331850290537, -.5028466264648641 -1.0119078850290733"
    )
    shapes = [from_wkt(f"POLYGON (({ring}))") for ring in (floor, strip)]
    regions = [faces._Region(shape, np.zeros(3), np.eye(3)[:2], np.eye(3)[2], 0, False) for shape in [*shapes, box(-1, -2, 3, 2)]]
    parts = [part for region in faces._without_overlaps(regions, 0.01) for part in faces._parts(region, 0.01)]
    assert sum(part.polygon.area for part in parts) == pytest.approx(16)


def test_gap_closes_beside_a_side_that_crosses_the_line_at_a_small_angle():
    """The side of the first plate is 6 mm from the line at one end, and 0.1 um beyond it at the other end."""
    one, two = sheet(Polygon([(0.006, 0), (-1e-7, 2), (2, 2), (2, 0)]), np.eye(4)), sheet(box(0, 0, 2, 2), np.eye(4))
    two.vertices = two.vertices[:, [2, 1, 0]]
    assert sorted(areas(found(one, two))) == pytest.approx([4, 4])


@pytest.mark.parametrize("shift", [-7e-18, 7e-18])
def test_gap_closes_beside_a_side_that_touches_the_line_but_for_rounding(shift):
    """The ring of the gap is a triangle, and its two corners where the side touches the line differ in the last digit."""
    start, end, size = (1.0004968664408782, -0.04035216139787304, 0), (1.0104967568473455, -0.04035062170122341, 0), 0.0023
    along = np.subtract(end, start)
    length = float(np.linalg.norm(along))
    x, y = np.subtract(end, start)[:2] / length
    region = faces._Region(
        Polygon([start[:2], (end[0] - size * y, end[1] + size * x), (1, 0)]), np.zeros(3), np.eye(3)[:2], np.eye(3)[2], 0, False
    )
    before = region.polygon.area
    faces._extend(region, np.array(start), along / length, [(0.0, length, shift, size)], LineString([(0, 0), (length, 0)]))
    assert region.polygon.area == pytest.approx(before + 0.5 * length * size, rel=1e-4)


def test_gap_is_filled_only_beside_both_plates():
    """The first plate has a notch, so that two of its sides run along the gap. The second plate stands beside one of them."""
    one, two = sheet(box(0.003, 0, 2, 2).difference(box(0, 0.8, 0.5, 1.2)), np.eye(4)), sheet(box(0.003, 1.3, 2, 3), np.eye(4))
    two.vertices = two.vertices[:, [2, 1, 0]]
    notched = 2 * 1.997 - 0.4 * 0.497
    assert sorted(areas(found(one, two))) == pytest.approx(sorted([notched + 0.7 * 0.003, 1.7 * 1.997 + 0.7 * 0.003]))


L_FLOOR = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 5), (0, 5)]
U_FLOOR = [(0, 0), (6, 0), (6, 4), (4, 4), (4, 1), (2, 1), (2, 4), (0, 4)]
TURNED = trimesh.transformations.rotation_matrix(1.3, [0.7, -1.1, 0.4])


def areas(of):
    """Return the area of each face."""
    one, two = (of.triangle[:, i] - of.triangle[:, 0] for i in (1, 2))
    return np.add.reduceat(np.linalg.norm(np.cross(one, two), axis=1) / 2, of.first[:-1])


def sheet(polygon, turn):
    """Return a flat mesh of a polygon in the plane z = 0, turned."""
    vertices, faces = trimesh.creation.triangulate_polygon(polygon, engine="earcut")
    return trimesh.Trimesh(np.column_stack([vertices, np.zeros(len(vertices))]), faces, process=False).apply_transform(turn)


@pytest.mark.parametrize("turn", [np.eye(4), TURNED], ids=["straight", "turned"])
@pytest.mark.parametrize("outline", [L_FLOOR, U_FLOOR], ids=["L", "U"])
def test_floor_that_is_not_convex_is_one_face_with_free_edges(outline, turn):
    floor = Polygon(outline)
    of = found(sheet(floor, turn))
    assert areas(of) == pytest.approx([floor.area])
    assert of.length.sum() == pytest.approx(floor.length)
    assert of.opening == pytest.approx(2.0)


@pytest.mark.parametrize("turn", [np.eye(4), TURNED], ids=["straight", "turned"])
def test_wall_with_openings_has_their_edges(turn):
    openings = [(0.5, 0.9, 1.5, 2.1), (2.2, 0.0, 3.1, 2.05), (3.6, 1.0, 4.4, 1.6)]
    wall = Polygon([(0, 0), (5, 0), (5, 2.8), (0, 2.8)]).difference(union_all([box(*sides) for sides in openings]))
    of = found(sheet(wall, turn))
    assert areas(of).sum() == pytest.approx(wall.area)
    assert of.length.sum() == pytest.approx(wall.length)


@pytest.mark.parametrize("seed", range(3))
def test_boxes_have_six_faces_at_any_attitude(seed):
    rng = np.random.default_rng(seed)
    boxes = []
    for i in range(8):
        one = trimesh.creation.box(rng.uniform(0.05, 2.0, 3))
        turn = trimesh.transformations.rotation_matrix(2 * rng.normal(), rng.normal(size=3))
        boxes.append(one.apply_transform(turn).apply_translation([5.0 * i, *rng.uniform(-20, 20, 2)]))
    of = found(*boxes)
    assert np.bincount(of.surface).tolist() == [6] * 8
    assert len(of.length) == 12 * 8
    assert of.opening == pytest.approx(1.5)
    assert areas(of).sum() == pytest.approx(sum(one.area for one in boxes))
    middle = np.array([of.triangle[first].mean(axis=0) for first in of.first[:-1]])
    assert (np.einsum("pi,pi->p", of.normal, middle - np.array([one.centroid for one in boxes])[of.surface]) > 0).all()


def test_subdivided_wall_and_triangles_wound_either_way_are_one_face():
    wall = objects.plate(4.0, 3.0).subdivide().subdivide().subdivide()
    wound = trimesh.Trimesh(np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], float), [(0, 1, 2), (0, 3, 2)], process=False)
    for mesh in (wall, wound):
        of = found(mesh.apply_transform(TURNED))
        assert areas(of) == pytest.approx([mesh.area])
        assert len(of.length) == 4


def test_doubled_and_empty_triangles_add_nothing():
    vertices = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (1, 0, 0)], float)
    triangles = [(0, 1, 2), (0, 2, 3), (0, 1, 2), (2, 1, 0), (0, 4, 1), (3, 3, 3)]
    assert areas(found(trimesh.Trimesh(vertices, triangles, process=False))) == pytest.approx([2.0])


def test_cabinet_on_the_floor_has_edges_above_the_floor_only():
    """Where a cabinet stands on the floor, its edges are inner corners. Below the floor, the two surfaces make a seam of two materials."""
    floor = sheet(box(-3, -3, 3, 3), np.eye(4))
    of = found(floor, objects.box([-0.5, -0.3, 0], [0.5, 0.3, 1.0]))
    low = np.abs(of.start[:, 2]) + np.abs(of.along[:, 2]) < 1e-9
    assert of.length[low & (of.opening == 2)].sum() == pytest.approx(24.0)  # the border of the floor
    assert of.opening[low & (of.opening < 2)] == pytest.approx(1.0)
    assert of.length[~low].sum() == pytest.approx(4 * 1.0 + 2 * (1.0 + 0.6))
    assert of.opening[~low] == pytest.approx(1.5)


def test_curved_surfaces_have_no_faces():
    assert len(found(objects.sphere(0.3)).offset) == 0
    assert (np.abs(found(objects.cylinder(0.2, 1.0)).normal[:, 2]) > 0.99).all()


def test_equal_planes_count_once():
    """A second wall in the place of the first, and a patch in the plane of a wall."""
    wall = objects.plate(2.0, 2.0)
    assert areas(found(wall, wall, wall.copy().apply_scale([1, 0.2, 0.2]))).sum() == pytest.approx(4.0)
