"""Convex polygons in space, for compiled functions. A polygon is an array (M, 3) of which the first `count` rows are corners."""

import numpy as np

from radartwin.compiled import innermost
from radartwin.simulation.flat.obstacles import Vector
from radartwin.simulation.flat.vectors import cross, dot, moved, norm, toward, vector


@innermost
def clip(polygon: np.ndarray, count: int, normal: Vector, offset: float, out: np.ndarray) -> int:
    """Write the part of a polygon with normal . x >= offset to `out`, without corners for which `out` is too short. Returns the number of
    corners.
    """
    kept = 0
    previous = count - 1
    before = dot(normal, vector(polygon, previous)) - offset
    for i in range(count):
        here = dot(normal, vector(polygon, i)) - offset
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
def copy(polygon: np.ndarray, count: int, out: np.ndarray) -> None:
    """Write the corners of a polygon to `out`."""
    for i in range(count):
        for k in range(3):
            out[i, k] = polygon[i, k]


@innermost
def twice_area(polygon: np.ndarray, count: int) -> float:
    """Return twice the area of a polygon."""
    total, first = (0.0, 0.0, 0.0), vector(polygon, 0)
    for i in range(1, count - 1):
        part = cross(toward(first, vector(polygon, i), 1.0), toward(first, vector(polygon, i + 1), 1.0))
        total = moved(total, part, 1.0)
    return norm(total)
