"""What a depth sensor missed of a plane: behind furniture the wall goes on, in an empty frame there is glass.

A gap in a plane is one of four things. Through an opening something was seen behind the plane; it stays open. In front of a hidden
part stands something; the plane goes on behind it. An empty frame showed nothing although nothing hid it, as glass and mirrors do; it
becomes a pane of its own. What is small is noise and is filled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.reconstruct.outlines.grid import Grid
from radartwin.reconstruct.outlines.visibility import Sight
from radartwin.reconstruct.segmentation import masks

BEHIND_M = 0.10  # deeper than noise and the reveal of a window
BEFORE_M = 0.04  # what stands in front is farther than noise
CLOSE_M = 0.25  # what is nearer than this hides it from everywhere, lines of sight need not tell
HIDES_M = 1.2  # ... and no farther than this: a chair two metres away hides only what it moves along
STANDS_M = 2.6  # ... but what stands on a floor hides it however high its top is
OPEN_SHARE = 0.35  # of a gap through which something was seen
HIDDEN_SHARE = 0.3  # of a gap in front of which something stands
SMALL_M2 = 0.12  # gaps below this are filled
PANE_M2 = (0.2, 25.0)
RECTANGULAR = 0.85  # share of its bounding rectangle that a pane fills
OUTLYING = 0.3  # of the usual row that a row at the edge holds at least
BESIDE_CELLS = 5
VISIBLE, FROM, SAMPLES = 0.6, 3, 150  # share of a pane seen from so many places, of so many samples


@dataclass(frozen=True, eq=False)
class Completed:
    """Masks of a grid: what the plane covers after completion, and panes apart; areas in m2."""

    mask: np.ndarray
    panes: list[np.ndarray]
    filled_m2: float
    open_m2: float


def complete(grid: Grid, mask: np.ndarray, points: np.ndarray, frame: np.ndarray | None = None, sight: Sight | None = None) -> Completed:
    """Gaps of a plane decided.

    Args:
        mask: cells that the plane was seen in.
        points: (N, 3) of the whole scan, some cells apart.
        frame: cells that the plane could cover, as the rectangle a wall spans; only holes are looked at without it.
        sight: what could be seen of the gaps; without it no frame holds a pane, as none of a floor's does.
    """
    holes = masks.filled(mask) & ~mask
    gaps = holes if frame is None else (holes | (frame & ~mask))
    if not gaps.any():
        return Completed(mask, [], 0.0, 0.0)
    depth = grid.depth(points)
    behind = masks.closed(grid.cells(points[(depth < -BEHIND_M) & (depth > -3.0)]), 0.05 / grid.cell_m)
    before = masks.closed(
        grid.cells(points[(depth > BEFORE_M) & (depth < (STANDS_M if grid.normal[2] > 0.9 else HIDES_M))]), 0.05 / grid.cell_m
    )
    beside = masks.closed(grid.cells(points[(depth > BEFORE_M) & (depth < CLOSE_M)]), 0.05 / grid.cell_m)
    out, found = mask.copy(), []
    filled = opened = 0.0
    for gap in (part for whole in masks.pieces(gaps) for part in _parted(whole, mask, grid)):
        area = grid.area(gap)
        enclosed = bool((gap & holes).any())
        if area >= SMALL_M2 and behind[gap].mean() > OPEN_SHARE:
            opened += area
            continue
        pane = (
            sight is not None
            and PANE_M2[0] <= area <= PANE_M2[1]
            and _fills_rectangle(gap)
            and (enclosed or (sight.cameras is not None and _framed(gap, mask)))
        )
        if pane and beside[gap].mean() <= HIDDEN_SHARE and sight is not None and _visible(grid, gap, mask, sight):
            found.append(gap)
        elif enclosed or area < SMALL_M2 or before[gap].mean() > HIDDEN_SHARE or not _walled_off(gap, mask, before):
            out |= gap
            filled += area
    return Completed(out, found, filled, opened)


def spanned(mask: np.ndarray, least: float) -> np.ndarray | None:
    """The rectangle along the grid's axes that a plane spans, or None if it covers less than `least` of it.

    Rows and columns that are nearly empty, as noise beyond an edge is, do not count.
    """
    if not mask.any():
        return None
    sides = []
    for k in range(2):
        counts = mask.sum(axis=1 - k)
        sides.append(np.flatnonzero(counts > OUTLYING * np.median(counts[counts > 0])))
    x, y = sides
    frame = np.zeros_like(mask)
    frame[x[0] : x[-1] + 1, y[0] : y[-1] + 1] = True
    return frame if (mask & frame).sum() >= least * frame.sum() else None


def within(grid: Grid, frame: np.ndarray, mask: np.ndarray, walls: Sequence[tuple[np.ndarray, float]]) -> np.ndarray:
    """The frame less what lies behind walls (normal, offset) that hardly any of the plane lies behind."""
    x, y = np.indices(mask.shape)
    places = grid.to_space(grid.low + (np.stack([x, y], axis=-1) + 0.5) * grid.cell_m)
    for normal, offset in walls:
        behind = places @ normal < offset
        if (mask & behind).sum() < OUTLYING / 10 * mask.sum():
            frame = frame & ~behind
    return frame


def _walled_off(gap: np.ndarray, mask: np.ndarray, before: np.ndarray) -> bool:
    """Whether something stands all along the border between a gap and the plane, as walls do where a room has a corner less."""
    border = masks.dilated(gap, 2) & mask
    return bool(border.any() and masks.dilated(before, 4)[border].mean() > 0.6)


def _visible(grid: Grid, gap: np.ndarray, mask: np.ndarray, sight: Sight) -> bool:
    """Whether most of a gap could be seen from several places, or half as often as the plane beside it: what hides it is not furniture."""

    def seen(where: np.ndarray) -> np.ndarray:
        cells = np.argwhere(where)
        cells = cells[:: max(1, len(cells) // SAMPLES)]
        return sight.seen(grid.to_space(grid.low + (cells + 0.5) * grid.cell_m), grid.normal)

    often = min(FROM, max(1, len(sight.viewpoints) // 4))
    beside = seen(masks.dilated(gap, BESIDE_CELLS) & mask)
    if beside.size:
        often = min(often, max(1, int(np.median(beside)) // 2))
    return bool((seen(gap) >= often).mean() > VISIBLE)


def _parted(gap: np.ndarray, mask: np.ndarray, grid: Grid) -> list[np.ndarray]:
    """A gap, or the frame in it and the rest, where a window and what furniture hides of the wall run together."""
    if _fills_rectangle(gap):
        return [gap]
    frame = np.zeros_like(gap)
    frame[_grown(gap, masks.largest_rectangle(masks.closed(gap, 1)))] = True
    if grid.area(frame) < max(PANE_M2[0], 0.5 * grid.area(gap)) or not _framed(frame, mask):
        return [gap]
    return [frame & ~mask, *masks.pieces(gap & ~frame)]


def _grown(gap: np.ndarray, inner: tuple[slice, slice]) -> tuple[slice, slice]:
    """A rectangle inside a ragged gap moved out, side by side, while most of the next cells are of the gap."""
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
    """Whether the plane stands on three sides of a gap, as it does round a glass door."""
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
