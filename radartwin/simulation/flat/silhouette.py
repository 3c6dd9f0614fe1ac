"""The outline of a body as seen from a point, and the shadow that it casts on the lines of paths, as factors of the field.

The outline is a set of closed polygons around everything that the body hides from the point. Overlapping parts of the body count once, and
a hole is a polygon of its own. Horizontal rows divide the view of the body. In each row, the edges at which the body begins or ends give
the intervals that it covers. The ends of the intervals of successive rows form the polygons, whose points lie on the body. Points that
move a polygon by less than a tolerance are left out, so that the number of its edges does not depend on the facets of the mesh. Where a
flat face is seen almost edge-on, both of its edges hide the same lines. The polygon passes between them, at the mean of their depths, so
that it does not jump from one edge to the other one when the body turns.

The factor of a line is 1 where it is clear and 0 where the body blocks it, plus the edge waves (`kirchhoff`) of the outline. A line that
ends at the sensor uses the outline as seen from the sensor, in both directions, so that its factor is reciprocal. Any other line of a path
uses the outline as seen from the end nearer to the body; this end is an image of the sensor or a point of diffraction. Transmission is not
part of the factor.
"""

import math
from typing import NamedTuple

import numpy as np
import trimesh

from radartwin.compiled import compiled, innermost, shared_out
from radartwin.simulation.flat.field import NUDGE
from radartwin.simulation.flat.kirchhoff import edge_part
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Point, Vector, build, crossed
from radartwin.simulation.flat.shadows import BEYOND_M, IN_PLANE_M, REACH, SEEN, near, reach_around
from radartwin.simulation.flat.vectors import cross, distance, dot, moved, norm, toward, vector
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.pruning import TARGET_ERROR

TOLERANCE = TARGET_ERROR  # of an outline, divided by the square root of wavelength times distance; about the error of a shadow factor
MAX_ROWS = 512
FEW = 64  # up to this number of mesh edges in an outline, the picture also has rows at their ends
FOLDED = 0.94  # an edge is sharp if the cosine between its faces is smaller, or if it has one face
MAX_INTERVALS = 32  # largest number of intervals of a row; a row with more closes its narrowest gaps
MAX_SEGMENTS = 192  # largest number of edges of an outline; an outline that needs more gets a larger tolerance
CLIP = 0.02  # faces with a corner nearer than this share of the distance to the body, or behind the viewer, hide nothing


class Skin(NamedTuple):
    """Hold the surface of a body with V vertices, F faces and E edges.

    Attributes:
        vertex: (V, 3) metres. corners: (F, 3) vertices of each face. normal: (F, 3). sheet: (F,) whether a face belongs to an open mesh,
            which hides from both sides.
        ends: (E, 2) vertices of each edge. faces: (E, 2) its faces; -1: none. forward: (E, 2) whether the order of the corners of each of
            these faces runs along the edge.
        centre: (3,) of a ball around the body. radius: (1,) of this ball.
        sharp: (S, 2, 3) ends of all edges between faces of different directions; none if they are more than FEW.
        tree: triangles of the body. opaque: (surfaces,) true.
    """

    vertex: np.ndarray
    corners: np.ndarray
    normal: np.ndarray
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
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends, forward, face = np.sort(sides, axis=1), sides[:, 0] < sides[:, 1], np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, forward, face = ends[order], forward[order], face[order]
    new = np.append(True, (ends[1:] != ends[:-1]).any(axis=1))
    first = np.flatnonzero(new)
    pair = np.diff(np.append(first, len(ends))) == 2
    lone = np.ones(len(ends), bool)
    lone[first[pair]] = lone[first[pair] + 1] = False
    alone = np.flatnonzero(lone)  # an edge of one face, or of more than two, is the border of each of its faces
    rows = np.concatenate([first[pair], alone])
    other = np.concatenate([first[pair] + 1, np.full(len(alone), -1)])
    faces = np.stack([face[rows], np.where(other < 0, -1, face[other])], axis=1)
    ways = np.stack([forward[rows], forward[other]], axis=1)
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    folded = (other < 0) | (np.einsum("ni,ni->n", unit[faces[:, 0]], unit[faces[:, 1]]) < FOLDED)
    sharp = vertex[ends[rows][folded]] if folded.sum() <= FEW else np.zeros((0, 2, 3))
    low, high = vertex.min(axis=0), vertex.max(axis=0)
    centre = (low + high) / 2
    radius = np.linalg.norm(vertex - centre, axis=1).max(keepdims=True)
    return Skin(
        vertex, triangles, normal, geometry.hollow_m <= 0, ends[rows], faces, ways, centre, radius, sharp,
        build(geometry.corners, geometry.surface), np.ones(int(geometry.surface.max(initial=0)) + 1, bool),
    )  # fmt: skip


