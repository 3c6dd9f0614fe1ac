"""Lines of sight between points, tested against triangles through a hierarchy of bounding boxes."""

from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost

LEAF = 4  # largest number of triangles of a leaf
DEPTH = 64  # largest depth of the hierarchy
CLEAR_M = 1e-5  # a triangle closer than this to an end of a line does not block it, because the end lies on that triangle
MAX_PANES = 8  # a line that crosses more surfaces that transmit counts as blocked


class Hierarchy(NamedTuple):
    """Hold T triangles in a binary tree of M boxes.

    Attributes:
        box: (M, 6) lowest and highest corner. children: (M, 2) boxes, or for a leaf -1 - first triangle and the end of its range.
        corner, edge_a, edge_b: (T, 3) a corner of each triangle and the two edges from it. label: (T,) number of each triangle's surface.
    """

    box: np.ndarray
    children: np.ndarray
    corner: np.ndarray
    edge_a: np.ndarray
    edge_b: np.ndarray
    label: np.ndarray


def build(triangles: np.ndarray, label: np.ndarray) -> Hierarchy:
    """Build the hierarchy of triangles (T, 3, 3) with labels (T,)."""
    order = np.arange(len(triangles))
    box = np.zeros((max(1, 2 * len(triangles)), 6))
    children = np.zeros((len(box), 2), np.int64)
    if not len(triangles):
        none = np.zeros((0, 3))
        return Hierarchy(np.zeros((1, 6)), np.array([[-1, 0]]), none, none, none, np.zeros(0, np.int64))
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    used = _split(low, high, order, box, children)
    one = triangles[order]
    return Hierarchy(
        box[:used],
        children[:used],
        one[:, 0].copy(),
        one[:, 1] - one[:, 0],
        one[:, 2] - one[:, 0],
        np.ascontiguousarray(label[order], np.int64),
    )


@compiled
def _split(low: np.ndarray, high: np.ndarray, order: np.ndarray, box: np.ndarray, children: np.ndarray) -> int:
    """Sort `order` into leaves and fill the boxes; returns the number of boxes."""
    stack = np.zeros((2 * DEPTH, 3), np.int64)
    stack[0, 2] = len(order)
    depth, used = 1, 1
    while depth:
        depth -= 1
        node, first, last = stack[depth]
        for k in range(3):
            box[node, k], box[node, 3 + k] = np.inf, -np.inf
            for i in range(first, last):
                box[node, k] = min(box[node, k], low[order[i], k])
                box[node, 3 + k] = max(box[node, 3 + k], high[order[i], k])
        if last - first <= LEAF or depth >= 2 * DEPTH - 2:
            children[node, 0], children[node, 1] = -1 - first, last
            continue
        longest = 0
        for k in range(1, 3):
            if box[node, 3 + k] - box[node, k] > box[node, 3 + longest] - box[node, longest]:
                longest = k
        middle = low[order[first:last], longest] + high[order[first:last], longest]
        order[first:last] = order[first:last][np.argsort(middle, kind="mergesort")]
        half = (first + last) // 2
        children[node, 0], children[node, 1] = used, used + 1
        stack[depth, 0], stack[depth, 1], stack[depth, 2] = used, first, half
        stack[depth + 1, 0], stack[depth + 1, 1], stack[depth + 1, 2] = used + 1, half, last
        depth += 2
        used += 2
    return used


@innermost
def _meets_box(box: np.ndarray, node: int, start: np.ndarray, way: np.ndarray) -> bool:
    first, last = 0.0, 1.0
    for k in range(3):
        if abs(way[k]) < 1e-12:
            if start[k] < box[node, k] - 1e-9 or start[k] > box[node, 3 + k] + 1e-9:
                return False
        else:
            a, b = (box[node, k] - 1e-9 - start[k]) / way[k], (box[node, 3 + k] + 1e-9 - start[k]) / way[k]
            if a > b:
                a, b = b, a
            first, last = max(first, a), min(last, b)
            if first > last:
                return False
    return True


@innermost
def _meets(tree: Hierarchy, t: int, start: np.ndarray, way: np.ndarray, clear: float) -> bool:
    """Return whether a line crosses triangle `t`, farther than `clear` (relative to its length) from both ends."""
    a, b = tree.edge_a, tree.edge_b
    px, py, pz = way[1] * b[t, 2] - way[2] * b[t, 1], way[2] * b[t, 0] - way[0] * b[t, 2], way[0] * b[t, 1] - way[1] * b[t, 0]
    volume = a[t, 0] * px + a[t, 1] * py + a[t, 2] * pz
    if abs(volume) < 1e-14:
        return False
    x, y, z = start[0] - tree.corner[t, 0], start[1] - tree.corner[t, 1], start[2] - tree.corner[t, 2]
    u = (x * px + y * py + z * pz) / volume
    if u < 0 or u > 1:
        return False
    qx, qy, qz = y * a[t, 2] - z * a[t, 1], z * a[t, 0] - x * a[t, 2], x * a[t, 1] - y * a[t, 0]
    v = (way[0] * qx + way[1] * qy + way[2] * qz) / volume
    if v < 0 or u + v > 1:
        return False
    s = (b[t, 0] * qx + b[t, 1] * qy + b[t, 2] * qz) / volume
    return clear < s < 1 - clear


@compiled
def crossed(tree: Hierarchy, start: np.ndarray, stop: np.ndarray, opaque: np.ndarray, found: np.ndarray) -> int:
    """Return the number of triangles between two points, or -1 if one of them belongs to an opaque surface.

    Args:
        opaque: (surfaces,) whether a surface blocks. found: (MAX_PANES,) receives the triangles of surfaces that transmit.
    """
    way = stop - start
    length = np.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    if length < 2 * CLEAR_M or len(tree.label) == 0:
        return 0
    clear = CLEAR_M / length
    stack = np.empty(2 * DEPTH, np.int64)
    stack[0] = 0
    depth, count = 1, 0
    while depth:
        depth -= 1
        node = stack[depth]
        if not _meets_box(tree.box, node, start, way):
            continue
        if tree.children[node, 0] >= 0:
            stack[depth], stack[depth + 1] = tree.children[node, 0], tree.children[node, 1]
            depth += 2
            continue
        for t in range(-1 - tree.children[node, 0], tree.children[node, 1]):
            if _meets(tree, t, start, way, clear):
                if opaque[tree.label[t]] or count == len(found):
                    return -1
                found[count] = t
                count += 1
    return count
