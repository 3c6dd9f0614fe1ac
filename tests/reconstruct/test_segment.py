"""Segmentation: recall, precision and planes of known surfaces, coplanar pieces, surfaces of other colour or offset, and objects."""

import functools

import numpy as np
import pytest
import trimesh
from built_rooms import BROWN, GREY, WHITE, H, L, W, X, Y, Z, block, coloured, inner_sides, saved, scan, sheet, shell, with_door

from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.outlines.assembly import segment_names
from radartwin.reconstruct.outlines.surfaces import flattened
from radartwin.reconstruct.segmentation import coplanar
from radartwin.reconstruct.segmentation.face_arrays import Faces, members
from radartwin.reconstruct.segmentation.growing import grow
from radartwin.reconstruct.segmentation.segment import segmented

EDGE_M = 0.08  # phone LiDAR meshes have edges of 5 to 10 cm
SIZE = (6.0, 5.0, 2.8)


def outer_sides(low, size):
    return [sheet(np.add(low, corner), up, along, extents[::-1], edge_m=EDGE_M) for corner, along, up, extents in inner_sides(size)]


@functools.cache
def room(noise_m):
    """Return a room with a cabinet and a block above the floor: the noisy mesh, the true surface of every face, and the segments."""
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


def test_surfaces_of_a_noisy_room_have_high_recall_and_precision_and_names_of_their_own():
    assert scores(*room(0.01)).min() > 0.9
    mesh, _, segments = room(0.01)
    assert np.array_equal(np.sort(np.concatenate([s.faces for s in segments])), np.arange(len(mesh.faces)))
    assert len(set(segment_names(mesh, segments))) == len(segments)
    bounds = scores(*room(0.01), 10.0)
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


def test_sphere_is_not_a_plane():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.15)
    assert all(s.normal is None or s.area_m2 < 0.3 * ball.area for s in segmented(ball))


STRIPS = [sheet([0, 0, 0], X, Z, (1.2, H)), sheet([2.4, 0, 0], X, Z, (1.6, H))]  # a gap from floor to ceiling


def test_divided_wall_is_one_surface_and_two_tables_are_two():
    tables = [sheet([x, 1.0, 0.75], X, Y, (0.8, 0.6)) for x in (0.5, 2.5)]
    mesh = scan([sheet([0, 0, 0], X, Y, (L, W)), *STRIPS, *tables], 0.003)
    areas = sorted(round(s.area_m2, 1) for s in segmented(mesh) if s.normal is not None)
    assert areas == [0.5, 0.5, pytest.approx(6.72, abs=0.15), pytest.approx(20, abs=0.2)]


def test_pieces_with_points_behind_their_gap_are_not_joined():
    alcove = sheet([1.2, 0.6, 0], X, Z, (1.2, H))  # behind the strips, which face -y
    for pieces, count in (([*STRIPS, alcove], 3), (STRIPS, 1)):
        faces = Faces.of(scan(pieces, 0.002), 0.08)
        assert len(members(coplanar.merge(faces, grow(faces, 25.0, 0.04, 0.06)))) == count


def test_door_in_the_plane_of_its_wall_is_separated_by_colour(tmp_path):
    mesh = coloured(scan(shell(), 0.004), with_door)
    door = [s for s in segmented(mesh) if 1.0 < s.area_m2 < 3.0]
    assert [s.area_m2 for s in door] == [pytest.approx(1.8, rel=0.1)]
    assert len(segmented(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))) == 6
    walls = [s for s in reconstruct(saved(mesh, tmp_path)) if s.mesh.bounds[0, 0] > L - 0.05]
    assert sum(float(s.mesh.area) for s in walls) == pytest.approx(W * H, rel=0.01)  # neither gap nor overlap between them
    leaf = min(walls, key=lambda s: s.mesh.area)
    assert leaf.mesh.area == pytest.approx(1.8, rel=0.05)
    assert len(leaf.mesh.faces) <= 6


def on_wall(rule, others=WHITE):
    """Return the rule of the colours in the wall x = 5, with the place from its left edge and the height as arguments."""
    return lambda v: rule(W - v[1], v[2]) if v[0] > L - 0.05 else others


def panel(u, z, other=BROWN):
    return ((175, 175, 180) if z > 1.3 else (130, 130, 135)) if 0.5 < u < 1.6 and z < 2.0 else other