@compiled
def outline(body: Skin, viewer: np.ndarray, wavenumber: float, out: np.ndarray) -> int:
    """Write the outline of a body as seen from `viewer` (3,) to `out` (MAX_SEGMENTS, 2, 3). Returns its number of edges.

    Each edge has a start a and an end b in metres. A line of sight to a point q passes on the body's side of the edge if the triple product
    of a, b and q, all relative to the viewer, is positive.
    """
    away = distance(body.centre, viewer)
    if away < 1e-6:
        return 0
    frame = _frame(toward(viewer, body.centre, away))
    seen = _projected(body, viewer, frame, away)
    edges, steps = _borders(body, viewer, seen)
    if not len(edges):
        return 0
    tolerance = TOLERANCE * math.sqrt(2 * math.pi / wavenumber * away)
    few = len(edges) <= FEW
    while True:
        rows = _rows(body, edges, seen, 4 * tolerance, few)
        left, right, count = _intervals(body, edges, steps, seen, rows)
        found = _polygons(rows, left, right, count, tolerance, viewer, frame, away, out)
        if found >= 0:
            return _between(body.sharp, viewer, wavenumber, frame, away, out, found)
        tolerance, few = 2 * tolerance, False


@innermost
def _frame(view: Point) -> tuple[Vector, Vector, Vector]:
    """Return the axes of a picture: to the right, up, and the direction of view (3,)."""
    up = (1.0, 0.0, 0.0) if abs(view[2]) > 0.9 else (0.0, 0.0, 1.0)
    up = moved(up, view, -dot(up, view))
    size = norm(up)
    up = up[0] / size, up[1] / size, up[2] / size
    return cross(up, view), up, (view[0], view[1], view[2])


@compiled
def _projected(body: Skin, viewer: np.ndarray, frame: tuple, away: float) -> np.ndarray:
    """Return the vertices (V, 3) in the picture: to the right and up in metres at the distance `away`, and the depth in metres."""
    out = np.empty(body.vertex.shape)
    for i in range(len(out)):
        x, y, z = body.vertex[i, 0] - viewer[0], body.vertex[i, 1] - viewer[1], body.vertex[i, 2] - viewer[2]
        depth = max(frame[2][0] * x + frame[2][1] * y + frame[2][2] * z, CLIP * away)
        out[i, 0] = (frame[0][0] * x + frame[0][1] * y + frame[0][2] * z) * away / depth
        out[i, 1] = (frame[1][0] * x + frame[1][1] * y + frame[1][2] * z) * away / depth
        out[i, 2] = depth
    return out


