"""The outline of a body as seen from a point.

The outline is a set of closed polygons around everything that the body hides from the point. Overlapping parts of the body count once, and
a hole is a polygon of its own. Horizontal rows divide the view of the body. In each row, the edges at which the body begins or ends give
the intervals that it covers. The ends of the intervals of successive rows form the polygons, whose points lie on the body. Points that
move a polygon by less than a tolerance are left out, so that the number of its edges does not depend on the facets of the mesh. Where a
flat face is seen almost edge-on, both of its edges hide the same lines. The polygon passes between them, at the mean of their depths, so
that it does not jump from one edge to the other one when the body turns.
"""

import math
from typing import NamedTuple

import numpy as np
import trimesh

from radartwin.compiled import inner, innermost
from radartwin.simulation.flat.obstacles import Hierarchy, Point, Vector, build
from radartwin.simulation.flat.vectors import cross, distance, dot, moved, put, toward, unit, vector
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.pruning import TARGET_ERROR

TOLERANCE = TARGET_ERROR  # of an outline, divided by the square root of wavelength times distance; about the error of a shadow factor
MAX_ROWS = 512
FEW = 64  # up to this number of mesh edges in an outline, the picture also has rows at their ends
FOLDED = 0.94  # an edge is sharp if the cosine between its faces is smaller, or if it has one face
MAX_INTERVALS = 32  # an outline with this number of intervals in a row gets a larger tolerance
MAX_SEGMENTS = 192  # largest number of edges of an outline; an outline that needs more gets a larger tolerance
CLIP = 0.02  # faces with a corner nearer than this share of the distance to the body, or behind the viewer, hide nothing


class Skin(NamedTuple):
    """Hold the surface of a body with V vertices, F faces and E edges.

    Attributes:
        vertex: (V, 3) metres. corners: (F, 3) vertices of each face. normal: (F, 3). height: (F,) normal . corner of each face. sheet:
            (F,) whether a face belongs to an open mesh, which hides from both sides.
        ends: (E, 2) vertices of each edge. faces: (E, 2) its faces; -1: none. forward: (E, 2) whether the order of the corners of each of
            these faces runs along the edge.
        centre: (3,) of a ball around the body. radius: (1,) of this ball.
        sharp: (S, 2, 3) ends of all edges between faces of different directions; none if they are more than FEW.
        tree: triangles of the body. opaque: (surfaces,) true.
    """

    vertex: np.ndarray
    corners: np.ndarray
    normal: np.ndarray
    height: np.ndarray
    sheet: np.ndarray
    ends: np.ndarray
    faces: np.ndarray
    forward: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    sharp: np.ndarray
    tree: Hierarchy
    opaque: np.ndarray


def skin(geometry: Geometry) -> Skin:
    """Prepare the triangles of a geometry."""
    mesh = trimesh.Trimesh(geometry.corners.reshape(-1, 3), np.arange(3 * len(geometry.corners)).reshape(-1, 3), process=False)
    mesh.merge_vertices(digits_vertex=7)
    triangles, vertex = np.asarray(mesh.faces, np.int64), np.ascontiguousarray(mesh.vertices, float)
    normal = np.cross(*np.diff(geometry.corners, axis=1).transpose(1, 0, 2)).reshape(-1, 3)
    ends, forward, face = (np.asarray(x) for x in (mesh.edges_sorted, mesh.edges[:, 0] < mesh.edges[:, 1], mesh.edges_face))
    number, times = np.unique(ends @ [len(vertex), 1], return_inverse=True, return_counts=True)[1:]
    order = np.argsort(number, kind="stable")
    pair, alone = np.split(order[np.argsort(times[number[order]] != 2, kind="stable")], [2 * np.count_nonzero(times == 2)])
    # an edge of one face, or of more than two, is the border of each of its faces
    rows, other = np.concatenate([pair[::2], alone]), np.concatenate([pair[1::2], np.full(len(alone), -1)])
    faces = np.stack([face[rows], np.where(other < 0, -1, face[other])], axis=1)
    ways = np.stack([forward[rows], forward[other]], axis=1)
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    folded = (other < 0) | (np.einsum("ni,ni->n", unit[faces[:, 0]], unit[faces[:, 1]]) < FOLDED)
    sharp = vertex[ends[rows][folded]] if folded.sum() <= FEW else np.zeros((0, 2, 3))
    low, high = vertex.min(axis=0), vertex.max(axis=0)
    centre = (low + high) / 2
    radius = np.linalg.norm(vertex - centre, axis=1).max(keepdims=True)
    height = np.einsum("fi,fi->f", normal, geometry.corners[:, 0])
    return Skin(
        vertex, triangles, normal, height, geometry.hollow_m <= 0, ends[rows], faces, ways, centre, radius, sharp,
        build(geometry.corners, geometry.surface), np.ones(int(geometry.surface.max(initial=0)) + 1, bool),
    )  # fmt: skip


