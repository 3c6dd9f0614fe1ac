"""Join coplanar pieces of the same surface, such as the parts of a wall on both sides of a window or of a cabinet.

Two pieces in the same plane are joined unless the scan has points behind the plane that were seen through the gap between the pieces. For
example, the floor is visible through the gap between two tables, so the tables are not joined.
"""

from __future__ import annotations

import numpy as np
from skimage.morphology import convex_hull_image

from radartwin.reconstruct.segmentation import masks
from radartwin.reconstruct.segmentation.face_arrays import Faces, members, thinned
from radartwin.reconstruct.segmentation.grid import Grid

CELL_M = 0.05
BEHIND_M = 0.06  # points count as behind the plane beyond this depth, which exceeds the noise
CONTRADICTED = 0.2  # two pieces stay separate if at least this fraction of the cells of the gap has points behind the plane
ANGLE_DEG = 6.0  # largest angle between the planes of two joined pieces
OFFSET_M = 0.03  # largest mean distance of the faces of each piece from the common plane
# largest gap between joined pieces, in metres and in multiples of the smaller piece's side (square root of its area)
GAP_M, GAP_SIZES = 3.0, 2.0
NEAR_M = 0.15  # coplanar pieces with a smaller gap are always joined


def merge(faces: Faces, label: np.ndarray) -> np.ndarray:
    """Join coplanar pieces, largest first. `label` (F,) is the piece number of each face; -1 if the face is in no plane.

    Returns: the new piece numbers (F,), 0..P-1 or -1.
    """
    places = faces.centre[thinned(faces.centre, CELL_M)]
    refused: set[tuple[int, int, int, int]] = set()  # first face and number of faces of both pieces, for pairs that were not joined
    while True:
        groups = members(label)
        normal, offset = faces.planes(label)
        centre = np.array([np.average(faces.centre[g], axis=0, weights=faces.area[g]) for g in groups]).reshape(-1, 3)
        area = np.array([faces.area[g].sum() for g in groups])
        bounds = np.array([[faces.corners[g].min(axis=(0, 1)), faces.corners[g].max(axis=(0, 1))] for g in groups]).reshape(-1, 2, 3)
        joined = np.arange(len(groups))
        for i, j in _pairs(normal, offset, centre, area, bounds):
            pair = (int(groups[i][0]), len(groups[i]), int(groups[j][0]), len(groups[j]))
            if joined[i] != i or joined[j] != j or pair in refused:
                continue
            gap_m = min(GAP_M, GAP_SIZES * area[j] ** 0.5)
            fitted, at = faces.plane(np.concatenate([groups[i], groups[j]]))  # a common plane
            away = [np.average(np.abs(faces.centre[g] @ fitted - at), weights=faces.area[g]) for g in (groups[i], groups[j])]
            if max(away) < OFFSET_M and _one_surface(faces, groups[i], groups[j], (normal[i], offset[i]), gap_m, places):
                joined[j] = i
            else:
                refused.add(pair)
        if (joined == np.arange(len(groups))).all():
            return label
        while (joined[joined] != joined).any():
            joined = joined[joined]
        _, packed = np.unique(joined, return_inverse=True)
        label = np.where(label >= 0, packed[np.maximum(label, 0)], -1)


def _pairs(normal: np.ndarray, offset: np.ndarray, centre: np.ndarray, area: np.ndarray, bounds: np.ndarray) -> list[tuple[int, int]]:
    """Return index pairs (larger, smaller piece) of nearly coplanar pieces with near bounding boxes (P, 2, 3), largest first."""
    if len(normal) < 2:
        return []
    away = np.abs(centre @ normal.T - offset)  # entry [i, j]: distance of the centre of piece i from the plane of piece j
    # The plane of a small piece is inaccurate far from the piece, so the larger piece's plane is used.
    large = np.where(area[:, None] >= area[None], away.T, away)
    close = (normal @ normal.T > np.cos(np.radians(ANGLE_DEG))) & (large < 2 * OFFSET_M)
    i, j = np.nonzero(np.triu(close, 1))
    apart = np.maximum(bounds[i, 0] - bounds[j, 1], bounds[j, 0] - bounds[i, 1]).clip(min=0)
    near = np.linalg.norm(apart, axis=1) <= np.maximum(NEAR_M, np.minimum(GAP_M, GAP_SIZES * np.minimum(area[i], area[j]) ** 0.5))
    i, j = i[near], j[near]
    swap = area[i] < area[j]
    i, j = np.where(swap, j, i), np.where(swap, i, j)
    order = np.lexsort((-area[j], -area[i]))
    return [(int(a), int(b)) for a, b in zip(i[order], j[order], strict=True)]


def _one_surface(
    faces: Faces, first: np.ndarray, second: np.ndarray, plane: tuple[np.ndarray, float], gap_m: float, places: np.ndarray
) -> bool:
    """Return whether the gap of two pieces is at most `gap_m`, with few cells that have scan points `places` (N, 3) behind the plane."""
    normal, offset = plane
    grid = Grid.around(np.vstack([faces.centre[first], faces.centre[second]]), normal, offset, CELL_M)
    of_a, of_b = (grid.counts(faces.centre[piece]) > 0 for piece in (first, second))
    from_a, from_b = (CELL_M * masks.distance(mask) for mask in (of_a, of_b))
    gap = float(from_a[of_b].min())
    if gap <= NEAR_M:
        return True
    if gap > gap_m:
        return False
    # The gap consists of the cells on or near a shortest path between the pieces.
    between = (from_a + from_b < gap + 0.3) & ~of_a & ~of_b
    between &= convex_hull_image(of_a | of_b)
    if not between.any():
        return False
    behind = grid.counts(places[places @ normal - offset < -BEHIND_M]) > 0
    return bool(behind[between].mean() < CONTRADICTED)
