"""Lines of sight between points, tested against triangles through a hierarchy of bounding boxes."""

import math
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost

LEAF = 4  # largest number of triangles of a leaf
STACK = 64  # number of boxes that can wait to be split; one for each level of the hierarchy is enough
PADDING_M = 1e-9  # boxes are larger by this, because of rounding errors
CLEAR_M = 1e-5  # a triangle closer than this to an end of a line does not block it, because the end lies on that triangle
MAX_PANES = 8  # a line that crosses more surfaces that transmit counts as blocked; eight panes of glass leave -50 dB
Vector = tuple[float, float, float]
Point = np.ndarray | Vector  # compiled functions take either; tuples are faster to create


class Hierarchy(NamedTuple):
    """Hold T triangles in a binary tree of M boxes. In the array `box`, the boxes that are inside a box come directly after it.

    Attributes:
        box: (M, 6) lowest and highest corner. beyond: (M,) the next box that is not inside this one.
        first, stop: (M,) range of the triangles of a leaf; empty for other boxes.
        corner, edge_a, edge_b: (T, 3) a corner of each triangle and the two edges from it. label: (T,) number of each triangle's surface.
    """

    box: np.ndarray
    beyond: np.ndarray
    first: np.ndarray
    stop: np.ndarray
    corner: np.ndarray
    edge_a: np.ndarray
    edge_b: np.ndarray
    label: np.ndarray


def build(triangles: np.ndarray, label: np.ndarray) -> Hierarchy:
    """Build the hierarchy of triangles (T, 3, 3) with labels (T,)."""
    order = np.arange(len(triangles))
    box = np.zeros((2 * len(triangles), 6))
    beyond, first, stop = np.zeros((3, len(box)), np.int64)
    count = _split(triangles.min(axis=1), triangles.max(axis=1), order, box, beyond, first, stop) if len(triangles) else 0
    corners = triangles[order]
    label = np.ascontiguousarray(label[order], np.int64)
    edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return Hierarchy(box[:count], beyond[:count], first[:count], stop[:count], corners[:, 0].copy(), *edges, label)


@compiled
def _split(
    low: np.ndarray, high: np.ndarray, order: np.ndarray, box: np.ndarray, beyond: np.ndarray, first: np.ndarray, stop: np.ndarray
) -> int:
    """Sort `order` into leaves and fill the boxes; returns the number of boxes."""
    stack = np.zeros((STACK, 2), np.int64)
    stack[0, 1] = len(order)
    depth, count = 1, 0
    while depth:
        depth -= 1
        begin, end = stack[depth]
        node = count
        count += 1
        first[node], stop[node] = begin, end
        for k in range(3):
            box[node, k], box[node, 3 + k] = np.inf, -np.inf
            for i in range(begin, end):
                box[node, k] = min(box[node, k], low[order[i], k])
                box[node, 3 + k] = max(box[node, 3 + k], high[order[i], k])
        if end - begin <= LEAF:
            continue
        longest = 0
        for k in range(1, 3):
            if box[node, 3 + k] - box[node, k] > box[node, 3 + longest] - box[node, longest]:
                longest = k
        middle = low[order[begin:end], longest] + high[order[begin:end], longest]
        order[begin:end] = order[begin:end][np.argsort(middle, kind="mergesort")]
        half = (begin + end) // 2
        stack[depth, 0], stack[depth, 1] = half, end
        stack[depth + 1, 0], stack[depth + 1, 1] = begin, half
        depth += 2
    for node in range(count - 1, -1, -1):
        beyond[node] = node + 1
        while beyond[node] < count and first[beyond[node]] < stop[node]:
            beyond[node] = beyond[beyond[node]]
    for node in range(count):
        if beyond[node] > node + 1:
            stop[node] = first[node]
    return count


@innermost
def _meets(tree: Hierarchy, t: int, x: float, y: float, z: float, way_x: float, way_y: float, way_z: float, clear: float) -> bool:
    """Return whether a line crosses triangle `t`, farther than `clear` (relative to its length) from both ends."""
    a, b = tree.edge_a, tree.edge_b
    px, py, pz = way_y * b[t, 2] - way_z * b[t, 1], way_z * b[t, 0] - way_x * b[t, 2], way_x * b[t, 1] - way_y * b[t, 0]
    volume = a[t, 0] * px + a[t, 1] * py + a[t, 2] * pz
    if abs(volume) < 1e-14:
        return False
    x, y, z = x - tree.corner[t, 0], y - tree.corner[t, 1], z - tree.corner[t, 2]
    u = (x * px + y * py + z * pz) / volume
    if u < 0 or u > 1:
        return False
    qx, qy, qz = y * a[t, 2] - z * a[t, 1], z * a[t, 0] - x * a[t, 2], x * a[t, 1] - y * a[t, 0]
    v = (way_x * qx + way_y * qy + way_z * qz) / volume
    if v < 0 or u + v > 1:
        return False
    s = (b[t, 0] * qx + b[t, 1] * qy + b[t, 2] * qz) / volume
    return clear < s < 1 - clear


@innermost
def _inverse(way: float) -> float:
    return 1 / way if abs(way) > 1e-12 else 1e30


@innermost
def crossed(tree: Hierarchy, start: Point, stop: Point, opaque: np.ndarray, pane_ids: np.ndarray) -> int:
    """Return the number of triangles between two points, or -1 if one of these triangles belongs to an opaque surface.

    Args:
        opaque: (surfaces,) whether a surface blocks. pane_ids: (MAX_PANES,) receives the triangles of surfaces that transmit.
    """
    x, y, z = start[0], start[1], start[2]
    way_x, way_y, way_z = stop[0] - x, stop[1] - y, stop[2] - z
    length = math.sqrt(way_x * way_x + way_y * way_y + way_z * way_z)
    if length < 2 * CLEAR_M:
        return 0
    clear = CLEAR_M / length
    per_x, per_y, per_z = _inverse(way_x), _inverse(way_y), _inverse(way_z)
    box, node, count = tree.box, 0, 0
    while node < len(box):
        a, b = (box[node, 0] - PADDING_M - x) * per_x, (box[node, 3] + PADDING_M - x) * per_x
        low, high = min(a, b), max(a, b)
        a, b = (box[node, 1] - PADDING_M - y) * per_y, (box[node, 4] + PADDING_M - y) * per_y
        low, high = max(low, min(a, b)), min(high, max(a, b))
        a, b = (box[node, 2] - PADDING_M - z) * per_z, (box[node, 5] + PADDING_M - z) * per_z
        low, high = max(low, min(a, b)), min(high, max(a, b))
        if low > high or high < 0 or low > 1:
            node = tree.beyond[node]
            continue
        for t in range(tree.first[node], tree.stop[node]):
            if _meets(tree, t, x, y, z, way_x, way_y, way_z, clear):
                if opaque[tree.label[t]] or count == len(pane_ids):
                    return -1
                pane_ids[count] = t
                count += 1
        node += 1
    return count
