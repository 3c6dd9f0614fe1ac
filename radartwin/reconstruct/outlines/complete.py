"""Complete the parts of a flat surface, such as a wall, that the depth sensor missed.

A gap in the scanned points of a plane has one of four causes:
- Opening: the sensor saw points behind the plane through the gap, or a mesh without known cameras has a gap in the shape of a door, with
  nothing in front of the gap. The gap stays open.
- Hidden part: an object stands in front of the gap. The plane is continued behind the object.
- Pane: the gap was visible but the scan has no points in it, because glass or a mirror is there. The gap becomes a separate surface.
- Noise: the gap is small. The gap is filled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_fill_holes

from radartwin.reconstruct.outlines.seen_points import Sight
from radartwin.reconstruct.segmentation import masks
from radartwin.reconstruct.segmentation.grid import Grid

# Limits of the distance in metres between scanned points and the plane.
BEHIND_M = 0.10  # points count as behind the plane beyond this depth, which exceeds noise and the reveal of a window
BEFORE_M = 0.04  # points count as in front of the plane beyond this distance, which exceeds the noise
CLOSE_M = 0.25  # an object nearer than this hides the plane from every viewpoint
HIDES_M = 1.2  # objects farther from a wall than this do not count as hiding it, because from each viewpoint they hide a different part
# an object higher above a floor does not hide the floor; larger than HIDES_M, because tall objects hide the floor below them
STANDS_M = 2.6
# Smallest fractions of the cells of a gap.
OPEN_SHARE = 0.35  # an opening has points behind it in at least this share of its cells
HIDDEN_SHARE = 0.3  # a hidden part has points in front of it in at least this share of its cells
SMALL_M2 = 0.12  # gaps with a smaller area are filled
PANE_M2 = (0.2, 25.0)
RECTANGULAR = 0.85  # a pane fills at least this share of its bounding rectangle
MIN_ROW = 0.3  # smallest number of cells in a row at the edge of a plane, relative to the median row
BESIDE_CELLS = 5
VISIBLE_SHARE, VIEWPOINTS, SAMPLES = 0.6, 3, 150  # at least VIEWPOINTS viewpoints must see this fraction of SAMPLES points in a pane


@dataclass(frozen=True, eq=False)
class Completed:
    """The result of `complete`: the mask of the completed plane without panes, the masks of the panes, the filled and the open area in
    m2, and the part of the filled area that lies in large gaps without an object in front of them.
    """

    mask: np.ndarray
    panes: list[np.ndarray]
    filled_m2: float = 0.0
    open_m2: float = 0.0
    closed_m2: float = 0.0


def complete(grid: Grid, mask: np.ndarray, points: np.ndarray, frame: np.ndarray | None = None, sight: Sight | None = None) -> Completed:
    """Decide for each gap in a plane whether to fill the gap, leave it open, or turn it into a pane of glass.

    Args:
        mask: boolean mask of the scanned cells of the plane.
        points: (N, 3) points of the whole scan in metres, thinned to a spacing of some cells.
        frame: boolean mask of the cells that the plane may cover, such as the rectangle that a wall spans; with None, only gaps that the
            plane encloses are considered.
        sight: test whether the gaps were visible to the sensor; with None, as for floors, no gap becomes a pane.
    """
    holes = np.asarray(binary_fill_holes(mask)) & ~mask
    gaps = holes if frame is None else (holes | (frame & ~mask))
    large = masks.pieces(gaps, SMALL_M2 / grid.cell_m**2)
    small = gaps & ~np.any(large, axis=0) if large else gaps
    out, panes = mask | small, []
    filled, opened, closed = grid.area(small), 0.0, 0.0
    if not large:
        return Completed(out, panes, filled)
    depth = points @ grid.normal - grid.offset_m  # height above the plane, positive on its visible side

    def between(low: float, high: float) -> np.ndarray:
        return masks.closed(grid.counts(points[(depth > low) & (depth < high)]) > 0, 0.05 / grid.cell_m)

    known = sight is not None and sight.cameras is not None
    behind = between(-3.0, -BEHIND_M)
    before = between(BEFORE_M, STANDS_M if grid.normal[2] > 0.9 else HIDES_M)
    close = between(BEFORE_M, CLOSE_M)
    for gap in (part for whole in large for part in _split(whole, mask, grid)):
        area = grid.area(gap)
        enclosed = bool((gap & holes).any())
        hidden = bool(before[gap].mean() > HIDDEN_SHARE)
        rectangular = sight is not None and _fills_rectangle(gap)
        framed = rectangular and _framed(gap, mask)
        door = framed and not (known or enclosed or hidden)
        if area >= SMALL_M2 and (door or behind[gap].mean() > OPEN_SHARE):
            opened += area
            continue
        pane = rectangular and PANE_M2[0] <= area <= PANE_M2[1] and (enclosed or (known and framed))
        if pane and close[gap].mean() <= HIDDEN_SHARE and sight is not None and _visible(grid, gap, mask, sight):
            panes.append(gap)
        elif enclosed or area < SMALL_M2 or hidden or not _walled_off(gap, mask, before):
            out |= gap
            filled += area
            closed += 0.0 if hidden or area < SMALL_M2 else area
    return Completed(out, panes, filled, opened, closed)


def spanned(mask: np.ndarray, possible: np.ndarray, min_share: float) -> np.ndarray | None:
    """Return a mask of the `possible` cells in the rectangle, along the grid axes, that a plane spans.

    The function returns None if the plane covers less than the fraction `min_share` of these cells.

    Nearly empty rows and columns at the border are ignored, because their cells are noise beyond the edge of the plane. A row in the tip
    of an acute corner is not nearly empty, because the walls leave few cells in the row.
    """
    if not mask.any():
        return None
    sides = []
    for k in range(2):
        counts, most = mask.sum(axis=1 - k), possible.sum(axis=1 - k)
        sides.append(np.flatnonzero(counts > MIN_ROW * np.minimum(np.median(counts[counts > 0]), most)))
    x, y = sides
    frame = np.zeros_like(mask)
    frame[x[0] : x[-1] + 1, y[0] : y[-1] + 1] = True
    frame &= possible
    return frame if (mask & frame).sum() >= min_share * frame.sum() else None


def within(grid: Grid, mask: np.ndarray, walls: Sequence[tuple[np.ndarray, float]]) -> np.ndarray:
    """Return a mask of the cells that are not behind a wall (normal, offset in metres).

    A wall is ignored if more than a small part of the scanned plane, the cells of `mask`, lies more than a cell behind it.
    """
    x, y = np.indices(mask.shape)
    places = grid.to_space(grid.low + (np.stack([x, y], axis=-1) + 0.5) * grid.cell_m)
    frame = np.ones_like(mask)
    for normal, offset in walls:
        before = places @ normal - offset
        if (mask & (before < -grid.cell_m)).sum() < MIN_ROW / 10 * mask.sum():
            frame &= before >= 0
    return frame


def _walled_off(gap: np.ndarray, mask: np.ndarray, before: np.ndarray) -> bool:
    """Return whether objects stand along the border of gap and plane, such as the inner walls of a room that is not rectangular."""
    border = masks.dilated(gap, 2) & mask
    return bool(border.any() and masks.dilated(before, 4)[border].mean() > 0.6)


def _visible(grid: Grid, gap: np.ndarray, mask: np.ndarray, sight: Sight) -> bool:
    """Return whether at least VIEWPOINTS, or half of those that see the plane beside the gap if fewer, see most of the gap."""

    def seen(where: np.ndarray) -> np.ndarray:
        cells = np.argwhere(where)
        cells = cells[:: max(1, len(cells) // SAMPLES)]
        return sight.seen(grid.to_space(grid.low + (cells + 0.5) * grid.cell_m), grid.normal)

    enough = min(VIEWPOINTS, max(1, len(sight.viewpoints) // 4))
    beside = seen(masks.dilated(gap, BESIDE_CELLS) & mask)
    if beside.size:
        enough = min(enough, max(1, int(np.median(beside)) // 2))
    return bool((seen(gap) >= enough).mean() > VISIBLE_SHARE)


def _split(gap: np.ndarray, mask: np.ndarray, grid: Grid) -> list[np.ndarray]:
    """Separate a window, the largest rectangle in the gap, from adjacent hidden parts of the wall; return their masks or the whole gap."""
    if _fills_rectangle(gap):
        return [gap]
    frame = np.zeros_like(gap)
    frame[_grown(gap, masks.largest_rectangle(masks.closed(gap, 1)))] = True
    if grid.area(frame) < max(PANE_M2[0], 0.5 * grid.area(gap)) or not _framed(frame, mask):
        return [gap]
    return [frame & ~mask, *masks.pieces(gap & ~frame)]


def _grown(gap: np.ndarray, inner: tuple[slice, slice]) -> tuple[slice, slice]:
    """Enlarge a rectangle inside a gap with ragged borders: move each side outwards while most of the next cells belong to the gap."""
    (x0, x1), (y0, y1) = ((side.start, side.stop) for side in inner)
    for _ in range(BESIDE_CELLS):
        x0 -= x0 > 0 and gap[x0 - 1, y0:y1].mean() > 0.5
        x1 += x1 < gap.shape[0] and gap[x1, y0:y1].mean() > 0.5
        y0 -= y0 > 0 and gap[x0:x1, y0 - 1].mean() > 0.5
        y1 += y1 < gap.shape[1] and gap[x0:x1, y1].mean() > 0.5
    return slice(x0, x1), slice(y0, y1)


def _fills_rectangle(gap: np.ndarray) -> bool:
    x, y = (np.flatnonzero(gap.any(axis=1 - k)) for k in range(2))
    return bool(gap.sum() >= RECTANGULAR * (x[-1] - x[0] + 1) * (y[-1] - y[0] + 1))


def _framed(gap: np.ndarray, mask: np.ndarray) -> bool:
    """Return whether the plane borders a gap on at least three sides, as a wall borders a glass door."""
    x, y = (np.flatnonzero(gap.any(axis=1 - k)) for k in range(2))
    cells = 3
    sides = (
        mask[max(x[0] - cells, 0) : x[0], y[0] : y[-1] + 1],
        mask[x[-1] + 1 : x[-1] + 1 + cells, y[0] : y[-1] + 1],
        mask[x[0] : x[-1] + 1, max(y[0] - cells, 0) : y[0]],
        mask[x[0] : x[-1] + 1, y[-1] + 1 : y[-1] + 1 + cells],
    )
    beside = [side.any(axis=axis).mean() > 0.6 if side.size else False for side, axis in zip(sides, (0, 0, 1, 1), strict=True)]
    return sum(beside) >= 3
