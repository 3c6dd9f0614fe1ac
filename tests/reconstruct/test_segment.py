"""Segmentation of rooms with known surfaces: recall, precision and planes. The truth is made of boxes, independent of the segmenter."""

import numpy as np
import pytest
import trimesh

from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.outlines.names import segment_names
from radartwin.reconstruct.segmentation.faces import Segment
from radartwin.reconstruct.segmentation.segment import segmented

EDGE_M = 0.08  # phone LiDAR meshes have edges of 5 to 10 cm


def truth_room(noise_m, seed=0):
    """A room with a cabinet and a table-like block standing on its floor: noisy mesh, true surface of every face."""
    vertices, faces, label = [], [], []
    sides = [(axis, sign) for axis in range(3) for sign in (-1, 1)]
    boxes = [((0, 0, 0), (6.0, 5.0, 2.8), -1), ((5.0, 1.0, 0.3), (5.6, 2.2, 1.9), 1), ((2.5, 3.0, 0.4), (4.1, 3.9, 0.75), 1)]
    count = 0
    for low, high, outward in boxes:
        low, high = np.array(low), np.array(high)
        for axis, sign in sides:
            u, v = (axis + 1) % 3, (axis + 2) % 3
            nu, nv = (int(np.ceil((high - low)[k] / EDGE_M)) for k in (u, v))
            a, b = np.meshgrid(np.linspace(low[u], high[u], nu + 1), np.linspace(low[v], high[v], nv + 1), indexing="ij")
            points = np.zeros((a.size, 3))
            points[:, u], points[:, v], points[:, axis] = a.ravel(), b.ravel(), (low if sign < 0 else high)[axis]
            grid = np.arange(a.size).reshape(a.shape) + sum(len(p) for p in vertices)
            quad = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=-1).reshape(-1, 4)
            triangles = np.vstack([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
            faces.append(triangles if sign * outward > 0 else triangles[:, ::-1])
            label.append(np.full(len(triangles), count))
            vertices.append(points)
            count += 1
    mesh = trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), process=False)
    mesh.merge_vertices(digits_vertex=6)
    noise = noise_m * np.random.default_rng(seed).standard_normal(mesh.vertices.shape)
    return trimesh.Trimesh(mesh.vertices + noise, mesh.faces, process=False), np.concatenate(label)


def scores(mesh, truth, segments, min_area_m2=0.25):
    """Area-weighted recall and precision of the best segment of every true surface over `min_area_m2`."""
    area = mesh.area_faces
    out = []
    for surface in np.unique(truth):
        inside = truth == surface
        if area[inside].sum() < min_area_m2:
            continue
        best = max(segments, key=lambda s: area[s.faces][inside[s.faces]].sum())
        shared = area[best.faces][inside[best.faces]].sum()
        out.append((shared / area[inside].sum(), shared / area[best.faces].sum()))
    return np.array(out)


@pytest.mark.parametrize("noise_m", [0.0, 0.005, 0.01])
def test_surfaces_of_a_noisy_room_have_high_recall_and_precision(noise_m):
    mesh, truth = truth_room(noise_m)
    segments = segmented(mesh)
    recall, precision = scores(mesh, truth, segments).T
    assert recall.min() > 0.9
    assert precision.min() > 0.9
    shell = scores(mesh, truth, segments, 10.0)
    assert len(shell) == 6  # floor, ceiling, walls
    assert shell.min() > 0.97


def test_planes_of_a_noisy_room_are_accurate_to_two_millimetres():
    mesh, _ = truth_room(0.01)
    planes = [s for s in segmented(mesh) if s.area_m2 > 10]
    truth = {(0, 0.0), (0, 6.0), (1, 0.0), (1, 5.0), (2, 0.0), (2, 2.8)}
    for plane in planes:
        assert plane.normal is not None
        axis = int(np.argmax(np.abs(plane.normal)))
        position = plane.offset_m / plane.normal[axis]
        nearest = min((p for a, p in truth if a == axis), key=lambda p: abs(p - position))
        truth.remove((axis, nearest))
        centre = mesh.triangles_center[plane.faces].mean(axis=0)
        at_centre = (plane.offset_m - plane.normal @ centre + plane.normal[axis] * centre[axis]) / plane.normal[axis]
        assert abs(at_centre - nearest) < 2e-3
        assert np.degrees(np.arccos(abs(plane.normal[axis]))) < 0.3
        assert plane.normal[axis] * (3.0 - nearest) > 0 or axis != 0  # faces into the room
    assert not truth


@pytest.mark.parametrize("noise_m", [0.0, 0.01, 0.05])
def test_every_face_is_in_exactly_one_segment(noise_m):
    mesh, _ = truth_room(noise_m)
    segments = segmented(mesh)
    assert np.array_equal(np.sort(np.concatenate([s.faces for s in segments])), np.arange(len(mesh.faces)))
    assert sum(s.area_m2 for s in segments) == pytest.approx(mesh.area)
    planar = [s.normal is not None for s in segments]
    assert planar == sorted(planar, reverse=True)


def test_segmentation_is_deterministic():
    mesh, _ = truth_room(0.01)
    first, second = (segmented(mesh) for _ in range(2))
    assert all(np.array_equal(a.faces, b.faces) for a, b in zip(first, second, strict=True))


def test_walls_of_two_triangles_are_planes():
    room = trimesh.creation.box((6, 5, 2.8))
    room.invert()
    segments = segmented(room)
    assert [len(s.faces) for s in segments] == [2] * 6
    assert [round(s.area_m2, 6) for s in segments] == [30, 30, 16.8, 16.8, 14, 14]
    assert all(s.normal is not None and np.isclose(np.abs(s.normal).max(), 1) for s in segments)


def test_sphere_is_not_a_plane():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.15)
    segments = segmented(ball)
    assert all(s.normal is None or s.area_m2 < 0.3 * ball.area for s in segments)


def test_surfaces_are_named_by_geometry():
    mesh, _ = truth_room(0.005)
    segments = segmented(mesh)
    names = segment_names(mesh, segments)
    assert len(set(names)) == len(names)
    named = dict(zip(names, segments, strict=True))
    assert named["ceiling"].normal is not None
    assert named["floor"].area_m2 == pytest.approx(30, rel=0.05)
    assert named["ceiling"].area_m2 == pytest.approx(30, rel=0.05)
    assert named["ceiling"].normal[2] < -0.99
    walls = [s.area_m2 for name, s in named.items() if name.startswith("wall_") and s.area_m2 > 10]
    assert sorted(round(a) for a in walls) == [14, 14, 17, 17]


def test_another_segmenter_can_be_used(tmp_path):
    mesh, _ = truth_room(0.0)
    mesh.export(tmp_path / "room.ply")

    def whole(mesh):
        return [Segment(np.arange(len(mesh.faces)), float(mesh.area))]

    scene = reconstruct(tmp_path / "room.ply", material="concrete", segmenter=whole)
    assert scene.names == ("part_1",)
