"""Fields of waves that cross sheets (panes) along a straight line, and the strengths of N straight lines.

A pane multiplies the parts of the field across and in its plane of incidence by its TE and TM transmission coefficients. The tables hold
the field behind the pane over the field there in air, so that the path keeps its straight length (`reflection_table`). The line does not
bend, because the layers are parallel, and the small sideways shift of the ray inside the layers is left out.

The mesh of a pane should be one sheet of triangles, with all layers in its material. A closed box with two walls is two panes, and each
wall has all layers of the material. Triangles of one surface at the same place count once, because a line through the common side of two
triangles hits both.
"""

import math

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Point, crossed
from radartwin.simulation.reflection_table import ReflectionTable, lagrange_basis

SAME_M = 1e-6  # triangles of one surface that a line meets within this distance count once


@compiled
def cross_panes(
    tree: Hierarchy, te: np.ndarray, tm: np.ndarray, start: Point, stop: Point, found: np.ndarray, count: int, field: np.ndarray
) -> None:
    """Multiply a field in place by the transmission of the panes between two points.

    Args:
        te, tm: (surfaces, C, Q) transmission tables.
        start, stop: (3,) ends of the line; the direction of travel does not matter.
        found, count: triangles on the line, from `obstacles.crossed`.
        field: (Q, 3) field across the line.
    """
    if count == 0:
        return
    way = np.array((stop[0] - start[0], stop[1] - start[1], stop[2] - start[2]))
    length = math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    place = np.empty(count)
    for i in range(count):
        t = found[i]
        normal = np.cross(tree.edge_a[t], tree.edge_b[t])
        size = math.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
        height, along = 0.0, 0.0
        for k in range(3):
            normal[k] /= size
            height += (tree.corner[t, k] - start[k]) * normal[k]
            along += way[k] * normal[k]
        place[i] = height / along * length
        known = False
        for j in range(i):
            if tree.label[found[j]] == tree.label[t] and abs(place[j] - place[i]) < SAME_M:
                known = True
        if known:
            continue
        s = np.cross(way, normal)
        size = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
        if size < 1e-7 * length:
            s = np.cross(normal, np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0]))
            size = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
        for k in range(3):
            s[k] /= size
        p = np.cross(way, s) / length
        x = min(abs(along) / length, 1.0) * (te.shape[1] - 1)
        low = min(int(x), te.shape[1] - 2)
        share = x - low
        surface = tree.label[t]
        for q in range(field.shape[0]):
            across, within = 0j, 0j
            for k in range(3):
                across += field[q, k] * s[k]
                within += field[q, k] * p[k]
            across *= te[surface, low, q] * (1 - share) + te[surface, low + 1, q] * share
            within *= tm[surface, low, q] * (1 - share) + tm[surface, low + 1, q] * share
            for k in range(3):
                field[q, k] = across * s[k] + within * p[k]


@compiled
def _fill(
    begin: int, stop: int, tree: Hierarchy, opaque: np.ndarray, te: np.ndarray, tm: np.ndarray, start: np.ndarray, end: np.ndarray,
    unit: np.ndarray, ways: int, panes: np.ndarray, factor: np.ndarray,
) -> None:  # fmt: skip
    """Compute the panes and factors of the lines `begin` to `stop` - 1 for `factors`."""
    found = np.empty(MAX_PANES, np.int64)
    field = np.empty((te.shape[2], 3), np.complex128)
    for n in range(begin, stop):
        panes[n] = crossed(tree, start[n], end[n], opaque, found)
        if panes[n] <= 0:
            factor[n] = 1 + panes[n]
            continue
        field[:] = unit[n]
        for _ in range(ways):
            cross_panes(tree, te, tm, start[n], end[n], found, panes[n], field)
        for q in range(te.shape[2]):
            factor[n, q] = field[q, 0] * unit[n, 0] + field[q, 1] * unit[n, 1] + field[q, 2] * unit[n, 2]


def delayed(factor: np.ndarray, nodes_hz: np.ndarray, at_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Convert factors at frequency nodes to a factor at one frequency and a length that carries the delay of the layers.

    Args:
        factor: (N, Q) result of `factors`. nodes_hz: (Q,) frequency nodes. at_hz: frequency of a path with one node.
    Returns:
        value: (N,) factor at `at_hz` for exp(+j omega t), without the phase of the length. extra_m: (N,) length in metres, of all ways.
    """
    wavenumber = 2 * np.pi / SPEED_OF_LIGHT * (nodes_hz - at_hz)
    extra = np.zeros(len(factor))
    if len(nodes_hz) > 1 and len(factor):
        steps = np.cumsum(np.angle(factor[:, 1:] * factor[:, :-1].conj()), axis=1)  # unwrapped phase from the first node
        extra = -steps @ np.linalg.pinv(np.stack([wavenumber, np.ones_like(wavenumber)], axis=1))[0, 1:]
    value = (factor @ lagrange_basis(nodes_hz, np.array([at_hz])))[:, 0]
    return value * np.exp(2j * np.pi * at_hz / SPEED_OF_LIGHT * extra), extra


def factors(
    tree: Hierarchy, table: ReflectionTable, start: np.ndarray, end: np.ndarray, unit: np.ndarray, ways: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Return what straight lines cross, and the factor on a field of one polarisation that travels along them.

    Args:
        tree: triangles of the surfaces of the table.
        start, end: (N, 3) ends of the lines. A triangle within `obstacles.CLEAR_M` of an end does not count.
        unit: (N, 3) unit vector of the field, across the line. The factor is the component of the field behind the panes along it.
        ways: number of times the field travels along the line: 1, or 2 for there and back.
    Returns:
        panes: (N,) number of triangles of panes on each line; -1 for a blocked line, 0 for a free one.
        factor: (N, Q) complex factor for exp(+j omega t) at the frequency nodes of the table; 0 for a blocked line, 1 for a free one.
    """
    n = len(start)
    panes, factor = np.zeros(n, np.int64), np.zeros((n, len(table.frequencies_hz)), complex)
    points = (np.ascontiguousarray(values, float) for values in (start, end, unit))
    shared_out(_fill, n, tree, table.opaque, table.through_te, table.through_tm, *points, ways, panes, factor)
    return panes, factor
