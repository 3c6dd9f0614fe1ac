"""Cut the squares of a ray-tube grid along the borders of smooth surface patches, as seen from the source of the tubes.

A tube has one footprint on the tangent plane of one patch. This is wrong for a tube that straddles the end of its patch, which is a sharp
edge (rim) or the end of an open surface. The tracer therefore divides the grid into squares between the centre rays of neighbouring tubes.
In a square that no border crosses, the four tubes at its corners overlap, and their weights sum to one. A square that borders cross is cut
along them into convex pieces, and the four tubes do not contribute there. The centre ray of a piece finds the patch to which the whole
piece belongs, and the footprint of the piece is the piece itself. A cut along the extension of a border, or along a border that another
surface hides, only yields two pieces of one patch.

In cell coordinates, the centre ray of cell (i, j) is at (i, j). Square (i, j) extends from (i - 1, j - 1) to (i, j).
"""

import math
import weakref
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, fixed, gathered, innermost
from radartwin.simulation.curved.tube_grid import MIN_DEPTH, TubeGrid
from radartwin.simulation.flat.convex import clip, copy
from radartwin.simulation.geometry import SMOOTH_EDGE_RAD, Geometry

CORNERS = 6  # largest number of corners of a piece
PIECES = 3  # number of smaller tubes, along each grid axis, in the width of a tube
LINES = 4  # largest number of cuts through one square; further borders in the square are ignored
SAME_LINE = 0.02  # borders that are closer than this to an earlier cut, in cells, do not cut it again
SLIVER = 1e-3  # smallest area of a piece, in cells
FIRST_ROWS = 1024  # number of pieces of a pose for which memory is reserved at first; the memory grows if needed
_MOST = CORNERS + 2  # largest number of corners while a square is cut: four plus one for each cut
_edges: "weakref.WeakKeyDictionary[Geometry, Edges]" = weakref.WeakKeyDictionary()


class Edges(NamedTuple):
    """Hold the E edges of a geometry at which a smooth patch ends.

    Attributes:
        ends: (E, 2, 3) both ends in metres. normal: (E, 2, 3) unit normals of the two faces; at an edge with one face, both are alike.
        solid: (E,) whether the edge belongs to a closed body, which is lit on its outside only. face: (E, 2) indices of the two faces.
        convex: (E,) whether the second face lies behind the plane of the first one.
    """

    ends: np.ndarray
    normal: np.ndarray
    solid: np.ndarray
    face: np.ndarray
    convex: np.ndarray


class Pieces(NamedTuple):
    """Hold P convex pieces of squares of a grid.

    Attributes:
        square: (P,) index of the square among the squares of all poses. centre: (P, 2) centroid of the piece in cell coordinates.
        corner: (P, CORNERS, 2) corners relative to the centroid, counter-clockwise; the last corner is repeated.
    """

    square: np.ndarray
    centre: np.ndarray
    corner: np.ndarray


def edges(geometry: Geometry) -> Edges:
    """Return the edges of a geometry at which a smooth patch ends. These are sharp edges and edges without exactly two faces."""
    if geometry not in _edges:
        _edges[geometry] = _sharp_edges(geometry)
    return _edges[geometry]


