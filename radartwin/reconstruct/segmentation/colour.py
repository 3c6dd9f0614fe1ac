"""Separate surfaces that lie in the same plane by colour, such as a door in a wall, a poster, or a metal strip along a painted wall.

The colours of the faces in a plane are drawn into a picture of square cells. A region of the picture is divided if it has a sharp colour
step between neighbouring cells and if the separated piece is wide and large enough. A gradual colour change does not divide a region,
because light changes gradually. Colours are CIE L*a*b* with reduced weight of the lightness, because shading changes the lightness most.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from scipy.ndimage import gaussian_filter, median_filter
from skimage.color import rgb2lab
from skimage.filters import threshold_otsu

from radartwin.reconstruct.segmentation import masks
from radartwin.reconstruct.segmentation.grid import in_plane

LIGHTNESS = 0.6  # weight of the lightness L*; a* and b* have weight 1
DEEP_M, BESIDE_M = 0.3, 0.25  # largest distances from an edge, inside and outside of a piece, at which colours are compared
EDGE = 0.4  # largest colour difference between the two neighbours of a cell in an area without edges, relative to STEP
MOSTLY = 0.6  # smallest fraction of a piece's cells that differ from the outside, and of its border cells that have a sharp colour step
ACROSS = 2.5  # distance in cells from a border beyond which colours are compared, because nearer colours are blurred
# smallest colour step that divides a piece further, relative to the step at the border of the piece, because the light scales both steps
WITHIN = 0.5
ROUNDS = 12  # largest number of divisions per plane
CELL_M = 0.02  # cell size of the picture, about the resolution of the scan
STEP = 7.0  # smallest weighted L*a*b* difference across the edge of a piece; side by side, a difference of 2 is just visible
CONTRAST = 2.0  # smallest ratio of the colour difference to the colour variation outside the edge
WIDTH_M, AREA_M2 = 0.12, 0.12  # narrower or smaller pieces (painted lines, frames) are not separated


def colour_pieces(centre: np.ndarray, area: np.ndarray, lab: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Divide the K faces of a plane by colour into pieces. Return the piece number (K,) of each face; 0 is the main piece.

    Args:
        centre, area: (K, 3) centres of the faces in metres, and (K,) areas of the faces in m2.
        lab: (K, 3) weighted L*a*b* colours of the faces, from `face_colours`.
        normal: (3,) unit normal of the plane.
    """
    points = centre @ in_plane(normal).T
    # If the cells were smaller than the faces, some cells of the picture would have no colour.
    cell = max(CELL_M, 1.5 * float(np.sqrt(np.median(area))))
    at = ((points - points.min(axis=0)) / cell).astype(int)
    shape = tuple(at.max(axis=0) + 1)
    index = at[:, 0] * shape[1] + at[:, 1]
    weight = np.bincount(index, area, minlength=shape[0] * shape[1]).reshape(shape)
    seen = weight > 0
    picture = np.stack([np.bincount(index, area * lab[:, k], minlength=weight.size).reshape(shape) for k in range(3)], axis=-1)
    picture /= np.maximum(weight, 1e-12)[..., None]
    picture = picture[masks.nearest(seen)]
    smooth = np.stack([median_filter(picture[..., k], size=5, mode="nearest") for k in range(3)], axis=-1)
    known = masks.distance(seen) < 1.5
    label = np.where(known, 0, -1)
    _divide(label, smooth, cell)
    return np.maximum(label.reshape(-1)[index], 0)


def _divide(label: np.ndarray, picture: np.ndarray, cell: float) -> None:
    """Divide a picture (W, H, 3) into pieces, and write the piece number of each cell to `label`. Cells with -1 are outside the plane."""
    count, todo = 1, [0]
    min_step = {0: STEP}  # for each piece number, the smallest colour step that divides the piece further
    for _ in range(ROUNDS):
        if not todo:
            return
        current = todo.pop()
        region = label == current
        # Pieces that are already separated must not affect the blurred colours at the borders of the remaining region.
        inner = region & (masks.distance(~region) > 1.5)
        pieces = _pieces_of(region, picture[masks.nearest(inner)] if inner.any() else picture, cell, min_step[current])
        for piece, step in pieces:
            label[piece] = count
            todo.append(count)
            min_step[count] = max(STEP, WITHIN * step)
            count += 1
        if pieces:
            todo.append(current)


def _pieces_of(region: np.ndarray, picture: np.ndarray, cell: float, min_step: float) -> list[tuple[np.ndarray, float]]:
    """Return masks and colour steps of pieces that differ by at least `min_step` from the rest of a region; of overlaps, the sharpest."""
    if region.sum() * cell**2 < 2 * AREA_M2:
        return []
    ranked = []
    for candidates in (_between_edges, _of_two_colours):
        for candidate in candidates(region, picture, cell):
            for piece in masks.pieces(_refined(candidate, region, picture, cell, min_step)):
                steps = _steps(piece, region, picture)
                share = float((steps > min_step).mean()) if steps.size else 0.0
                if piece.sum() * cell**2 >= AREA_M2 and share >= MOSTLY:
                    ranked.append((share, piece, float(np.median(steps))))
    pieces: list[tuple[np.ndarray, float]] = []
    for _, piece, step in sorted(ranked, key=lambda entry: -entry[0]):
        if not any((piece & other).any() for other, _ in pieces):
            pieces.append((piece, step))
    return pieces


