"""Boards on a wall keep their offset from its plane; a chain of similar colours does not join two objects."""

import numpy as np
import pytest
import trimesh

from radartwin.reconstruct.outlines.surfaces import flattened
from radartwin.reconstruct.segmentation.bodies import with_bodies
from radartwin.reconstruct.segmentation.colour import face_colours
from radartwin.reconstruct.segmentation.faces import Faces, Segment
from radartwin.reconstruct.segmentation.segment import plane_segment, segmented

CELL_M = 0.03
WALL = (210, 205, 200)
BOARD = (1.2, 0.9, 1.8, 1.8)  # left, bottom, right, top


def relief(proud_m: float, noise_m: float = 0.003) -> trimesh.Trimesh:
    """A wall of 3 x 2.5 m facing +x with a blue board that stands out by `proud_m`; depth noise with seed 0."""
    y, z = np.meshgrid(np.arange(0, 3.0 + CELL_M / 2, CELL_M), np.arange(0, 2.5 + CELL_M / 2, CELL_M), indexing="ij")
    inside = (y > BOARD[0]) & (y < BOARD[2]) & (z > BOARD[1]) & (z < BOARD[3])
    x = np.where(inside, proud_m, 0.0) + noise_m * np.random.default_rng(0).standard_normal(y.shape)
    grid = np.arange(y.size).reshape(y.shape)
    quad = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=-1).reshape(-1, 4)
    colours = np.where(inside.reshape(-1, 1), (40, 60, 160), WALL).astype(np.uint8)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(points, np.vstack([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]), vertex_colors=colours, process=False)


@pytest.mark.parametrize(("proud_m", "kept_m"), [(0.0, 0.0), (0.005, 0.0), (0.022, 0.022), (-0.02, -0.02)])
def test_board_keeps_its_offset_and_a_flush_board_shares_the_wall_plane(proud_m: float, kept_m: float) -> None:
    mesh = relief(proud_m)
    segments = segmented(mesh)
    assert len([s for s in segments if s.area_m2 > 0.3]) == 2
    wall, board = sorted((f for f in flattened(mesh, segments).flats if f.segment >= 0), key=lambda f: -f.mesh.area)[:2]
    assert np.asarray(wall.mesh.vertices)[:, 0] == pytest.approx(0.0, abs=0.002)
    apart = np.median(board.mesh.vertices[:, 0]) - np.median(wall.mesh.vertices[:, 0])
    assert apart == pytest.approx(kept_m, abs=0.004 if kept_m else 0.001)
    low, high = board.mesh.bounds[:, 1:]
    assert [*low, *high] == pytest.approx(BOARD, abs=2 * CELL_M)
    # The wall has no second face behind the board.
    assert wall.mesh.area + board.mesh.area == pytest.approx(7.5, rel=0.03)


def block(corner: tuple[float, float, float], size: tuple[float, float, float], colour: tuple[int, int, int]) -> trimesh.Trimesh:
    box = trimesh.creation.box(bounds=np.array([corner, np.add(corner, size)]))
    for _ in range(4):
        box = box.subdivide()
    box.visual.vertex_colors = np.tile([*colour, 255], (len(box.vertices), 1))  # type: ignore[union-attr]
    return box


def test_rubble_of_intermediate_colour_does_not_join_two_objects() -> None:
    """Grey and brown cabinets with rubble in their corner, whose colour is similar to both."""
    grey, brown, between = (92, 90, 86), (97, 76, 61), (95, 83, 73)
    corner = block((0.61, 0.1, 0), (0.04, 0.3, 1.5), between)
    parts = [block((0, 0, 0), (0.6, 0.5, 1.6), grey), block((0.66, 0, 0), (0.6, 0.5, 1.6), brown), corner]
    mesh = trimesh.util.concatenate(parts)
    assert isinstance(mesh, trimesh.Trimesh)
    lab = face_colours(mesh)
    assert lab is not None
    faces = Faces.of(mesh, 0.0)
    owner = np.repeat(np.arange(3), [len(p.faces) for p in parts])
    segments: list[Segment] = []
    for number in (0, 1):
        for axis in range(3):
            for sign in (-1, 1):
                segments.append(plane_segment(faces, np.flatnonzero((owner == number) & (mesh.face_normals[:, axis] * sign > 0.9))))
    rubble = np.flatnonzero(owner == 2)
    segments.append(Segment(rubble, float(faces.area[rubble].sum())))
    middle = [lab[owner == k].mean(axis=0) for k in range(3)]
    assert max(np.linalg.norm(middle[2] - middle[k]) for k in (0, 1)) < 7 < np.linalg.norm(middle[0] - middle[1]) < 14
    numbers = [s.body for s in with_bodies(faces, segments, lab)]
    assert not set(numbers[:6]) & set(numbers[6:12])
