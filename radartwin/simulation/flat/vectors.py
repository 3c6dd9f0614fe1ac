"""Compiled functions of points and vectors in space, for innermost loops."""

import math

import numpy as np

from radartwin.compiled import innermost
from radartwin.simulation.flat.obstacles import Point, Vector

ZERO = (0.0, 0.0, 0.0)


@innermost
def norm(x: Point) -> float:
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@innermost
def dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@innermost
def distance(a: Point, b: Point) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@innermost
def vector(values: np.ndarray, i: int) -> Vector:
    """Return row `i` of an array (N, 3) as a tuple. Points of innermost loops are tuples, because small arrays are slow to create."""
    return float(values[i, 0]), float(values[i, 1]), float(values[i, 2])


@innermost
def moved(start: Point, along: Point, place: float) -> Vector:
    """Return start + place * along."""
    return start[0] + place * along[0], start[1] + place * along[1], start[2] + place * along[2]


@innermost
def toward(start: Point, end: Point, length: float) -> Vector:
    """Return (end - start)/length."""
    return (end[0] - start[0]) / length, (end[1] - start[1]) / length, (end[2] - start[2]) / length


@innermost
def unit(x: Point) -> Vector:
    """Return a vector divided by its length."""
    return toward(ZERO, x, norm(x))


@innermost
def put(out: np.ndarray, i: int, point: Point) -> None:
    """Write a point to row `i` of an array (N, 3)."""
    out[i, 0], out[i, 1], out[i, 2] = point[0], point[1], point[2]


@innermost
def beside_line(start: Point, along: Point, source: Point, receiver: Point) -> tuple[float, float, float, float]:
    """Return the places in metres along a line that are closest to source and receiver, and the squared distances of both from the line."""
    z_s, z_r = dot(toward(start, source, 1.0), along), dot(toward(start, receiver, 1.0), along)
    return z_s, z_r, distance(source, moved(start, along, z_s)) ** 2, distance(receiver, moved(start, along, z_r)) ** 2


@innermost
def cross(a: Point, b: Point) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@innermost
def transverse(axis: Point, direction: Point) -> Vector:
    """Return the normalised component of an axis perpendicular to a direction; for a parallel direction, a fixed perpendicular."""
    across = moved(axis, direction, -dot(axis, direction))
    if norm(across) < 1e-6:
        across = cross(axis, (0.6, 0.0, 0.8) if abs(axis[2]) < 0.9 else (0.8, 0.6, 0.0))
    return unit(across)
