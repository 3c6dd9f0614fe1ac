"""Segment meshes of rooms with known surfaces, and check recall, precision and plane positions. The reference surfaces are boxes and do not
come from the segmenter.
"""

import functools

import numpy as np
import pytest
import trimesh
from built_rooms import inner_sides, scan, sheet

from radartwin.reconstruct.outlines.assembly import segment_names
from radartwin.reconstruct.segmentation.segment import segmented

EDGE_M = 0.08  # phone LiDAR meshes have edges of 5 to 10 cm
SIZE = (6.0, 5.0, 2.8)


def outer_sides(low, size):
    return [sheet(np.add(low, corner), up, along, extents[::-1], edge_m=EDGE_M) for corner, along, up, extents in inner_sides(size)]


@functools.cache
def room(noise_m):
    """Return a room with a cabinet and a table-like block above the floor: the noisy mesh, the true surface of every face, and the found
    segments.
    """
    pieces = [sheet(*side, edge_m=EDGE_M) for side in inner_sides(SIZE)]
    pieces += outer_sides((5.0, 1.0, 0.3), (0.6, 1.2, 1.6)) + outer_sides((2.5, 3.0, 0.4), (1.6, 0.9, 0.35))
    mesh = scan(pieces, noise_m)
    return mesh, np.repeat(np.arange(len(pieces)), [len(piece.faces) for piece in pieces]), segmented(mesh)


def scores(mesh, truth, segments, min_area_m2=0.25):
    """Return the area-weighted recall and precision of the best matching segment for every true surface above `min_area_m2`."""
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
    assert scores(*room(noise_m)).min() > 0.9
    bounds = scores(*room(noise_m), 10.0)
    assert len(bounds) == 6  # floor, ceiling, walls
    assert bounds.min() > 0.97


def test_planes_of_a_noisy_room_are_accurate_to_two_millimetres():
    mesh, _, segments = room(0.01)
    truth = {(axis, position) for axis in range(3) for position in (0.0, SIZE[axis])}
    for plane in (s for s in segments if s.area_m2 > 10):
        assert plane.normal is not None
        axis = int(np.argmax(np.abs(plane.normal)))
        position = plane.offset_m / plane.normal[axis]
        nearest = min((p for a, p in truth if a == axis), key=lambda p: abs(p - position))
        truth.remove((axis, nearest))
        centre = mesh.triangles_center[plane.faces].mean(axis=0)
        at_centre = (plane.offset_m - plane.normal @ centre + plane.normal[axis] * centre[axis]) / plane.normal[axis]
        assert abs(at_centre - nearest) < 2e-3
        assert np.degrees(np.arccos(abs(plane.normal[axis]))) < 0.3
        assert plane.normal[axis] * (SIZE[axis] / 2 - nearest) > 0  # the normal points into the room
    assert not truth


@pytest.mark.parametrize("noise_m", [0.01, 0.05])
def test_every_face_is_in_exactly_one_segment_and_planes_come_first(noise_m):
    mesh, _, segments = room(noise_m)
    assert np.array_equal(np.sort(np.concatenate([s.faces for s in segments])), np.arange(len(mesh.faces)))
    assert sum(s.area_m2 for s in segments) == pytest.approx(mesh.area)
    planar = [s.normal is not None for s in segments]
    assert planar == sorted(planar, reverse=True)


def test_sphere_is_not_a_plane():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.15)
    segments = segmented(ball)
    assert all(s.normal is None or s.area_m2 < 0.3 * ball.area for s in segments)


def test_surfaces_are_named_by_geometry():
    mesh, _, segments = room(0.005)
    named = dict(zip(segment_names(mesh, segments), segments, strict=True))
    assert len(named) == len(segments), "every name is different"
    for name, normal in (("floor", 1), ("ceiling", -1)):
        assert named[name].area_m2 == pytest.approx(30, rel=0.05)
        plane = named[name].normal
        assert plane is not None
        assert plane[2] * normal > 0.99
    walls = [s.area_m2 for name, s in named.items() if name.startswith("wall_") and s.area_m2 > 10]
    assert sorted(round(a) for a in walls) == [14, 14, 17, 17]