def _between_edges(region: np.ndarray, picture: np.ndarray, cell: float) -> list[np.ndarray]:
    """Return masks of candidate pieces: areas that colour edges separate from the largest area without edges."""
    steps = [np.linalg.norm(np.roll(picture, -1, axis) - np.roll(picture, 1, axis), axis=-1) for axis in range(2)]
    strength = np.maximum(*steps)
    even = masks.pieces(masks.opened(region & (strength < EDGE * STEP), 1))
    if not even:
        return []
    main = max(even, key=np.sum)
    # A colour edge is blurred over two cells. The cell nearer to the main area belongs to the main area.
    others = region & ~masks.dilated(main, 2)
    wide = masks.opened(others, np.ceil(WIDTH_M / 2 / cell))
    return [masks.dilated(piece, 2, region & ~main) for piece in masks.pieces(wide)]


def _of_two_colours(region: np.ndarray, picture: np.ndarray, cell: float) -> list[np.ndarray]:
    """Return masks of candidate pieces: connected areas that have the rarer of the two main colours of a region."""
    minor = np.zeros(region.shape, dtype=bool)
    minor[region] = _two_means(picture[region])
    minor = masks.opened(minor, WIDTH_M / 2 / cell)
    minor = masks.closed(minor, 2) & region
    return [masks.dilated(piece, 1, minor) for piece in masks.pieces(minor)]


def _refined(piece: np.ndarray, region: np.ndarray, picture: np.ndarray, cell: float, min_step: float) -> np.ndarray:
    """Return the mask of a piece with its border at the colour edge; empty if the colours differ by less than `min_step`."""
    none = np.zeros_like(piece)
    rest = region & ~piece
    if piece.sum() * cell**2 < AREA_M2 or not rest.any():
        return none
    to_rest, to_piece = masks.distance(rest), masks.distance(piece)
    beside = rest & (to_piece > 2) & (to_piece * cell <= BESIDE_M)
    inside = piece & (to_rest > 1) & (to_rest * cell <= DEEP_M)
    if min(beside.sum(), inside.sum()) < 8:
        return none
    # Light varies along the edge, so each cell is compared with the nearest cell outside of the piece.
    difference = np.linalg.norm(picture - picture[masks.nearest(beside)], axis=-1)
    spread = float(np.median(np.linalg.norm(picture[beside] - _local_mean(picture, beside, cell)[beside], axis=-1)))
    min_step = max(min_step, CONTRAST * spread)
    if (difference[inside] > min_step).mean() < MOSTLY:
        return none
    zone = masks.dilated(piece, 3, region)
    other = zone & (difference > max(0.6 * min_step, 0.5 * float(np.median(difference[inside]))))
    other = masks.opened(masks.closed(other, 1) & zone, WIDTH_M / 3 / cell)
    return other if other.sum() > 0.3 * piece.sum() else none


def _steps(piece: np.ndarray, region: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Return the colour difference across the border of a piece at each border cell, measured ACROSS cells away on either side."""
    rest = region & ~piece
    to_rest, to_piece = masks.distance(rest), masks.distance(piece)
    inside, outside = piece & (to_rest > ACROSS), rest & (to_piece > ACROSS)
    if not (inside.any() and outside.any()):
        return np.zeros(0)
    difference = picture[masks.nearest(inside)] - picture[masks.nearest(outside)]
    return np.linalg.norm(difference[piece & (to_rest <= 1)], axis=-1)


def face_colours(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Return the weighted L*a*b* colour (F, 3) of every face; None if the mesh has no colour or a single colour."""
    rgb = face_rgb(mesh)
    if rgb is None or float(np.ptp(rgb, axis=0).max()) < 4:
        return None
    return rgb2lab(rgb[:, None] / 255)[:, 0] * [LIGHTNESS, 1.0, 1.0]


def face_rgb(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Return the sRGB colour (F, 3), 0..255, of every face; None for a mesh without vertex colours, which every coloured scan has."""
    visual: Any = mesh.visual
    return np.asarray(visual.vertex_colors)[:, :3][np.asarray(mesh.faces)].mean(axis=1) if visual.kind == "vertex" else None


def _two_means(values: np.ndarray) -> np.ndarray:
    """Divide colours (N, 3) into two clusters by k-means. Return a boolean mask (N,) of the smaller cluster."""
    centred = values - values.mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    second = centred @ axis > threshold_otsu(centred @ axis, nbins=128)
    for _ in range(10):
        if second.all() or not second.any():
            return np.zeros(len(values), dtype=bool)
        a, b = values[~second].mean(axis=0), values[second].mean(axis=0)
        again = ((values - b) ** 2).sum(axis=1) < ((values - a) ** 2).sum(axis=1)
        if (again == second).all():
            break
        second = again
    return second if second.sum() * 2 <= len(second) else ~second


def _local_mean(picture: np.ndarray, where: np.ndarray, cell: float) -> np.ndarray:
    """Return, for each cell of the picture, the mean colour of the cells in the mask `where` within BESIDE_M."""
    sigma = BESIDE_M / 2 / cell
    weight = gaussian_filter(where.astype(float), sigma)
    mean = [gaussian_filter(np.where(where, picture[..., k], 0.0), sigma) for k in range(3)]
    return np.stack(mean, axis=-1) / np.maximum(weight, 1e-9)[..., None]
