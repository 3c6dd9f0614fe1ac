"""Flat panels that are built from a mesh are convex and cover the faces of the mesh, and closed solids are
distinguished from open shells.
"""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from radartwin.scene import objects, rooms
from radartwin.simulation import geometry
from radartwin.simulation.flat import panels

L_FLOOR = [(0, 0), (4, 0), (4, 2), (2, 2), (2, 5), (0, 5)]
U_FLOOR = [(0, 0), (6, 0), (6, 4), (4, 4), (4, 1), (2, 1), (2, 4), (0, 4)]
TURNED = Rotation.from_rotvec([0.7, -1.1, 0.4])


def found(*meshes, turn=None):
    moved = [m.copy() for m in meshes]
    if turn is not None:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), [3.1, -7.7, 1.9]
        for mesh in moved:
            mesh.apply_transform(matrix)
    built = geometry.build(moved)
    return built, panels.find(built)


def face_areas(built):
    edges = built.corners[:, 1:] - built.corners[:, :1]
    return np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2


def areas(of):
    out = []
    for corners, count in zip(of.corners, of.count, strict=True):
        ring = corners[:count] - corners[0]
        out.append(np.linalg.norm(np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)) / 2)
    return np.array(out)


def holds(of, index, point):
    """Return whether a panel contains this point of its plane."""
    ring = of.corners[index, : of.count[index]]
    ahead = np.roll(ring, -1, axis=0) - ring
    return bool((np.cross(ahead, point - ring) @ of.normal[index] >= -1e-9).all())


def assert_sound(built, of):
    """Check that every panel is convex, counter-clockwise about its normal and flat. The panels must consist of exactly the given faces,
    and each face centre must be in only one panel.
    """
    for i in range(len(of)):
        ring = of.corners[i, : of.count[i]]
        assert np.abs(ring @ of.normal[i] - of.offset[i]).max() < 1e-6
        ahead = np.roll(ring, -1, axis=0) - ring
        assert (np.cross(np.roll(ahead, 1, axis=0), ahead) @ of.normal[i] > -1e-7).all()
        assert np.linalg.norm(ahead, axis=1).min() > 1e-7
    share = np.array([face_areas(built)[of.of_face == i].sum() for i in range(len(of))])
    np.testing.assert_allclose(share, areas(of), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(of.normal, axis=1), 1, atol=1e-12)
    for face in np.flatnonzero(of.of_face >= 0):
        assert holds(of, of.of_face[face], built.corners[face].mean(axis=0))
        assert of.surface[of.of_face[face]] == built.surface[face]


def grid_floor(outline, step=1.0):
    """Return a floor with a right-angled outline that consists of squares of two triangles each, in an irregular order."""
    ring = np.array(outline, float)
    xs, ys = (np.arange(ring[:, k].min(), ring[:, k].max() + step / 2, step) for k in (0, 1))
    place = {}
    vertices, faces = [], []

    def vertex(x, y):
        if (x, y) not in place:
            place[x, y] = len(vertices)
            vertices.append((x, y, 0.0))
        return place[x, y]

    for x in xs[:-1]:
        for y in ys[:-1]:
            if inside(ring, x + step / 2, y + step / 2):
                a, b, c, d = vertex(x, y), vertex(x + step, y), vertex(x + step, y + step), vertex(x, y + step)
                faces += [[a, b, c], [a, c, d]] if (x + y) % 2 else [[a, b, d], [b, c, d]]
    order = np.random.default_rng(3).permutation(len(faces))
    return trimesh.Trimesh(vertices, np.array(faces)[order], process=False)


def inside(ring, x, y):
    crossings = 0
    for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            crossings += 1
    return crossings % 2 == 1


