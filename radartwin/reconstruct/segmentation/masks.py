"""Apply morphological operations to boolean masks (H, W), with radii in cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage


def opened(mask: np.ndarray, radius: float) -> np.ndarray:
    """Remove the parts of a mask narrower than twice `radius` cells. At the border of the array, the mask is continued by mirroring."""
    element = _disc(radius)
    pad = len(element)
    return np.asarray(ndimage.binary_opening(np.pad(mask, pad, mode="symmetric"), element))[pad:-pad, pad:-pad]


def closed(mask: np.ndarray, radius: float) -> np.ndarray:
    """Fill the gaps of a mask that are narrower than twice `radius` cells."""
    element = _disc(radius)
    pad = len(element)
    return np.asarray(ndimage.binary_closing(np.pad(mask, pad), element))[pad:-pad, pad:-pad] | mask


def dilated(mask: np.ndarray, cells: int, within: np.ndarray | None = None) -> np.ndarray:
    """Grow the mask by a number of cells on all sides; with the mask `within`, only inside `within`."""
    return np.asarray(ndimage.binary_dilation(mask, iterations=cells, mask=within))


def pieces(mask: np.ndarray, least: float = 1) -> list[np.ndarray]:
    """Return the connected parts of a mask that have at least `least` cells as a list of masks, one per part."""
    numbers: Any = ndimage.label(mask)[0]  # type: ignore[index]
    return [numbers == k for k in np.flatnonzero(np.bincount(numbers.ravel())[1:] >= least) + 1]


def distance(mask: np.ndarray) -> np.ndarray:
    """Return the distance, in cells, from each cell to the nearest cell that the mask marks."""
    return np.asarray(ndimage.distance_transform_edt(~mask))


def nearest(mask: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return, for each cell, the row and column index of the nearest cell that the mask marks."""
    index: Any = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return tuple(index)


def largest_rectangle(mask: np.ndarray) -> tuple[slice, slice]:
    """Return the slices of rows and columns of the largest rectangle in which the mask marks every cell.

    The algorithm finds the largest rectangle in the histogram of marked cells above each row.
    """
    height = np.zeros(mask.shape[1], dtype=int)
    best, area = (slice(0, 0), slice(0, 0)), 0
    for row, cells in enumerate(mask):
        height = np.where(cells, height + 1, 0)
        growing: list[tuple[int, int]] = []  # start column and height of the rectangles that may extend further to the right
        for column, tall in enumerate([*height.tolist(), 0]):
            start = column
            while growing and growing[-1][1] >= tall:
                start, above = growing.pop()
                if above * (column - start) > area:
                    area = above * (column - start)
                    best = slice(row + 1 - above, row + 1), slice(start, column)
            growing.append((start, tall))
    return best


def _disc(radius: float) -> np.ndarray:
    """Return a disc-shaped boolean array as structuring element. The radius of the disc is in cells and is at least one cell."""
    r = max(1, round(radius))
    x, y = np.mgrid[-r : r + 1, -r : r + 1]
    return x * x + y * y <= r * r + 0.5 * r
