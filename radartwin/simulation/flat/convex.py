"""Convex polygons in space, for compiled functions. A polygon is an array (M, 3) of which the first `count` rows are corners."""

import math

import numpy as np

from radartwin.compiled import innermost


@innermost
def clip(polygon: np.ndarray, count: int, nx: float, ny: float, nz: float, offset: float, out: np.ndarray) -> int:
    """Write the part of a polygon with n . x >= offset to `out`, without corners for which `out` is too short. Returns the number of
    corners.
    """
    kept = 0
    previous = count - 1
    before = nx * polygon[previous, 0] + ny * polygon[previous, 1] + nz * polygon[previous, 2] - offset
    for i in range(count):
        here = nx * polygon[i, 0] + ny * polygon[i, 1] + nz * polygon[i, 2] - offset
        if (here >= 0) != (before >= 0) and kept < len(out):
            share = before / (before - here)
            for k in range(3):
                out[kept, k] = polygon[previous, k] + share * (polygon[i, k] - polygon[previous, k])
            kept += 1
        if here >= 0 and kept < len(out):
            for k in range(3):
                out[kept, k] = polygon[i, k]
            kept += 1
        previous, before = i, here
    return kept if kept > 2 else 0


@innermost
def twice_area(polygon: np.ndarray, count: int) -> float:
    """Return twice the area of a polygon."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(1, count - 1):
        ax, ay, az = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1], polygon[i, 2] - polygon[0, 2]
        bx, by, bz = polygon[i + 1, 0] - polygon[0, 0], polygon[i + 1, 1] - polygon[0, 1], polygon[i + 1, 2] - polygon[0, 2]
        x += ay * bz - az * by
        y += az * bx - ax * bz
        z += ax * by - ay * bx
    return math.sqrt(x * x + y * y + z * z)