def polygon_area(outline):
    x, y = np.array(outline, float).T
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize(("detail", "number", "curved_m2"), [("shell", 13, 0.0), ("furnished", 127, 0.0), ("cluttered", 169, 0.6)])
def test_panels_of_the_lab_have_its_area(detail, number, curved_m2):
    built, of = found(*[s.mesh for s in rooms.lab(detail=detail)])
    assert len(of) == number
    assert_sound(built, of)
    total = face_areas(built).sum()
    assert total - areas(of).sum() == pytest.approx(curved_m2, abs=0.02 + 1e-9 if curved_m2 else 1e-9)


@pytest.mark.parametrize("turn", [None, TURNED], ids=["straight", "turned"])
@pytest.mark.parametrize(("outline", "most"), [(L_FLOOR, 2), (U_FLOOR, 3)], ids=["L", "U"])
def test_floors_that_are_not_convex_are_cut_into_few_convex_tiles(outline, most, turn):
    built, of = found(grid_floor(outline), turn=turn)
    assert_sound(built, of)
    assert areas(of).sum() == pytest.approx(polygon_area(outline), abs=1e-5)
    assert (of.of_face >= 0).all()
    assert most <= len(of) <= 2 * most


@pytest.mark.parametrize("turn", [None, TURNED], ids=["straight", "turned"])
def test_wall_with_openings_tiles_around_them(turn):
    openings = [(0.5, 0.9, 1.5, 2.1), (2.2, 0.0, 3.1, 2.05), (3.6, 1.0, 4.4, 1.6)]
    wall = rooms.rectangle([0, 0, 0], np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), (5.0, 2.8), openings)
    built, of = found(wall, turn=turn)
    assert_sound(built, of)
    left = 5 * 2.8 - sum((u1 - u0) * (v1 - v0) for u0, v0, u1, v1 in openings)
    assert areas(of).sum() == pytest.approx(left, abs=1e-6)
    assert len(of) <= 16


@pytest.mark.parametrize("seed", range(3))
def test_random_boxes_have_six_panels_at_any_attitude(seed):
    rng = np.random.default_rng(seed)
    meshes = []
    for _ in range(8):
        box = trimesh.creation.box(rng.uniform(0.05, 2.0, 3))
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(rng.normal(size=3) * 2).as_matrix(), rng.uniform(-20, 20, 3)
        meshes.append(box.apply_transform(matrix))
    built, of = found(*meshes)
    assert_sound(built, of)
    assert len(of) == 6 * len(meshes)
    assert (of.count == 4).all()
    assert sorted(set(of.body.tolist())) == list(range(8))
    outward = np.einsum("pi,pi->p", of.normal, of.centre - np.array([m.centroid for m in meshes])[of.surface])
    assert (outward > 0).all()


def test_subdivided_wall_and_faces_wound_either_way_are_one_panel():
    wall = objects.plate(4.0, 3.0).subdivide().subdivide().subdivide()
    wound = trimesh.Trimesh(np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)], float), [(0, 1, 2), (0, 3, 2)], process=False)
    for mesh in (trimesh.Trimesh(wall.vertices, wall.faces, process=False), wound):
        built, of = found(mesh, turn=TURNED)
        assert_sound(built, of)
        assert of.count.tolist() == [4]


def test_t_junctions_leave_panels_side_by_side():
    """One long edge meets two short edges of neighbouring faces. The panels lose no area and do not overlap."""
    vertices = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0), (2, 2, 0)]
    faces = [(0, 1, 2), (0, 2, 3), (3, 4, 5), (3, 5, 6), (4, 2, 7), (4, 7, 5)]
    built, of = found(trimesh.Trimesh(np.array(vertices, float), faces, process=False))
    assert_sound(built, of)
    assert areas(of).sum() == pytest.approx(4.0)
    assert len(of) == 2


def test_doubled_and_empty_faces_add_nothing():
    vertices = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (1, 0, 0)], float)
    faces = [(0, 1, 2), (0, 2, 3), (0, 1, 2), (2, 1, 0), (0, 4, 1), (3, 3, 3)]
    _, of = found(trimesh.Trimesh(vertices, faces, process=False))
    assert areas(of).sum() == pytest.approx(2.0)
    assert len(of) == 1


