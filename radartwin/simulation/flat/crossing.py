"""Fields of waves at a face and across sheets (panes) on a straight line, and the factors of the field for N straight lines.

A pane multiplies the field component across the plane of incidence by its TE transmission coefficient, and the component in this plane by
its TM transmission coefficient. The tables hold the field behind the pane over the field there in air, so that the path keeps its straight
length (`reflection_table`). The line does not bend, because the layers are parallel, and the small sideways shift of the ray inside the
layers is left out.

The mesh of a pane should be one sheet of triangles, with all layers in its material. A line crosses a closed box twice, and each crossing
counts as a pane with all layers of the material. Triangles of one surface at the same place count once, because a line through the common
side of two triangles hits both.
"""

import numpy as np

from radartwin.compiled import compiled, fixed, innermost, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Point, Vector, crossed
from radartwin.simulation.flat.vectors import cross, distance, dot, norm, toward, unit, vector
from radartwin.simulation.reflection_table import ReflectionTable, lagrange_basis

SAME_M = 1e-6  # triangles of one surface that a line meets within this distance count once


@innermost
def _normal(tree: Hierarchy, t: int) -> Vector:
    """Return the unit normal of triangle `t`."""
    return unit(cross(vector(tree.edge_a, t), vector(tree.edge_b, t)))


@innermost
def _place(tree: Hierarchy, t: int, start: Point, way: Vector) -> float:
    """Return the distance in metres from `start` to the plane of triangle `t` along a line of the unit direction `way`."""
    normal = _normal(tree, t)
    return dot(toward(start, vector(tree.corner, t), 1.0), normal) / dot(way, normal)


@innermost
def looked_up(values: np.ndarray, surface: int, cosine: float, q: int) -> complex:
    """Return a coefficient of a table (surfaces, C, Q), interpolated linearly in the cosine of incidence."""
    x = min(max(cosine, 0.0), 1.0) * (values.shape[1] - 1)
    low = min(int(x), values.shape[1] - 2)
    return values[surface, low, q] * (1 - x + low) + values[surface, low + 1, q] * (x - low)


@innermost
def at_face(te: np.ndarray, tm: np.ndarray, surface: int, normal: Vector, before: Vector, after: Vector, field: np.ndarray) -> None:
    """Multiply the TE and the TM component of a field (Q, 3) in place by the coefficients of a face, for unit directions of travel before
    and after the face.
    """
    s = cross(before, normal)
    if norm(s) < 1e-7:
        s = cross(normal, (1.0, 0.0, 0.0) if abs(normal[0]) < 0.9 else (0.0, 1.0, 0.0))
    s = unit(s)
    cosine, before_p, after_p = abs(dot(before, normal)), cross(before, s), cross(after, s)
    for q in range(len(field)):
        along_s = field[q, 0] * s[0] + field[q, 1] * s[1] + field[q, 2] * s[2]
        along_p = field[q, 0] * before_p[0] + field[q, 1] * before_p[1] + field[q, 2] * before_p[2]
        along_s, along_p = along_s * looked_up(te, surface, cosine, q), along_p * looked_up(tm, surface, cosine, q)
        for k in range(3):
            field[q, k] = along_s * s[k] + along_p * after_p[k]


@innermost
def cross_panes(
    tree: Hierarchy, te: np.ndarray, tm: np.ndarray, start: Point, stop: Point, pane_ids: np.ndarray, count: int, field: np.ndarray
) -> None:
    """Multiply a field in place by the transmission of the panes between two points.

    Args:
        te, tm: (surfaces, C, Q) transmission tables.
        start, stop: (3,) ends of the line; the direction of travel does not matter.
        pane_ids, count: triangles on the line, from `obstacles.crossed`.
        field: (Q, 3) field across the line.
    """
    if count == 0:
        return
    way = toward(start, stop, distance(start, stop))
    for i in range(count):
        t = pane_ids[i]
        place, known = _place(tree, t, start, way), False
        for j in range(i):
            other = pane_ids[j]
            known |= tree.label[other] == tree.label[t] and abs(_place(tree, other, start, way) - place) < SAME_M
        if not known:
            at_face(te, tm, tree.label[t], _normal(tree, t), way, way, field)


@compiled
def _fill(
    begin: int, stop: int, tree: Hierarchy, opaque: np.ndarray, te: np.ndarray, tm: np.ndarray, start: np.ndarray,
    end: np.ndarray, unit: np.ndarray, ways: int, panes: np.ndarray, factor: np.ndarray,
) -> None:  # fmt: skip
    """Compute the panes and factors of the lines `begin` to `stop` - 1 for `factors`."""
    pane_ids, field = np.empty(MAX_PANES, np.int64), np.empty((te.shape[2], 3), np.complex128)
    for n in range(begin, stop):
        panes[n] = crossed(tree, start[n], end[n], opaque, pane_ids)
        for q in range(te.shape[2]):
            factor[n, q] = 1 + min(panes[n], 0)
            for k in range(3):
                field[q, k] = unit[n, k]
        if panes[n] <= 0:
            continue
        for _ in range(ways):
            cross_panes(tree, te, tm, start[n], end[n], pane_ids, panes[n], field)
        for q in range(te.shape[2]):
            factor[n, q] = field[q, 0] * unit[n, 0] + field[q, 1] * unit[n, 1] + field[q, 2] * unit[n, 2]


def delayed(factor: np.ndarray, nodes_hz: np.ndarray, at_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Convert factors at frequency nodes to a factor at one frequency and a length that carries the delay of the layers.

    Args:
        factor: (N, Q) result of `factors`. nodes_hz: (Q,) frequency nodes. at_hz: frequency of a path with one node.
    Returns:
        value: (N,) factor at `at_hz` for exp(+j omega t), without the phase of the length `extra_m`.
        extra_m: (N,) length in metres that carries the delay, for all passes along the line together.
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
    """Return the number of triangles of panes on straight lines, and the factor on a field of one polarisation along the lines.

    Args:
        tree: triangles of the surfaces of the table.
        start, end: (N, 3) ends of the lines. A triangle within `obstacles.CLEAR_M` of an end does not count.
        unit: (N, 3) unit vector of the field, across the line. The factor is the component along `unit` of the field that has
            crossed the panes `ways` times.
        ways: number of times the field travels along the line: 1, or 2 for there and back.
    Returns:
        panes: (N,) number of triangles of panes on each line; -1 for a blocked line, 0 for a free one.
        factor: (N, Q) complex factor for exp(+j omega t) at the frequency nodes of the table; 0 for a blocked line, 1 for a free one.
    """
    n = len(start)
    panes, factor = np.zeros(n, np.int64), np.zeros((n, len(table.frequencies_hz)), complex)
    points = (np.ascontiguousarray(values, float) for values in (start, end, unit))
    arguments = tree, table.opaque, fixed(table.through_te), fixed(table.through_tm), *points, ways
    shared_out(_fill, n, *arguments, panes, factor)
    return panes, factor