def _sharp_edges(geometry: Geometry) -> Edges:
    corners = geometry.corners
    points, index = geometry.points
    normals = geometry.area_vectors / np.linalg.norm(geometry.area_vectors, axis=1, keepdims=True)
    pairs = np.sort(np.stack([index, np.roll(index, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, first, of, count = np.unique(pairs[:, 0] * len(points) + pairs[:, 1], return_index=True, return_inverse=True, return_counts=True)
    last = np.zeros(len(first), int)
    np.maximum.at(last, of.ravel(), np.arange(len(pairs)))
    face = np.stack([first // 3, last // 3], axis=1)
    angle = np.arccos(np.clip(np.einsum("ei,ei->e", normals[face[:, 0]], normals[face[:, 1]]), -1, 1))
    single = count != 2
    keep = single | (angle > SMOOTH_EDGE_RAD)
    face = face[keep]
    ends = points[pairs[first[keep]]]
    beyond = corners[face[:, 1]].mean(axis=1) - ends[:, 0]
    convex = ~single[keep] & (np.einsum("ei,ei->e", beyond, normals[face[:, 0]]) < 0)
    solid = ~single[keep] & (geometry.hollow_m[face] > 0).all(axis=1)
    return Edges(*map(fixed, (ends, normals[face], solid, face, convex)))


def cut(
    geometry: Geometry, grid: TubeGrid, poses: tuple[int, int], fine: np.ndarray | None = None, among: np.ndarray | None = None
) -> Pieces:
    """Cut the squares of the sensor poses `poses[0]` to `poses[1]` - 1 of a grid along the borders of the geometry's patches.

    The pieces in the squares of the mask `fine` (poses, rows + 1, columns + 1) are PIECES times smaller along each axis.

    Only borders of faces in the mask `among` (faces,) count; None: all.

    Returns:
        The pieces of all squares that a border crosses, in ascending order of squares.
    """
    borders = edges(geometry)
    if among is not None:
        near = among[borders.face].any(axis=1)
        borders = Edges(*(fixed(values[near]) for values in borders))
    if fine is None:
        fine = np.zeros((1, grid.count_v + 1, grid.count_u + 1), bool)
    frame = np.stack([grid.forward, grid.u_axis, grid.v_axis], axis=1)
    scale = np.stack([grid.low_u, grid.low_v, grid.step_u, grid.step_v], axis=1)
    places = [fixed(np.asarray(values, float)) for values in (grid.source, frame, scale)]

    def written(begin: int, stop: int, rows: int) -> list[np.ndarray] | None:
        rows *= stop - begin
        out = Pieces(np.empty(rows, np.int64), np.empty((rows, 2)), np.empty((rows, CORNERS, 2)))
        count = _cut(poses[0] + begin, poses[0] + stop, *borders[:3], *places, fine, poses[0], grid.plane, out)
        return [array[:count] for array in out] if count >= 0 else None

    return Pieces(*gathered(written, poses[1] - poses[0], FIRST_ROWS))


@compiled
def _cut(begin, stop, ends, normal, solid, source, frame, scale, fine, origin, plane, out):  # fmt: skip
    """Compute `cut` for the poses `begin` to `stop` - 1. Returns the number of pieces, or -1 if `out` is too short."""
    count = 0
    rows, columns = fine.shape[1:]
    capacity = 4 * (rows + columns) + 4 * len(ends)
    cell, line = np.empty(capacity, np.int64), np.empty((capacity, 4))
    at = np.empty((2, 2))
    # corners in the plane of the third coordinate zero
    pieces, counts = np.zeros((PIECES * PIECES << LINES, _MOST, 3)), np.empty(PIECES * PIECES << LINES, np.int64)
    spare, lines = np.zeros((2, _MOST, 3)), np.empty((LINES, 3))
    for f in range(begin, stop):
        # The parts of the borders in each square, as `line`: both ends relative to the centre of the square.
        number = 0
        for e in range(len(ends)):
            if not _is_border(ends[e], normal[e], solid[e], source[f], frame[f, 0], plane):
                continue
            if not _projected(ends[e], source[f], frame[f], scale[f], plane, at):
                continue
            needed = int(abs(at[1, 0] - at[0, 0]) + abs(at[1, 1] - at[0, 1])) + 4
            if number + needed > len(cell):
                more, further = np.empty(2 * (number + needed), np.int64), np.empty((2 * (number + needed), 4))
                more[:number], further[:number] = cell[:number], line[:number]
                cell, line = more, further
            number = _mark(at, rows, columns, cell, line, number)
        order = np.argsort(cell[:number].astype(np.float64), kind="mergesort")  # Numba compiles one sort for each type
        low = 0
        while low < number:
            here = cell[order[low]]
            high = low + 1
            while high < number and cell[order[high]] == here:
                high += 1
            square = f * rows * columns + here
            side = PIECES if fine[(f - origin) % len(fine), here // columns, here % columns] else 1
            count = _divide(
                order[low:high], line, square, rows, columns, side, pieces, counts, spare, lines, out.square, out.centre, out.corner, count
            )
            if count < 0:
                return -1
            low = high
    return count


@innermost
def _is_border(ends, normal, solid, source, forward, plane):
    """Return whether the source can see an edge: on a closed body, whether one of its two faces is lit."""
    first, second = 0.0, 0.0
    for i in range(3):
        way = -forward[i] if plane else source[i] - ends[0, i]
        first += way * normal[0, i]
        second += way * normal[1, i]
    return not solid or first > 0 or second > 0


@innermost
def _projected(ends, source, frame, scale, plane, at):
    """Write both ends of an edge, in squares from the first one, to `at` (2, 2). Returns False if an end is not in front of the source."""
    for i in range(2):
        depth, u, v, square = 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            way = ends[i, k] - source[k]
            depth += way * frame[0, k]
            u += way * frame[1, k]
            v += way * frame[2, k]
            square += way * way
        if not plane:
            if depth <= MIN_DEPTH * math.sqrt(square):
                return False
            u, v = u / depth, v / depth
        at[i, 0], at[i, 1] = (u - scale[0]) / scale[2] + 0.5, (v - scale[1]) / scale[3] + 0.5
    return True


@innermost
def _mark(at: np.ndarray, rows: int, columns: int, cell: np.ndarray, line: np.ndarray, number: int) -> int:
    """Add the part of the segment `at` (2, 2) in each square that it crosses. Returns the number of parts."""
    u0, v0, u1, v1 = at[0, 0], at[0, 1], at[1, 0], at[1, 1]
    if v0 > v1:
        u0, v0, u1, v1 = u1, v1, u0, v0
    for j in range(max(0, math.floor(v0 + 0.5)), min(rows - 1, math.floor(v1 + 0.5)) + 1):
        # the part of the segment in this row of squares
        begin, end = 0.0, 1.0
        if v1 > v0:
            begin, end = max(0.0, (j - 0.5 - v0) / (v1 - v0)), min(1.0, (j + 0.5 - v0) / (v1 - v0))
        left, right = u0 + begin * (u1 - u0), u0 + end * (u1 - u0)
        for i in range(max(0, math.floor(min(left, right) + 0.5)), min(columns - 1, math.floor(max(left, right) + 0.5)) + 1):
            t0, t1 = begin, end
            if abs(u1 - u0) > 1e-12:
                a, b = (i - 0.5 - u0) / (u1 - u0), (i + 0.5 - u0) / (u1 - u0)
                t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
            if t1 > t0 and number < len(cell):
                cell[number] = j * columns + i
                line[number, 0], line[number, 1] = u0 + t0 * (u1 - u0) - i, v0 + t0 * (v1 - v0) - j
                line[number, 2], line[number, 3] = u0 + t1 * (u1 - u0) - i, v0 + t1 * (v1 - v0) - j
                number += 1
    return number


@innermost
def _divide(order, line, cell, rows, columns, side, pieces, counts, spare, lines, out_square, out_centre, out_corner, count: int) -> int:
    """Cut one square, or the `side`^2 smaller ones in it, along the lines `order`, and write the pieces. Returns the number of pieces,
    or -1 if the output is too short.
    """
    row, column = cell % (rows * columns) // columns, cell % columns
    # the cuts, longest first, as coefficients of the signed distance a x + b y - c
    cuts = 0
    for _ in range(len(order)):
        best, size = -1, SAME_LINE
        for n in range(len(order)):
            k = order[n]
            if k >= 0 and math.hypot(line[k, 2] - line[k, 0], line[k, 3] - line[k, 1]) > size:
                best, size = n, math.hypot(line[k, 2] - line[k, 0], line[k, 3] - line[k, 1])
        if best < 0 or cuts == LINES:
            break
        order[best], best = -1, order[best]
        known = False
        for i in range(cuts):
            a, b, c = lines[i, 0], lines[i, 1], lines[i, 2]
            known |= (
                abs(a * line[best, 0] + b * line[best, 1] - c) < SAME_LINE and abs(a * line[best, 2] + b * line[best, 3] - c) < SAME_LINE
            )
        if not known:
            a, b = (line[best, 3] - line[best, 1]) / size, (line[best, 0] - line[best, 2]) / size
            lines[cuts, 0], lines[cuts, 1], lines[cuts, 2] = a, b, a * line[best, 0] + b * line[best, 1]
            cuts += 1
    # the square, or the side x side smaller ones that it consists of
    number = side * side
    for p in range(number):
        for i in range(4):
            pieces[p, i, 0] = (p % side + (1 if i in (1, 2) else 0)) / side - 0.5
            pieces[p, i, 1] = (p // side + (1 if i > 1 else 0)) / side - 0.5
        counts[p] = 4
    # each cut divides every piece that has a part on both of its sides
    for i in range(cuts):
        for p in range(number):
            left = clip(pieces[p], counts[p], (lines[i, 0], lines[i, 1], 0.0), lines[i, 2], spare[0])
            right = clip(pieces[p], counts[p], (-lines[i, 0], -lines[i, 1], 0.0), -lines[i, 2], spare[1])
            if left and right:
                copy(spare[0], left, pieces[p])
                copy(spare[1], right, pieces[number])
                counts[p], counts[number] = left, right
                number += 1
    for p in range(number):
        # a piece of more than CORNERS corners becomes two
        start = 1
        while start < counts[p] - 1:
            end = min(start + CORNERS - 2, counts[p] - 1)
            if count == len(out_square):
                return -1
            # area and centroid, from triangles at corner 0
            area, x, y = 0.0, 0.0, 0.0
            for k in range(start, end):
                ax, ay = pieces[p, k, 0] - pieces[p, 0, 0], pieces[p, k, 1] - pieces[p, 0, 1]
                bx, by = pieces[p, k + 1, 0] - pieces[p, 0, 0], pieces[p, k + 1, 1] - pieces[p, 0, 1]
                part = 0.5 * (ax * by - ay * bx)
                area += part
                x += part * (ax + bx) / 3
                y += part * (ay + by) / 3
            if area > SLIVER / (side * side):
                x, y = pieces[p, 0, 0] + x / area, pieces[p, 0, 1] + y / area
                out_square[count], out_centre[count, 0], out_centre[count, 1] = cell, column - 0.5 + x, row - 0.5 + y
                for k in range(CORNERS):
                    source = 0 if k == 0 else min(start + k - 1, end)
                    out_corner[count, k, 0], out_corner[count, k, 1] = pieces[p, source, 0] - x, pieces[p, source, 1] - y
                count += 1
            start = end
    return count
