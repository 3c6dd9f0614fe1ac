"""The procedural lab: closed shell, no overlaps, a clear bench, nested detail levels."""

import itertools

import numpy as np
import pytest
import trimesh

from radartwin.errors import SceneError
from radartwin.scene import rooms
from radartwin.scene.scene import Scene


def planes(scene):
    """(surface name, normal axis, signed position) of every axis-aligned face, from the triangles alone."""
    for surface in scene:
        for triangle, normal in zip(surface.mesh.triangles, surface.mesh.face_normals, strict=True):
            axis = int(np.argmax(np.abs(normal)))
            if abs(normal[axis]) > 1 - 1e-9:
                yield surface.name, axis, float(triangle[0, axis]), np.delete(triangle, axis, axis=1)


@pytest.mark.parametrize("size", [(6.0, 5.0, 2.8), (8.0, 6.0, 3.2), (5.0, 4.5, 2.4)])
def test_shell_faces_inwards_and_encloses_the_room(size):
    shell = rooms.lab(size, "shell")
    area = sum(s.mesh.area for s in shell)
    length, width, height = size
    assert area == pytest.approx(2 * (length * width + length * height + width * height))
    flux = sum(float((s.mesh.triangles_center * s.mesh.face_normals).sum(axis=1) @ s.mesh.area_faces) for s in shell)
    assert flux / 3 == pytest.approx(-length * width * height)  # divergence theorem: closed, normals inwards
    assert all(s.kind == "room" for s in shell)


def test_no_two_faces_of_different_surfaces_overlap_in_one_plane():
    scene = rooms.lab(detail="cluttered")
    by_plane = {}
    for name, axis, position, triangle in planes(scene):
        by_plane.setdefault((axis, round(position, 6)), []).append((name, triangle.min(axis=0), triangle.max(axis=0)))
    for faces in by_plane.values():
        for (a, low_a, high_a), (b, low_b, high_b) in itertools.combinations(faces, 2):
            overlap = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
            if a != b and (overlap > 1e-6).all():  # boxes of triangles overlap only inside openings
                assert {a, b} <= {"wall_left", "window", "wall_front", "door"}


def test_window_and_door_fill_their_openings_exactly():
    shell = {s.name: s.mesh for s in rooms.lab(detail="shell")}
    for wall, panel, full in (("wall_left", "window", 6.0 * 2.8), ("wall_front", "door", 5.0 * 2.8)):
        assert shell[wall].area + shell[panel].area == pytest.approx(full)
        origins = shell[panel].triangles_center + 0.1 * shell[panel].face_normals
        inside = _hits(shell[wall], origins, -shell[panel].face_normals)
        assert not inside.any()


def _hits(mesh, origins, directions):
    """Moeller-Trumbore, every ray against every triangle."""
    a, b, c = (mesh.triangles[None, :, k] for k in range(3))
    d, o = directions[:, None], origins[:, None]
    p = np.cross(d, c - a)
    det = (p * (b - a)).sum(-1)
    det = np.where(np.abs(det) < 1e-12, np.inf, det)
    u = ((o - a) * p).sum(-1) / det
    q = np.cross(o - a, b - a)
    v = (d * q).sum(-1) / det
    t = ((c - a) * q).sum(-1) / det
    return ((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).any(axis=1)


def test_boresight_is_clear_to_the_far_wall_and_clutter_lies_between_2_and_6_m():
    scene = rooms.lab(detail="cluttered")
    bench = rooms.lab_bench()
    scene.check_sensor(bench.sensor_pose[:3, 3])
    origin, forward = bench.sensor_pose[None, :3, 3], bench.sensor_pose[None, :3, 0]
    blocking = [s.name for s in scene if _hits(s.mesh, origin, forward).any()]
    assert blocking == ["wall_front"]
    for surface in scene:
        if surface.name.startswith(("table", "cabinet", "shelf", *rooms.CLUTTER)):
            distance = np.linalg.norm(surface.mesh.vertices - origin, axis=1)
            assert distance.min() > 2.0
            assert distance.min() < 6.0
    assert np.allclose(bench.target_position(1.5), [2.5, 0, 1.0])


def test_furniture_is_closed_and_keeps_off_the_floor():
    for surface in rooms.lab(detail="furnished").surfaces[8:]:
        solid = surface.mesh.copy()
        solid.merge_vertices(merge_norm=True, merge_tex=True)
        assert solid.is_watertight, surface.name
        assert surface.mesh.bounds[0, 2] > 0.005, surface.name


def test_detail_levels_are_nested_and_clutter_can_be_left_out():
    shell, furnished, cluttered = (rooms.lab(detail=d).names for d in rooms.DETAILS)
    assert cluttered[: len(furnished)] == furnished
    assert furnished[: len(shell)] == shell
    assert rooms.lab(detail="cluttered").without(rooms.CLUTTER).names == furnished
    assert len(set(cluttered)) == len(cluttered)
    with pytest.raises(SceneError, match="shell, furnished"):
        rooms.lab(detail="messy")  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="at least"):
        rooms.lab((3.0, 2.0, 2.4))


def test_support_ends_under_the_object_and_clears_the_floor():
    scene = rooms.support(np.array([2.5, 0, 0.95]))
    assert np.allclose(scene.bounds, [[2.35, -0.15, rooms.GAP], [2.65, 0.15, 0.95]])
    assert {s.kind for s in scene} == {"object"}


def test_empty_is_free_space():
    assert len(rooms.empty()) == 0
    assert isinstance(rooms.empty() + rooms.support(np.array([1.0, 0, 1.0])), Scene)
    assert isinstance(rooms.lab().surfaces[0].mesh, trimesh.Trimesh)
