"""Pictures of yes and no: what mathematical morphology does to them, on radii in cells."""

from __future__ import annotations

from typing import Any

import numpy as np


def disc(radius: float) -> np.ndarray:
    """Structuring element of a radius in cells; never smaller than a cell's four neighbours."""
    r = max(1, round(radius))
    x, y = np.mgrid[-r : r + 1, -r : r + 1]
    return x * x + y * y <= r * r + 0.5 * r


def opened(mask: np.ndarray, radius: float) -> np.ndarray:
    """Without what is narrower than twice the radius, or than the radius along the border, in which the picture is taken to be mirrored."""
    from scipy.ndimage import binary_opening

    element = disc(radius)
    pad = len(element)
    return np.asarray(binary_opening(np.pad(mask, pad, mode="symmetric"), element))[pad:-pad, pad:-pad]


def closed(mask: np.ndarray, radius: float) -> np.ndarray:
    """With gaps narrower than twice the radius filled."""
    from scipy.ndimage import binary_closing

    element = disc(radius)
    pad = len(element)
    return np.asarray(binary_closing(np.pad(mask, pad), element))[pad:-pad, pad:-pad] | mask


def dilated(mask: np.ndarray, cells: int, within: np.ndarray | None = None) -> np.ndarray:
    """Grown by so many cells, not beyond `within`."""
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(mask, iterations=cells, mask=within))


def filled(mask: np.ndarray) -> np.ndarray:
    """With enclosed holes filled."""
    from scipy.ndimage import binary_fill_holes

    return np.asarray(binary_fill_holes(mask))


def pieces(mask: np.ndarray) -> list[np.ndarray]:
    """Its connected parts, one mask each."""
    from scipy.ndimage import label

    numbers: Any = label(mask)
    return [numbers[0] == k for k in range(1, numbers[1] + 1)]


def distance(mask: np.ndarray) -> np.ndarray:
    """Cells from each cell to the nearest of the mask."""
    from scipy.ndimage import distance_transform_edt

    return np.asarray(distance_transform_edt(~mask))


def nearest(mask: np.ndarray) -> tuple[np.ndarray, ...]:
    """Index of the nearest cell of the mask, for each cell."""
    from scipy.ndimage import distance_transform_edt

    index: Any = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return tuple(index)


def largest_rectangle(mask: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of the largest rectangle of the mask's cells: under each row, the largest in a histogram of the cells above it."""
    height = np.zeros(mask.shape[1], dtype=int)
    best, area = (slice(0, 0), slice(0, 0)), 0
    for row, cells in enumerate(mask):
        height = np.where(cells, height + 1, 0)
        open_at: list[tuple[int, int]] = []  # column and height of rectangles that may go on
        for column, tall in enumerate([*height.tolist(), 0]):
            start = column
            while open_at and open_at[-1][1] >= tall:
                start, above = open_at.pop()
                if above * (column - start) > area:
                    area = above * (column - start)
                    best = slice(row + 1 - above, row + 1), slice(start, column)
            open_at.append((start, tall))
    return best