def lit(v):
    spot = 90 * np.exp(-((v[0] - 2) ** 2 + (v[1] - 1.5) ** 2) / 0.5)
    line = 80 if abs(v[2] - 1.2) < 0.03 else 0
    return np.array([150 + spot, 150 + spot - line, 150 + spot - line])


COLOURS = {  # areas of the surfaces that differ from their wall
    "reflection in the upper half of a panel": (on_wall(panel), [2.2]),
    "patch of another brown beside it": (
        on_wall(lambda u, z: panel(u, z, (165, 112, 72) if 2.4 < u < 3.4 and 0.5 < z < 1.5 else BROWN)), [1.0, 2.2],
    ),
    "two panels joined at the floor": (
        on_wall(lambda u, z: GREY if ((0.5 < u < 1.4 or 2 < u < 2.9) and z < 2) or (0.5 < u < 2.9 and z < 0.03) else BROWN), [1.8, 1.8],
    ),
    "light and painted lines": (lit, []),
}  # fmt: skip


@pytest.mark.parametrize("name", COLOURS)
def test_colours_separate_panels_and_patches_but_no_light(name):
    rule, areas_m2 = COLOURS[name]
    segments = segmented(coloured(scan(shell(), 0.003), rule))
    assert len(segments) == 6 + len(areas_m2)
    assert sorted(s.area_m2 for s in segments if s.area_m2 < 3) == [pytest.approx(area, abs=0.18) for area in areas_m2]


def test_sides_of_one_colour_are_one_body_and_of_two_colours_two():
    mesh = scan([*shell(), block((0.6, 0.6, 0.6), [2, 1.5, 0.3])], 0.002)

    def brown(v):
        return WHITE if v[2] > 0.7 or np.abs(v[:2] - [2, 1.5]).max() > 0.32 or v[2] < 0.01 else BROWN

    def with_grey_top(v):
        return GREY if 0.58 < v[2] < 0.62 and np.abs(v[:2] - [2, 1.5]).max() < 0.28 else brown(v)

    def bodies(rule):  # not of the box's underside, which touches nothing else
        segments = segmented(coloured(mesh, rule))
        return {s.body for s in segments if s.area_m2 < 0.6 and s.normal is not None and s.normal[2] > -0.5}

    assert len(bodies(brown)) == 1
    assert len(bodies(with_grey_top)) == 2


RELIEF_CELL_M = 0.03
PLASTER = (210, 205, 200)
BOARD = (1.2, 0.9, 1.8, 1.8)  # left, bottom, right, top


def relief(proud_m):
    """Return a wall of 3 x 2.5 m that faces +x, with depth noise of 3 mm and a blue board that stands out from the wall by `proud_m`."""
    wall = sheet([0, 0, 0], Y, Z, (3.0, 2.5), edge_m=RELIEF_CELL_M)
    _, y, z = wall.vertices.T
    inside = (y > BOARD[0]) & (y < BOARD[2]) & (z > BOARD[1]) & (z < BOARD[3])
    x = np.where(inside, proud_m, 0.0) + 0.003 * np.random.default_rng(0).standard_normal(y.shape)
    colours = np.where(inside[:, None], (40, 60, 160), PLASTER).astype(np.uint8)
    return trimesh.Trimesh(wall.vertices + np.outer(x, X), wall.faces, vertex_colors=colours, process=False)


@pytest.mark.parametrize(("proud_m", "kept_m"), [(0.0, 0.0), (0.005, 0.0), (0.022, 0.022), (-0.02, -0.02)])
def test_board_keeps_its_offset_and_a_flush_board_shares_the_wall_plane(proud_m, kept_m):
    mesh = relief(proud_m)
    segments = segmented(mesh)
    assert len([s for s in segments if s.area_m2 > 0.3]) == 2
    wall, board = sorted((f for f in flattened(mesh, segments).flats if f.segment >= 0), key=lambda f: -f.mesh.area)[:2]
    assert np.asarray(wall.mesh.vertices)[:, 0] == pytest.approx(0.0, abs=0.002)
    apart = np.median(board.mesh.vertices[:, 0]) - np.median(wall.mesh.vertices[:, 0])
    assert apart == pytest.approx(kept_m, abs=0.004 if kept_m else 0.001)
    low, high = board.mesh.bounds[:, 1:]
    assert [*low, *high] == pytest.approx(BOARD, abs=2 * RELIEF_CELL_M)
    # The wall has no second face behind the board.
    assert wall.mesh.area + board.mesh.area == pytest.approx(7.5, rel=0.03)