@inner
def outline(body: Skin, viewer: np.ndarray, wavenumber: float, out: np.ndarray) -> int:
    """Write the outline of a body as seen from `viewer` (3,) to `out` (MAX_SEGMENTS, 2, 3). Returns its number of edges.

    Each edge has a start a and an end b in metres. A line of sight to a point q passes on the body's side of the edge if the triple product
    of a, b and q, all relative to the viewer, is positive.
    """
    away = distance(body.centre, viewer)
    if away < 1e-6:
        return 0
    frame = picture_axes(toward(viewer, body.centre, away))
    seen = np.empty(body.vertex.shape)
    edges, steps = _borders(body, viewer, frame, away, seen)
    if not len(edges):
        return 0
    tolerance = TOLERANCE * math.sqrt(2 * math.pi / wavenumber * away)
    few = len(edges) <= FEW
    while True:
        rows = _rows(body, edges, seen, 4 * tolerance, few)
        left, right, count = _intervals(body, edges, steps, seen, rows, tolerance)
        number = _polygons(rows, left, right, count, tolerance, out) if count.max() < MAX_INTERVALS else -1
        if number >= 0:
            break
        tolerance, few = 2 * tolerance, False
    sharp = np.empty(body.sharp.shape)
    for i in range(2 * len(sharp)):
        put(sharp[i // 2], i % 2, _projected(body.sharp[i // 2, i % 2], viewer, frame, away))
    number = _between(sharp, wavenumber, away, out, number)
    for e in range(number):
        for k in range(2):  # from the picture to space
            right_m, up_m, depth = vector(out[e], k)
            point = moved(moved(frame[2], frame[0], right_m / away), frame[1], up_m / away)
            put(out[e], k, moved(viewer, point, depth))
    return number


@innermost
def picture_axes(view: Point) -> tuple[Vector, Vector, Vector]:
    """Return the axes of a picture: to the right, up, and the direction of view (3,)."""
    up = (1.0, 0.0, 0.0) if abs(view[2]) > 0.9 else (0.0, 0.0, 1.0)
    up = unit(moved(up, view, -dot(up, view)))
    return cross(up, view), up, (view[0], view[1], view[2])


@innermost
def _projected(point: Point, viewer: Point, frame: tuple, away: float) -> Vector:
    """Return a point (3,) in the picture: to the right and up in metres at the distance `away`, and the depth in metres."""
    way = toward(viewer, point, 1.0)
    depth = max(dot(frame[2], way), CLIP * away)
    return dot(frame[0], way) * away / depth, dot(frame[1], way) * away / depth, depth


@inner
def _borders(body: Skin, viewer: np.ndarray, frame: tuple, away: float, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (N,) at which the number of layers changes, and the change (N,) of this number from left to right. The places of
    their ends in the picture are written to `seen` (V, 3).

    A layer is a face that hides the space behind it: a face that looks at the viewer if its mesh is closed, and any face of an open mesh.
    """
    # 1 for a layer whose corners run clockwise in the picture, -1 if they run counter-clockwise, and 0 for any other face. All edges of a
    # face use this one number, so that the changes in a row cancel even for a face seen edge-on.
    layer, close = np.empty(len(body.corners), np.int8), away - body.radius[0] <= CLIP * away
    for f in range(len(layer)):
        side = dot(viewer, body.normal[f]) - body.height[f]
        layer[f] = 1 if side > 0 else -1 if body.sheet[f] else 0
        for k in range(3 if close else 0):
            if dot(frame[2], toward(viewer, body.vertex[body.corners[f, k]], 1.0)) <= CLIP * away:
                layer[f] = 0
    edges, steps = np.empty(len(body.ends), np.int64), np.empty(len(body.ends), np.int64)
    count = 0
    for e in range(len(body.ends)):
        face, other = body.faces[e]
        step = layer[face] if body.forward[e, 0] else -layer[face]
        if other >= 0:
            step += layer[other] if body.forward[e, 1] else -layer[other]
        if step:
            for k in range(2):
                put(seen, body.ends[e, k], _projected(body.vertex[body.ends[e, k]], viewer, frame, away))
            rises = seen[body.ends[e, 0], 1] <= seen[body.ends[e, 1], 1]
            edges[count], steps[count] = e, step if rises else -step
            count += 1
    return edges[:count], steps[:count]


@inner
def _rows(body: Skin, edges: np.ndarray, seen: np.ndarray, spacing: float, at_ends: bool) -> np.ndarray:
    """Return the increasing heights of the rows of the picture; with `at_ends`, also heights slightly above and below each end of the
    edges.
    """
    low, high = np.inf, -np.inf
    for e in edges:
        for k in range(2):
            low, high = min(low, seen[body.ends[e, k], 1]), max(high, seen[body.ends[e, k], 1])
    aside = 1e-6 * (high - low)
    count = int(min(MAX_ROWS, math.ceil((high - low) / spacing) + 1))
    rows = np.linspace(low + aside, high - aside, max(count, 2))
    if not at_ends:
        return rows
    more = np.empty(4 * len(edges))
    for i in range(len(edges)):
        for k in range(2):
            at = seen[body.ends[edges[i], k], 1]
            more[4 * i + 2 * k], more[4 * i + 2 * k + 1] = max(at - aside, low + aside), min(at + aside, high - aside)
    return np.unique(np.concatenate((rows, more)))


@inner
def _intervals(
    body: Skin, edges: np.ndarray, steps: np.ndarray, seen: np.ndarray, rows: np.ndarray, narrowest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the left and right ends (R, MAX_INTERVALS, 2) of the intervals that the body covers in each row, and their number (R,).

    An end has a place to the right and a depth, in metres. Gaps below `narrowest` metres are closed; intervals beyond MAX_INTERVALS - 1 are
    left out.
    """
    first = np.zeros(len(rows) + 1, np.int64)
    spans = np.empty((len(edges), 2), np.int64)
    for i in range(len(edges)):
        a, b = seen[body.ends[edges[i], 0], 1], seen[body.ends[edges[i], 1], 1]
        spans[i, 0], spans[i, 1] = np.searchsorted(rows, min(a, b)), np.searchsorted(rows, max(a, b))
        first[spans[i, 0] + 1 : spans[i, 1] + 1] += 1
    first = np.cumsum(first)
    place, step, filled = np.empty((first[-1], 2)), np.empty(first[-1], np.int64), np.zeros(len(rows), np.int64)
    for i in range(len(edges)):
        low, high = body.ends[edges[i], 0], body.ends[edges[i], 1]
        for row in range(spans[i, 0], spans[i, 1]):
            share = (rows[row] - seen[low, 1]) / (seen[high, 1] - seen[low, 1])
            at = seen[low, 0] + share * (seen[high, 0] - seen[low, 0])
            depth = seen[low, 2] + share * (seen[high, 2] - seen[low, 2])
            n = first[row] + filled[row]
            while n > first[row] and place[n - 1, 0] > at:
                place[n], step[n] = place[n - 1], step[n - 1]
                n -= 1
            place[n, 0], place[n, 1], step[n] = at, depth, steps[i]
            filled[row] += 1
    left, right = np.empty((len(rows), MAX_INTERVALS, 2)), np.empty((len(rows), MAX_INTERVALS, 2))
    count = np.zeros(len(rows), np.int64)
    for row in range(len(rows)):
        layers = 0
        for n in range(first[row], first[row + 1]):
            before, layers = layers, layers + step[n]
            if before <= 0 < layers:
                if count[row] > 0 and place[n, 0] - right[row, count[row] - 1, 0] < narrowest:
                    count[row] -= 1  # the interval before goes on
                elif count[row] < MAX_INTERVALS:
                    left[row, count[row]] = place[n]
            elif layers <= 0 < before and count[row] < MAX_INTERVALS:
                right[row, count[row]] = place[n]
                count[row] += 1
    return left, right, count


@inner
def _polygons(rows: np.ndarray, left: np.ndarray, right: np.ndarray, count: np.ndarray, tolerance: float, out: np.ndarray) -> int:
    """Write the edges of the polygons around the intervals of all rows to `out`, in the picture; -1 if they are too many."""
    total, begin = 0, 0
    chain, kept = np.empty((len(rows) + 2, 3)), np.empty(len(rows) + 2, np.int64)
    while begin < len(rows):
        stop = begin + 1  # the intervals of the rows `begin` to `stop` - 1 continue each other
        while stop < len(rows) and _continue(left, right, count, stop):
            stop += 1
        bottom = rows[begin] if begin == 0 else 0.5 * (rows[begin] + rows[begin - 1])
        top = rows[stop - 1] if stop == len(rows) else 0.5 * (rows[stop - 1] + rows[stop])
        for k in range(count[begin]):
            for side in range(2):
                ends = right if side else left
                n = 0
                for row in range(begin - 1, stop + 1):
                    inside = min(max(row, begin), stop - 1)
                    chain[n, 0], chain[n, 2] = ends[inside, k, 0], ends[inside, k, 1]
                    chain[n, 1] = bottom if row < begin else top if row == stop else rows[row]
                    n += 1
                points = _thinned(chain[:n], tolerance, kept)
                if total + points + 1 > len(out):
                    return -1
                for i in range(1, points):  # the right side goes up, the left side down
                    a, b = (kept[i - 1], kept[i]) if side else (kept[i], kept[i - 1])
                    out[total, 0], out[total, 1] = chain[a], chain[b]
                    total += 1
            for high in range(2):  # the bottom goes to the right, the top to the left
                row, height = (stop - 1, top) if high else (begin, bottom)
                for end in range(2):
                    ends = right if end != high else left
                    out[total, end, 0], out[total, end, 1], out[total, end, 2] = ends[row, k, 0], height, ends[row, k, 1]
                total += 1
                if total >= len(out):
                    return -1
        begin = stop
    return total


@inner
def _between(sharp: np.ndarray, wavenumber: float, away: float, out: np.ndarray, number: int) -> int:
    """Move the corners of polygons in the picture to the mean depth of sharp edges (S, 2, 3) beside them. Returns the number of edges.

    The first `number` edges of `out` (MAX_SEGMENTS, 2, 3) change. The polygons get additional corners where corners of the body are near.
    """
    low, high, count = np.inf, -np.inf, 0
    for i in range(len(sharp)):  # keep the edges in front of the viewer
        if min(sharp[i, 0, 2], sharp[i, 1, 2]) > CLIP * away:
            low, high = min(low, sharp[i, 0, 2], sharp[i, 1, 2]), max(high, sharp[i, 0, 2], sharp[i, 1, 2])
            sharp[count] = sharp[i]
            count += 1
    if not high - low > 1e-6:
        return number
    # Two edges at a distance x in the picture count together if the phase k x^2/depth between them is below about 2 rad.
    sharp, reach = sharp[:count], math.sqrt(math.pi / wavenumber * (high - low)) * 2 * away / (low + high)
    places = np.empty(2 * len(sharp))
    for e in range(number):
        x, y, count = out[e, 1, 0] - out[e, 0, 0], out[e, 1, 1] - out[e, 0, 1], 0
        square = x * x + y * y
        for i in range(len(places)):
            u, v = sharp[i // 2, i % 2, 0] - out[e, 0, 0], sharp[i // 2, i % 2, 1] - out[e, 0, 1]
            share = (u * x + v * y) / max(square, 1e-18)
            if square > 1e-12 and 1e-3 < share < 1 - 1e-3 and abs(u * y - v * x) < reach * math.sqrt(square):
                places[count] = share
                count += 1
        at, end = np.sort(places[:count]), 1.0
        for i in range(count - 1, -1, -1):
            if end - at[i] >= 1e-3 and number < len(out):
                out[number, 1] = out[e, 1]
                out[e, 1] = out[number, 0] = out[e, 0] + at[i] / end * (out[e, 1] - out[e, 0])
                number, end = number + 1, at[i]
    for e in range(number):
        for k in range(2):
            out[e, k, 2] = _mean_depth(sharp, out[e, k], reach)
    return number


@innermost
def _mean_depth(sharp: np.ndarray, point: np.ndarray, reach: float) -> float:
    """Return the mean depth of the edges (S, 2, 3) in the picture that are within `reach` of a point, with weights that fall with the
    distance.
    """
    total, weights = 0.0, 0.0
    for i in range(len(sharp)):
        x, y = sharp[i, 1, 0] - sharp[i, 0, 0], sharp[i, 1, 1] - sharp[i, 0, 1]
        u, v = point[0] - sharp[i, 0, 0], point[1] - sharp[i, 0, 1]
        share = min(max((u * x + v * y) / max(x * x + y * y, 1e-18), 0.0), 1.0)
        square = ((u - share * x) ** 2 + (v - share * y) ** 2) / (reach * reach)
        if square < 1:
            weight = (1 - square) ** 2
            # along a straight edge, the inverse of the depth is linear in the picture
            total += weight / ((1 - share) / sharp[i, 0, 2] + share / sharp[i, 1, 2])
            weights += weight
    return total / weights if weights > 1e-3 else point[2]


@innermost
def _continue(left: np.ndarray, right: np.ndarray, count: np.ndarray, row: int) -> bool:
    """Return whether each interval of a row overlaps the interval of the row before with the same number, and no other."""
    if count[row] != count[row - 1]:
        return False
    for k in range(count[row]):
        if left[row, k, 0] > right[row - 1, k, 0] or right[row, k, 0] < left[row - 1, k, 0]:
            return False
        if k and (left[row, k, 0] < right[row - 1, k - 1, 0] or right[row, k - 1, 0] > left[row - 1, k, 0]):
            return False
    return True


@innermost
def _thinned(chain: np.ndarray, tolerance: float, kept: np.ndarray) -> int:
    """Write to `kept` the indices of those points of a rising chain (N, 3) that a polyline within the tolerance needs.

    Returns the number of these points.
    """
    kept[0], count, anchor, low, high = 0, 1, 0, -math.inf, math.inf
    for i in range(1, len(chain)):
        angle = math.atan2(chain[i, 1] - chain[anchor, 1], chain[i, 0] - chain[anchor, 0])
        if i > anchor + 1 and not low <= angle <= high:
            anchor, kept[count], low, high = i - 1, i - 1, -math.inf, math.inf
            count += 1
            angle = math.atan2(chain[i, 1] - chain[anchor, 1], chain[i, 0] - chain[anchor, 0])
        size = math.hypot(chain[i, 1] - chain[anchor, 1], chain[i, 0] - chain[anchor, 0])
        if size > tolerance:
            spread = math.asin(tolerance / size)
            low, high = max(low, angle - spread), min(high, angle + spread)
    kept[count] = len(chain) - 1
    return count + 1