@compiled
def _borders(body: Skin, viewer: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (N,) at which the number of layers changes, and the change (N,) of this number from left to right.

    A layer is a face that hides the space behind it: a face that looks at the viewer if its mesh is closed, and any face of an open mesh.
    """
    layer, positive = np.empty(len(body.corners), np.bool_), np.empty(len(body.corners), np.bool_)
    nearest = CLIP * distance(body.centre, viewer)
    for f in range(len(layer)):
        a, b, c = body.corners[f]
        # All edges of a face use this one sign of the order of its corners, so that the changes in a row cancel even for a face seen
        # edge-on.
        positive[f] = (seen[b, 0] - seen[a, 0]) * (seen[c, 1] - seen[a, 1]) > (seen[b, 1] - seen[a, 1]) * (seen[c, 0] - seen[a, 0])
        side = 0.0
        for k in range(3):
            side += (viewer[k] - body.vertex[a, k]) * body.normal[f, k]
        layer[f] = (side > 0 or body.sheet[f]) and min(seen[a, 2], seen[b, 2], seen[c, 2]) > nearest
    edges, steps = np.empty(len(body.ends), np.int64), np.empty(len(body.ends), np.int64)
    count = 0
    for e in range(len(body.ends)):
        one, other = body.faces[e]
        if not layer[one] and (other < 0 or not layer[other]):
            continue
        rises = seen[body.ends[e, 0], 1] <= seen[body.ends[e, 1], 1]
        step = 0
        for k in range(2):
            f = body.faces[e, k]
            if f >= 0 and layer[f]:
                left = (body.forward[e, k] == rises) == positive[f]  # the face is on the left of the rising edge
                step += -1 if left else 1
        if step:
            edges[count], steps[count] = e, step
            count += 1
    return edges[:count], steps[:count]


@compiled
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


@compiled
def _intervals(
    body: Skin, edges: np.ndarray, steps: np.ndarray, seen: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the left and right ends (R, MAX_INTERVALS, 2) of the intervals that the body covers in each row, and their number (R,).

    An end has a place to the right and a depth, in metres.
    """
    first = np.zeros(len(rows) + 1, np.int64)
    spans = np.empty((len(edges), 2), np.int64)
    for i in range(len(edges)):
        a, b = seen[body.ends[edges[i], 0], 1], seen[body.ends[edges[i], 1], 1]
        spans[i, 0], spans[i, 1] = np.searchsorted(rows, min(a, b)), np.searchsorted(rows, max(a, b))
        first[spans[i, 0] + 1 : spans[i, 1] + 1] += 1
    first = np.cumsum(first)
    place, step, used = np.empty((first[-1], 2)), np.empty(first[-1], np.int64), np.zeros(len(rows), np.int64)
    for i in range(len(edges)):
        low, high = body.ends[edges[i], 0], body.ends[edges[i], 1]
        for row in range(spans[i, 0], spans[i, 1]):
            share = (rows[row] - seen[low, 1]) / (seen[high, 1] - seen[low, 1])
            at = seen[low, 0] + share * (seen[high, 0] - seen[low, 0])
            depth = seen[low, 2] + share * (seen[high, 2] - seen[low, 2])
            n = first[row] + used[row]
            while n > first[row] and place[n - 1, 0] > at:
                place[n], step[n] = place[n - 1], step[n - 1]
                n -= 1
            place[n, 0], place[n, 1], step[n] = at, depth, steps[i]
            used[row] += 1
    left, right = np.empty((len(rows), MAX_INTERVALS, 2)), np.empty((len(rows), MAX_INTERVALS, 2))
    count = np.zeros(len(rows), np.int64)
    for row in range(len(rows)):
        layers = 0
        for n in range(first[row], first[row + 1]):
            before, layers = layers, layers + step[n]
            if before <= 0 < layers:
                # The gap between two intervals closes where one ends at the place where the other begins.
                joined = count[row] > 0 and place[n, 0] - right[row, count[row] - 1, 0] < 1e-9
                if joined:
                    count[row] -= 1
                    continue
                if count[row] == MAX_INTERVALS:
                    _close(left[row], right[row])
                    count[row] -= 1
                left[row, count[row]] = place[n]
            elif layers <= 0 < before:
                right[row, count[row]] = place[n]
                count[row] += 1
    return left, right, count


@innermost
def _close(left: np.ndarray, right: np.ndarray) -> None:
    """Merge the two neighbouring intervals of a row that have the narrowest gap. The last entry of `left` and `right` is then free for
    another interval.
    """
    narrowest = 0
    for k in range(1, len(left) - 1):
        if left[k + 1, 0] - right[k, 0] < left[narrowest + 1, 0] - right[narrowest, 0]:
            narrowest = k
    for k in range(narrowest, len(left) - 1):
        right[k, 0], right[k, 1] = right[k + 1, 0], right[k + 1, 1]
        if k > narrowest:
            left[k, 0], left[k, 1] = left[k + 1, 0], left[k + 1, 1]


@compiled
def _polygons(
    rows: np.ndarray, left: np.ndarray, right: np.ndarray, count: np.ndarray, tolerance: float, viewer: np.ndarray, frame: tuple,
    away: float, out: np.ndarray,
) -> int:  # fmt: skip
    """Write the edges of the polygons around the intervals of all rows to `out`; -1 if they are too many."""
    used, begin = 0, 0
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
                if used + points + 1 > len(out):
                    return -1
                for i in range(1, points):  # the right side goes up, the left side down
                    a, b = (kept[i - 1], kept[i]) if side else (kept[i], kept[i - 1])
                    _place(out[used, 0], viewer, frame, away, chain[a])
                    _place(out[used, 1], viewer, frame, away, chain[b])
                    used += 1
            for high in range(2):  # the bottom goes to the right, the top to the left
                row, height = (stop - 1, top) if high else (begin, bottom)
                for end in range(2):
                    ends = right if end != high else left
                    chain[0, 0], chain[0, 1], chain[0, 2] = ends[row, k, 0], height, ends[row, k, 1]
                    _place(out[used, end], viewer, frame, away, chain[0])
                used += 1
                if used >= len(out):
                    return -1
        begin = stop
    return used


@compiled
def _between(
    sharp: np.ndarray, viewer: np.ndarray, wavenumber: float, frame: tuple, away: float, out: np.ndarray, number: int
) -> int:  # fmt: skip
    """Move the corners of polygons along their lines of sight to the mean depth of sharp edges beside them. Returns the number of edges.

    The first `number` edges of `out` (MAX_SEGMENTS, 2, 3) change. The polygons get additional corners where corners of the body are near.
    """
    if len(sharp) == 0:
        return number
    seen, point = np.empty((len(sharp), 2, 3)), np.empty(3)
    for i in range(len(sharp)):
        for k in range(2):
            _pictured(sharp[i, k], viewer, frame, away, seen[i, k])
    low, high, count = np.inf, -np.inf, 0
    for i in range(len(sharp)):  # keep the edges in front of the viewer
        if min(seen[i, 0, 2], seen[i, 1, 2]) > CLIP * away:
            low, high = min(low, seen[i, 0, 2], seen[i, 1, 2]), max(high, seen[i, 0, 2], seen[i, 1, 2])
            seen[count] = seen[i]
            count += 1
    seen = seen[:count]
    # Two edges at a distance x in the picture count together if the phase k x^2/depth between them is below about 2 rad.
    if not high - low > 1e-6:
        return number
    reach = math.sqrt(math.pi / wavenumber * (high - low)) * 2 * away / (low + high)
    a, b, places = np.empty(3), np.empty(3), np.empty(2 * len(sharp))
    for e in range(number):
        _pictured(out[e, 0], viewer, frame, away, a)
        _pictured(out[e, 1], viewer, frame, away, b)
        x, y = b[0] - a[0], b[1] - a[1]
        square, count = x * x + y * y, 0
        if square > 1e-12:
            for i in range(len(seen)):
                for k in range(2):
                    u, v = seen[i, k, 0] - a[0], seen[i, k, 1] - a[1]
                    share = (u * x + v * y) / square
                    if 1e-3 < share < 1 - 1e-3 and abs(u * y - v * x) < reach * math.sqrt(square):
                        places[count] = share
                        count += 1
        at, end = np.sort(places[:count]), 1.0
        for i in range(count - 1, -1, -1):
            if end - at[i] < 1e-3 or number == len(out):
                continue
            end = at[i]
            for k in range(3):
                point[k] = (1 - end) * a[k] + end * b[k]
                out[number, 1, k] = out[e, 1, k]
            _place(out[number, 0], viewer, frame, away, point)
            for k in range(3):
                out[e, 1, k] = out[number, 0, k]
            number += 1
    for e in range(number):
        for k in range(2):
            _pictured(out[e, k], viewer, frame, away, point)
            point[2] = _mean_depth(seen, point, reach)
            _place(out[e, k], viewer, frame, away, point)
    return number


@innermost
def _pictured(point: np.ndarray, viewer: np.ndarray, frame: tuple, away: float, out: np.ndarray) -> None:
    """Write the place (to the right, up, depth) of a point (3,) in the picture to `out`."""
    x, y, z = point[0] - viewer[0], point[1] - viewer[1], point[2] - viewer[2]
    out[2] = frame[2][0] * x + frame[2][1] * y + frame[2][2] * z
    depth = out[2] if abs(out[2]) > 1e-12 else 1e-12  # a point may lie in the plane of the viewer
    out[0] = (frame[0][0] * x + frame[0][1] * y + frame[0][2] * z) * away / depth
    out[1] = (frame[1][0] * x + frame[1][1] * y + frame[1][2] * z) * away / depth


@innermost
def _mean_depth(seen: np.ndarray, point: np.ndarray, reach: float) -> float:
    """Return the mean depth of the edges (S, 2, 3) in the picture that are within `reach` of a point, with weights that fall with the
    distance.
    """
    total, weights = 0.0, 0.0
    for i in range(len(seen)):
        x, y = seen[i, 1, 0] - seen[i, 0, 0], seen[i, 1, 1] - seen[i, 0, 1]
        u, v = point[0] - seen[i, 0, 0], point[1] - seen[i, 0, 1]
        share = min(max((u * x + v * y) / max(x * x + y * y, 1e-18), 0.0), 1.0)
        square = ((u - share * x) ** 2 + (v - share * y) ** 2) / (reach * reach)
        if square < 1:
            weight = (1 - square) ** 2
            # along a straight edge, the inverse of the depth is linear in the picture
            total += weight / ((1 - share) / seen[i, 0, 2] + share / seen[i, 1, 2])
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
    kept[0], count, anchor = 0, 1, 0
    low, high = -math.inf, math.inf
    for i in range(1, len(chain)):
        across, up = chain[i, 0] - chain[anchor, 0], chain[i, 1] - chain[anchor, 1]
        angle = math.atan2(up, across)
        if i > anchor + 1 and not low <= angle <= high:
            anchor = i - 1
            kept[count] = anchor
            count += 1
            low, high = -math.inf, math.inf
            across, up = chain[i, 0] - chain[anchor, 0], chain[i, 1] - chain[anchor, 1]
            angle = math.atan2(up, across)
        size = math.sqrt(across * across + up * up)
        if size > tolerance:
            spread = math.asin(tolerance / size)
            low, high = max(low, angle - spread), min(high, angle + spread)
    kept[count] = len(chain) - 1
    return count + 1


@innermost
def _place(out: np.ndarray, viewer: np.ndarray, frame: tuple, away: float, point: np.ndarray) -> None:
    """Write the place (3,) in space of a point (to the right, up, depth) of the picture to `out`."""
    for k in range(3):
        out[k] = viewer[k] + point[2] * (frame[2][k] + (point[0] * frame[0][k] + point[1] * frame[1][k]) / away)


def factors(body: Skin, sensor: np.ndarray, points: np.ndarray, mirrors: bool, wavenumber: float) -> np.ndarray:
    """Return the factors (N,) of closed paths for exp(+j k L).

    Args:
        sensor: (N, 3) first and last point of each path. points: (N, P, 3) the points between, nan beyond the last.
        mirrors: whether these points are mirror points. Behind a mirror point, the wave continues as if it came from the sensor's image. At
            any other point, the wave starts anew.
    """
    out = np.ones(len(points), complex)
    if not len(out):
        return out
    sensor, points = np.ascontiguousarray(sensor), np.ascontiguousarray(points)
    ends, lengths = np.empty((*points.shape[:1], points.shape[1] + 2, 3)), np.zeros((len(points), points.shape[1] + 1))
    beside = np.zeros(lengths.shape, bool)
    shared_out(_find, len(out), body, sensor, points, mirrors, wavenumber, ends, lengths, beside)
    path, line = np.nonzero(beside)
    if not len(path):
        return out
    last = (lengths > 0).sum(axis=1)[path] - 1
    start, end = ends[path, line], ends[path, line + 1]
    if mirrors:
        before = np.cumsum(lengths, axis=1)[path, line] - lengths[path, line]
        after = lengths[path].sum(axis=1) - before - lengths[path, line]
        way = (end - start) / lengths[path, line, None]
        far = start - before[:, None] * way, end + after[:, None] * way
    else:
        far = start, end
    nearer = np.linalg.norm(far[0] - body.centre, axis=1) <= np.linalg.norm(far[1] - body.centre, axis=1)
    nearer = (line == 0) | ((line < last) & nearer)
    viewer = np.where(nearer[:, None], *far)
    from_sensor = (line == 0) | (line == last)
    viewer[from_sensor] = sensor[path[from_sensor]]
    viewer[~from_sensor] = _rounded(viewer[~from_sensor], body.centre)
    chosen, view = distinct(viewer)
    outlines, count = np.empty((len(chosen), MAX_SEGMENTS, 2, 3)), np.zeros(len(chosen), int)
    shared_out(_outlines, len(chosen), body, viewer[chosen], wavenumber, outlines, count)
    if mirrors:
        which = np.full(beside.shape, -1)
        which[path, line] = view
        from_start = np.zeros(beside.shape, bool)
        from_start[path, line] = nearer
        some = np.unique(path)
        values = np.empty(len(some), complex)
        arguments = body, outlines, count, which[some], from_start[some], ends[some], lengths[some], wavenumber
        shared_out(_over_mirrors, len(some), *arguments, values)
        out[some] = values
        return out
    # The first and the last line of many paths join the sensor to the same point.
    ends = np.where(nearer[:, None], start, end), np.where(nearer[:, None], end, start)
    kept, same = distinct(np.concatenate(ends, axis=1))
    values = np.empty(len(kept), complex)
    arguments = body, outlines, count, view[kept], ends[0][kept], ends[1][kept], wavenumber
    shared_out(_of_lines, len(kept), *arguments, values)
    np.multiply.at(out, path, values[same])
    return out


def _rounded(viewer: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Return viewers (N, 3) that are moved by at most 1.4 % of their distance to the body, so that more lines share an outline.

    The points of the outline stay on the body, so that they change only by the body's depth times the change of direction.
    """
    away = viewer - centre
    step = 2.0 ** np.floor(np.log2(np.maximum(np.linalg.norm(away, axis=1), 1e-6)))[:, None] / 64
    return centre + np.round(away / step) * step


@compiled
def _find(
    low: int, high: int, body: Skin, sensor: np.ndarray, points: np.ndarray, mirrors: bool, wavenumber: float, ends: np.ndarray,
    lengths: np.ndarray, beside: np.ndarray,
) -> None:  # fmt: skip
    """Write the ends (N, P + 2, 3) and lengths (N, P + 1) of the lines of the paths `low` to `high` - 1.

    `beside` (N, P + 1) receives which lines the body may change.
    The paths begin a little beside the sensor, because the factor of a line exactly over an edge is not defined.
    """
    excess = math.pi * REACH * REACH / wavenumber
    for n in range(low, high):
        last = 1
        ends[n, 0] = sensor[n] + NUDGE / wavenumber
        while last <= points.shape[1] and not math.isnan(points[n, last - 1, 0]):
            ends[n, last] = points[n, last - 1]
            last += 1
        ends[n, last] = ends[n, 0]
        whole = 0.0
        for i in range(last):
            lengths[n, i] = distance(ends[n, i], ends[n, i + 1])
            whole += lengths[n, i]
        before = 0.0
        for i in range(last):
            size = lengths[n, i]
            if size > 1e-9:
                way = toward(ends[n, i], ends[n, i + 1], size)
                source = moved(ends[n, i], way, -before)
                total = whole if mirrors else size
                least, most = before - BEYOND_M - excess, before + size + BEYOND_M + excess
                beside[n, i] = near(body.centre, body.radius[0], source, way, least, most, total, excess)
            if mirrors:
                before += size


@compiled
def _outlines(low: int, high: int, body: Skin, viewer: np.ndarray, wavenumber: float, out: np.ndarray, count: np.ndarray) -> None:
    for n in range(low, high):
        count[n] = outline(body, viewer[n], wavenumber, out[n])


@innermost
def _waves(
    body: Skin, edges: np.ndarray, from_start: bool, start: Point, end: Point, before: float, after: float, normal_a: Point,
    normal_b: Point, wavenumber: float, part: np.ndarray, place: np.ndarray, found: np.ndarray,
) -> tuple[float, int]:  # fmt: skip
    """Return 1 if a line is clear and 0 if the body blocks it, and the number of edge waves of an outline for exp(+j k L).

    Args:
        edges: (N, 2, 3) of the outline as seen from the source, if `from_start`, or from the receiver of the line.
        start, end: (3,) ends of the line. before, after: lengths in metres of the path from its source to `start` and from `end` to its
            receiver, over mirrors at the ends.
        normal_a, normal_b: (3,) normals of the mirrors at the ends, or zero. An edge in the plane of a mirror does not count, because the
            body and its image join there without an edge.
        part: (N,) receives the edge waves relative to the undisturbed path. place: (N, 3) receives the points at which they start.
        found: (MAX_PANES,) memory.
    """
    length = distance(start, end)
    way = toward(start, end, length)
    source, receiver = moved(start, way, -before), moved(end, way, after)
    viewer, sign = (source, 1.0) if from_start else (receiver, -1.0)
    frame = _frame((sign * way[0], sign * way[1], sign * way[2]))
    total = before + length + after
    layers, count = 0, 0
    reach = reach_around(body.centre, body.radius[0], source, receiver, wavenumber)
    for e in range(len(edges)):
        x, y, z = edges[e, 0, 0] - viewer[0], edges[e, 0, 1] - viewer[1], edges[e, 0, 2] - viewer[2]
        near_m = frame[2][0] * x + frame[2][1] * y + frame[2][2] * z
        a_0, b_0 = frame[0][0] * x + frame[0][1] * y + frame[0][2] * z, frame[1][0] * x + frame[1][1] * y + frame[1][2] * z
        x, y, z = edges[e, 1, 0] - viewer[0], edges[e, 1, 1] - viewer[1], edges[e, 1, 2] - viewer[2]
        far_m = frame[2][0] * x + frame[2][1] * y + frame[2][2] * z
        a_1, b_1 = frame[0][0] * x + frame[0][1] * y + frame[0][2] * z, frame[1][0] * x + frame[1][1] * y + frame[1][2] * z
        if max(near_m, far_m) <= 0 or min(near_m, far_m) >= total:
            continue
        side = a_0 * b_1 - a_1 * b_0  # positive if the line passes on the body's side of the edge
        if (b_0 <= 0) != (b_1 <= 0) and (side > 0) == (b_1 > b_0):
            layers += 1 if b_1 > b_0 else -1
        if _lies_in(edges[e], start, normal_a) or _lies_in(edges[e], end, normal_b):
            continue
        size = distance(edges[e, 0], edges[e, 1])
        if size < 1e-9:
            continue
        along = toward(edges[e, 0], edges[e, 1], size)
        value, at = edge_part(edges[e, 0], along, size, source, receiver, wavenumber, reach)
        if value == 0:
            continue
        x_at = moved(edges[e, 0], along, min(max(at, 0.0), size))
        reached = dot(x_at, way) - dot(start, way)
        if (before > 0 and reached < -BEYOND_M) or (after > 0 and reached > length + BEYOND_M):
            continue  # the path has left the line at a mirror
        part[count] = value if side > 0 else -value
        place[count, 0], place[count, 1], place[count, 2] = x_at
        count += 1
    middle = dot(body.centre, way) - dot(start, way)
    blocked = layers > 0
    if middle < body.radius[0] or middle > length - body.radius[0]:  # a part of the body may be beyond an end of the line
        blocked = crossed(body.tree, start, end, body.opaque, found) < 0
    return (0.0 if blocked else 1.0), count


@innermost
def _lies_in(edge: np.ndarray, point: Point, normal: Point) -> bool:
    """Return whether an edge (2, 3) lies in the plane of a mirror with a point and a normal; False for a normal of zero."""
    first, second, size = 0.0, 0.0, 0.0
    for k in range(3):
        first += (edge[0, k] - point[k]) * normal[k]
        second += (edge[1, k] - point[k]) * normal[k]
        size += abs(normal[k])
    return size > 0 and abs(first) < IN_PLANE_M and abs(second) < IN_PLANE_M


@innermost
def _sum(part: np.ndarray, waves: int) -> complex:
    """Return the sum of the first `waves` edge waves."""
    total = 0j
    for e in range(waves):
        total += part[e]
    return total


@innermost
def _way(length: np.ndarray, first: int, stop: int) -> float:
    """Return the length in metres of the lines `first` to `stop` - 1."""
    total = 0.0
    for i in range(first, stop):
        total += length[i]
    return total


@compiled
def _of_lines(
    begin: int, stop: int, body: Skin, outlines: np.ndarray, count: np.ndarray, view: np.ndarray, start: np.ndarray,
    end: np.ndarray, wavenumber: float, out: np.ndarray,
) -> None:  # fmt: skip
    """Write the factors of the lines `begin` to `stop` - 1 to `out` (N,).

    view: (N,) outline of each line as seen from its start.
    """
    part, place = np.empty(MAX_SEGMENTS, np.complex128), np.empty((MAX_SEGMENTS, 3))
    found, none = np.empty(MAX_PANES, np.int64), (0.0, 0.0, 0.0)
    for n in range(begin, stop):
        edges = outlines[view[n], : count[view[n]]]
        clear, waves = _waves(body, edges, True, start[n], end[n], 0.0, 0.0, none, none, wavenumber, part, place, found)
        out[n] = clear + _sum(part, waves)


@compiled
def _over_mirrors(
    begin: int, stop: int, body: Skin, outlines: np.ndarray, number: np.ndarray, view: np.ndarray, from_start: np.ndarray,
    ends: np.ndarray, lengths: np.ndarray, wavenumber: float, out: np.ndarray,
) -> None:  # fmt: skip
    """Write the factors of the paths `begin` to `stop` - 1 over mirrors to `out` (N,).

    view: (N, P + 1) outline of each line; -1: none. from_start: (N, P + 1) whether the outline is seen from the source of the line.

    An edge wave of one line of a path continues along its own ray. Beside the later lines, the body can shadow this ray again and create
    further edge waves. The function does not trace these further waves, but multiplies the edge wave by the factors of the later lines.
    """
    part, place = np.empty(MAX_SEGMENTS, np.complex128), np.empty((MAX_SEGMENTS, 3))
    later, beyond, found = np.empty_like(part), np.empty_like(place), np.empty(MAX_PANES, np.int64)
    normal, factor = np.empty((lengths.shape[1] + 1, 3)), np.empty(lengths.shape[1] + 1, np.complex128)
    # the loop creates no arrays, so that it counts no references
    _mirror_paths(
        begin,
        stop,
        body,
        outlines,
        number,
        view,
        from_start,
        ends,
        lengths,
        wavenumber,
        out,
        part,
        place,
        later,
        beyond,
        found,
        normal,
        factor,
    )


@innermost
def _mirror_paths(
    begin, stop, body, outlines, number, view, from_start, ends, lengths, wavenumber, out, part, place, later, beyond,
    found, normal, factor,
):  # fmt: skip
    """Compute the paths of `_over_mirrors` in the memory of one path."""
    for n in range(begin, stop):
        last = 0
        while last < lengths.shape[1] and lengths[n, last] > 0:
            last += 1
        met, length = ends[n], lengths[n]
        for i in range(last + 1):
            for k in range(3):
                normal[i, k] = 0.0
                if 0 < i < last:
                    normal[i, k] = (met[i + 1, k] - met[i, k]) / length[i] - (met[i, k] - met[i - 1, k]) / length[i - 1]
            size = max(norm(normal[i]), 1e-12)
            for k in range(3):
                normal[i, k] /= size
        total = 1 + 0j  # factor of the lines i to `last`, from the last line to the first
        for i in range(last - 1, -1, -1):
            factor[i] = total
            if view[n, i] < 0:
                continue
            before, after = _way(length, 0, i), _way(length, i + 1, last)
            edges = outlines[view[n, i], : number[view[n, i]]]
            clear, waves = _waves(
                body, edges, from_start[n, i], met[i], met[i + 1], before, after, normal[i], normal[i + 1], wavenumber, part, place, found
            )  # fmt: skip
            total = clear * total
            for e in range(waves):
                onwards = factor[i]
                if i + 1 < last and abs(part[e]) > SEEN:
                    onwards = _onwards(
                        body, outlines, number, view[n], from_start[n], met, normal, i, last, place[e], after, wavenumber, later,
                        beyond, found,
                    )  # fmt: skip
                    # at the border of the shadow, where half of the field passes, the wave continues as the undisturbed line does
                    undisturbed = min((2 * abs(part[e])) ** 4, 1.0)
                    onwards += undisturbed * (factor[i] - onwards)
                total += part[e] * onwards
        out[n] = total


@innermost
def _onwards(
    body: Skin, outlines: np.ndarray, number: np.ndarray, view: np.ndarray, from_start: np.ndarray, met: np.ndarray,
    normal: np.ndarray, i: int, last: int, start: Point, after: float, wavenumber: float, part: np.ndarray,
    place: np.ndarray, found: np.ndarray,
) -> complex:  # fmt: skip
    """Return the product of the factors of the lines after line `i`, for a ray that begins at `start` beside line `i` and meets the same
    mirrors.
    """
    way = toward(met[i], met[i + 1], 1.0)
    target = moved(met[i + 1], way, after / norm(way))
    rest = distance(target, start)
    way = toward(start, target, rest)
    at = start[0], start[1], start[2]
    gone, total = 0.0, 1 + 0j
    for j in range(i + 1, last + 1):
        to = vector(met, j)
        if j < last:
            onto = dot(way, normal[j])
            if onto >= -1e-9:
                return total
            to = moved(at, way, max(dot(toward(at, to, 1.0), normal[j]) / onto, 0.0))
            way = moved(way, normal[j], -2 * onto)
        step = distance(to, at)
        if j > i + 1 and view[j - 1] >= 0 and step > 1e-9:
            edges = outlines[view[j - 1], : number[view[j - 1]]]
            left = max(rest - gone - step, 0.0) if j < last else 0.0
            clear, waves = _waves(
                body, edges, from_start[j - 1], at, to, gone, left, normal[j - 1], normal[j], wavenumber, part, place, found
            )  # fmt: skip
            total *= clear + _sum(part, waves)
        gone += step
        at = to
    return total


def distinct(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the distinct rows of `rows` (N, K). Return the index of one example of each distinct row, and for each row the position (N,) of
    its example among these indices.

    The rows are sorted by a hash, because sorting whole rows is slow.
    """
    bits = np.ascontiguousarray(rows).view(np.uint64)
    order = np.argsort(bits @ np.random.default_rng(0).integers(1, 2**64, bits.shape[1], np.uint64, endpoint=False), kind="stable")
    new = np.append(True, (bits[order[1:]] != bits[order[:-1]]).any(axis=1))
    which = np.empty(len(rows), int)
    which[order] = np.cumsum(new) - 1
    return order[new], which