def test_slivers_are_dropped_without_effect_on_neighbours():
    vertices = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (0, 1.002, 0.2), (2, 1.002, 0.2)], float)
    strip = np.array([(0, 0, 2), (2, 0, 2), (2, 0.004, 2), (0, 0.004, 2)], float)
    mesh = trimesh.Trimesh(vertices, [(0, 1, 2), (0, 2, 3), (3, 2, 5), (3, 5, 4)], process=False)
    alone = trimesh.Trimesh(strip, [(0, 1, 2), (0, 2, 3)], process=False)
    built, of = found(mesh, alone)
    assert_sound(built, of)
    assert set(of.surface.tolist()) == {0}
    assert (of.of_face[built.surface == 1] == -1).all()


@pytest.mark.parametrize("lift", [1e-5, 0.05])
def test_bent_quads_are_not_one_plane(lift):
    vertices = np.array([(0, 0, 0), (2, 0, 0), (2, 2, lift), (0, 2, 0)], float)
    _, of = found(trimesh.Trimesh(vertices, [(0, 1, 2), (0, 2, 3)], process=False))
    for i in range(len(of)):
        assert np.abs(of.corners[i, : of.count[i]] @ of.normal[i] - of.offset[i]).max() < 1e-5


def test_only_closed_convex_outward_parts_are_bodies():
    inward = trimesh.creation.box((4.0, 3.0, 2.5))
    inward.invert()
    outward = trimesh.creation.box((0.4, 0.3, 0.2))
    opened = trimesh.creation.box((0.5, 0.5, 0.5)).apply_translation([0, 1, 0])
    opened = trimesh.Trimesh(opened.vertices, opened.faces[:-1], process=False)
    bent = trimesh.util.concatenate([trimesh.creation.box((0.4, 0.4, 0.4)).apply_translation([1, 0, 0])])
    hollow = objects.trihedral(0.2).apply_translation([-1, 0, 0])
    for turn in (None, TURNED):
        _, of = found(inward, outward, opened, bent, hollow, turn=turn)
        assert (of.body[np.isin(of.surface, [0, 2, 4])] == -1).all()
        assert len(set(of.body[of.surface == 1].tolist())) == 1
        assert (of.body[np.isin(of.surface, [1, 3])] >= 0).all()


def test_parts_of_a_surface_are_separate_bodies():
    legs = objects.joined([objects.box([x, y, 0], [x + 0.04, y + 0.04, 0.7]) for x in (0, 1) for y in (0, 0.6)])
    _, of = found(legs)
    assert len(of) == 24
    assert np.bincount(of.body).tolist() == [6, 6, 6, 6]


def test_step_block_is_no_body():
    """An L-shaped solid is closed but not convex, so the tracer must not treat it as a convex body."""
    profile = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    bottom = np.array([(*p, 0.0) for p in profile])
    top = bottom + np.array([0, 0, 1.0])
    vertices = np.concatenate([bottom, top])
    lids = [(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)]
    faces = [(a, c, b) for a, b, c in lids] + [(a + 6, b + 6, c + 6) for a, b, c in lids]
    for i in range(6):
        j = (i + 1) % 6
        faces += [(i, j, j + 6), (i, j + 6, i + 6)]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_volume
    built, of = found(mesh, turn=TURNED)
    assert_sound(built, of)
    assert (of.body == -1).all()
    assert areas(of).sum() == pytest.approx(mesh.area, abs=1e-5)


def test_curved_surfaces_have_no_panels():
    built, of = found(objects.sphere(0.3), objects.cylinder(0.2, 1.0))
    sides = np.abs(built.normals[:, 0, 2]) < 0.5
    assert (of.of_face[(built.surface == 1) & sides] == -1).all()
    assert (of.of_face[built.surface == 0] == -1).all()
