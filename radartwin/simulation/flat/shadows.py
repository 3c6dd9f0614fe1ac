"""Shadows of bodies on the lines of paths, as factors of the field.

The factor of a straight line of a path is the sum of two parts: 1 if the line is free or 0 if a body blocks it, and the edge waves
(`kirchhoff`) of the body's outline. The outline is that seen from one end of the path. This end is the source or, behind a mirror, an image
of the source. The factor is smooth across the border of a shadow. Transmission is not part of the factor.

The outline of a small or curved body is a set of closed polygons (`silhouette`). A line that ends at the sensor uses the outline as seen
from the sensor, in both directions, so that its factor is reciprocal. Any other line of a path uses the outline as seen from the end nearer
to the body; this end is an image of the sensor or a point of diffraction. The outline of large flat faces, which can surround the sensor,
consists of those of their edges at which they begin to hide the space behind them.
"""

import math
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost, shared_out
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.flat.field import GRAZING_M, NUDGE, edge_point
from radartwin.simulation.flat.kirchhoff import REACH, edge_part, reach_around
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Point, Vector, build, crossed
from radartwin.simulation.flat.silhouette import MAX_SEGMENTS, Skin, outline, picture_axes
from radartwin.simulation.flat.vectors import ZERO, cross, distance, dot, moved, norm, put, toward, vector

# A body changes a path by about this over the `reach` of `near`, and by at most 0.7: 0.16 for each of two edges beside two lines, if they
# are straight, touch the ball about the body and do not cancel. With 0.7, twice as many paths are computed, and the signal of a frame
# changes by 0.0014 of the signal of the shadows.
WAVES = 0.3
SEEN = 0.02  # weaker edge waves are added without a test whether their edge is visible, and continue along the path's own lines
BEYOND_M = 0.05  # edges beside a line count up to this far beyond its mirrors, because the edges of a body and its image cancel there
IN_PLANE_M = 1e-4  # an edge at most this far in front of a mirror's plane lies in the plane


class Line(NamedTuple):
    """Hold a line of a path between two points, mirrors or ends of the path.

    Attributes:
        start, end: (3,) ends of the line. way: (3,) its unit direction. length: metres.
        before, after: lengths in metres of the path from its source to `start` and from `end` to its receiver, over mirrors.
        source, receiver: (3,) images of the ends of the path, on the line's own straight continuation.
        normal_a, normal_b: (3,) normals of the mirrors at the ends, or zero.
    """

    start: Vector
    end: Vector
    way: Vector
    length: float
    before: float
    after: float
    source: Vector
    receiver: Vector
    normal_a: Vector
    normal_b: Vector


@innermost
def line_of(start: Vector, end: Vector, before: float, after: float, normal_a: Vector, normal_b: Vector) -> Line:
    """Return the line between two different points; the arguments are attributes of `Line`."""
    length = distance(start, end)
    way = toward(start, end, length)
    return Line(start, end, way, length, before, after, moved(start, way, -before), moved(end, way, after), normal_a, normal_b)


@innermost
def near(centre: Point, radius: float, line: Line, wavenumber: float, reach: float) -> bool:
    """Return whether edges in a ball can change the field of a line: whether a path over the ball can be longer than the straight path by
    at most the excess for the Fresnel coordinate `reach` both across and along an edge.

    The points of such paths form an ellipsoid around source and receiver, of which the part between the ends of the line counts.
    """
    excess, total = math.pi * reach * reach / wavenumber, line.before + line.length + line.after
    along = dot(centre, line.way) - dot(line.source, line.way)
    if along + radius < line.before - BEYOND_M - excess or along - radius > line.before + line.length + BEYOND_M + excess:
        return False
    aside = math.sqrt(max(distance(centre, line.source) ** 2 - along * along, 0.0))
    thickest = min(max(0.5 * total, along - radius), along + radius)
    share = (thickest - 0.5 * total) / (0.5 * (total + excess))
    return aside < radius + 0.5 * math.sqrt(excess * (2 * total + excess) * max(1 - share * share, 0.0))


@innermost
def _lies_behind(a: Vector, b: Vector, point: Vector, normal: Vector, way: Vector) -> bool:
    """Return whether an edge from a to b lies in or behind the plane of a mirror with a point and a normal, from which the direction `way`
    leads in front of the mirror; False for a normal of zero.
    """
    height, side = dot(point, normal), 1.0 if dot(way, normal) > 0 else -1.0
    return dot(normal, normal) > 0 and max(side * (dot(a, normal) - height), side * (dot(b, normal) - height)) < IN_PLANE_M


@innermost
def _wave(a: Vector, along: Vector, size: float, line: Line, wavenumber: float, reach: float) -> tuple[complex, float]:
    """Return the wave of an edge from `a`, positive for exp(+j k L), and the place in metres along the edge at which it starts.

    The wave is 0 if the edge lies in the plane of a mirror of the line, because the body and its image join there without an edge, if it
    lies behind this plane, as the back of the mirror does, and if the path has left the line at a mirror.
    """
    b = moved(a, along, size)
    back = moved(ZERO, line.way, -1.0)
    if _lies_behind(a, b, line.start, line.normal_a, line.way) or _lies_behind(a, b, line.end, line.normal_b, back):
        return 0j, 0.0
    value, place = edge_part(a, along, size, line.source, line.receiver, wavenumber, reach)
    place = min(max(place, 0.0), size)
    reached = dot(moved(a, along, place), line.way) - dot(line.start, line.way)
    if (line.before > 0 and reached < -BEYOND_M) or (line.after > 0 and reached > line.length + BEYOND_M):
        return 0j, place
    return value, place


# ---- flat faces


def edges_of(faces: Faces) -> Hierarchy:
    """Return the edges of flat faces, in a hierarchy of boxes whose labels are the numbers of the edges."""
    ends = faces.start + faces.length[:, None] * faces.along
    return build(np.stack([faces.start, ends, ends], axis=1), np.arange(len(ends)))


@innermost
def past_faces(
    faces: Faces, edges: Hierarchy, tree: Hierarchy, opaque: np.ndarray, line: Line, wavenumber: float, mirror_a: int, mirror_b: int,
    pane_ids: np.ndarray, others: np.ndarray,
) -> complex:  # fmt: skip
    """Return the factor of a line past flat faces, for exp(+j k L).

    Args:
        edges: edges of the faces that hide. tree: all triangles that can block. opaque: (surfaces,) whether a surface blocks.
        mirror_a, mirror_b: mirrors of the path, or -1; their own edges do not count.
        pane_ids, others: (MAX_PANES,) int and (surfaces,) bool, memory.
    """
    total = 1 + 0j if crossed(tree, line.start, line.end, opaque, pane_ids) >= 0 else 0j
    for i in range(len(opaque)):
        others[i] = opaque[i]
    box, node = edges.box, 0
    while node < len(box):
        low, high = (box[node, 0], box[node, 1], box[node, 2]), (box[node, 3], box[node, 4], box[node, 5])
        half = toward(low, high, 2.0)
        if not near(moved(low, half, 1.0), norm(half), line, wavenumber, REACH):
            node = edges.beyond[node]
            continue
        for t in range(edges.first[node], edges.stop[node]):
            e = edges.label[t]
            side = _hides(faces, e, line)
            if side == 0 or mirror_a in (faces.sides[e, 0], faces.sides[e, 1]) or mirror_b in (faces.sides[e, 0], faces.sides[e, 1]):
                continue
            value, place = _wave(vector(faces.start, e), vector(faces.along, e), faces.length[e], line, wavenumber, REACH)
            if abs(value) > SEEN:  # whether the edge is visible from both ends
                x, surface = edge_point(faces, e, place), faces.surface[faces.sides[e, 0]]
                others[surface] = False  # a thick body hides its own outline, but the wave creeps around it
                if crossed(tree, line.start, x, others, pane_ids) < 0 or crossed(tree, x, line.end, others, pane_ids) < 0:
                    value = 0j
                others[surface] = opaque[surface]
            total += side * value
        node += 1
    return total


@innermost
def _hides(faces: Faces, e: int, line: Line) -> float:
    """Return +1 if edge `e` begins to hide the space behind it and the line passes on the body's side of the edge, -1 if the line passes on
    the other side, and 0 if the source sees both faces of the edge or none of them.
    """
    if faces.opening[e] <= 1:
        return 0.0
    up, last = vector(faces.up, e), faces.opening[e] * math.pi
    other = moved(ZERO, vector(faces.into, e), math.sin(last))  # perpendicular to face n, into the open sector
    from_edge = toward(vector(faces.start, e), line.source, 1.0)
    lit = dot(from_edge, up) >= -GRAZING_M  # a source in the plane of a face sees it
    if lit == (dot(from_edge, moved(other, up, -math.cos(last))) >= -GRAZING_M):
        return 0.0
    turned = dot(cross(vector(faces.along, e), from_edge), toward(vector(faces.start, e), line.receiver, 1.0))
    return 1.0 if (turned < 0) == lit else -1.0


# ---- bodies with an outline


class _Walks(NamedTuple):
    """Hold N paths of up to M lines past a body.

    Attributes:
        outlines: (V, MAX_SEGMENTS, 2, 3) of the body. edges: (V,) their number of edges.
        met: (N, M + 1, 3) points. length: (N, M) metres, 0 beyond the last line. normal: (N, M + 1, 3) of the mirrors, or zero.
        which: (N, M) outline of each line; -1: none. from_start: (N, M) whether the outline is seen from the source of the line.
    """

    outlines: np.ndarray
    edges: np.ndarray
    met: np.ndarray
    length: np.ndarray
    normal: np.ndarray
    which: np.ndarray
    from_start: np.ndarray


def factors(
    body: Skin, sensor: np.ndarray, points: np.ndarray, mirrors: bool, wavenumber: float, receiver: np.ndarray | None = None,
    least: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Return the factors (N,) of paths for exp(+j k L).

    Args:
        sensor: (N, 3) first point of each path. points: (N, P, 3) the points between, nan beyond the last.
        mirrors: whether these points are mirror points. Behind a mirror point, the wave continues as if it came from the sensor's image. At
            any other point, the wave starts anew.
        receiver: (N, 3) last point of each path; None: the sensor.
        least: (N,) changes below which the factor of a path may be 1; None: zero.
    """
    out = np.ones(len(points), complex)
    if not len(out):
        return out
    # The paths begin a little beside the sensor, because the factor of a line exactly over an edge is not defined.
    nudged, count = sensor + NUDGE / wavenumber, np.isfinite(points[:, :, 0]).sum(axis=1)
    met = np.concatenate([nudged[:, None], points, np.full((len(points), 1, 3), np.nan)], axis=1)
    met[np.arange(len(met)), count + 1] = nudged if receiver is None else receiver
    length = np.nan_to_num(np.linalg.norm(np.diff(met, axis=1), axis=2))
    before = (np.cumsum(length, axis=1) - length) * mirrors
    after = (length.sum(axis=1, keepdims=True) - length) * mirrors - before
    beside = np.zeros(length.shape, bool)
    reach = np.full(len(out), REACH) if least is None else np.minimum(WAVES / np.maximum(least, 1e-9), REACH)
    shared_out(_beside, len(out), body, met, length, before, after, wavenumber, reach, beside, grain=1000)
    path, line = np.nonzero(beside)
    if not len(path):
        return out
    ends = met[path, line], met[path, line + 1]
    way = (ends[1] - ends[0]) / length[path, line, None]
    far = np.stack([ends[0] - before[path, line, None] * way, ends[1] + after[path, line, None] * way])
    away = np.linalg.norm(far - body.centre, axis=2)
    first, last = line == 0, (line == count[path]) & (receiver is None)
    from_start = first | (~last & (away[0] <= away[1]))
    viewer = np.where((first | last)[:, None], sensor[path], _rounded(np.where(from_start[:, None], *far), body.centre))
    views, view = distinct(viewer)
    outlines, edges = np.empty((len(views), MAX_SEGMENTS, 2, 3)), np.zeros(len(views), int)
    shared_out(_outlines, len(views), body, viewer[views], wavenumber, outlines, edges)
    if mirrors:
        walked, which = np.unique(path), (path, line)
        met, length = met[walked], length[walked]
        of_line = np.full(beside.shape, -1), np.zeros(beside.shape, bool)
        of_line[0][which], of_line[1][which] = view, from_start
        view, from_start = of_line[0][walked], of_line[1][walked]
    else:  # each line is a path of its own; the first and the last line of many paths join the sensor to the same point
        met = np.stack([np.where(from_start[:, None], *ends), np.where(from_start[:, None], *ends[::-1])], axis=1)
        kept, same = distinct(met.reshape(-1, 6))
        met, length, view = met[kept], length[path, line][kept, None], view[kept, None]
        from_start = np.ones(view.shape, bool)
    normal = np.zeros(met.shape)
    way = np.diff(met, axis=1) / np.maximum(length, 1e-30)[..., None]
    normal[:, 1:-1] = np.nan_to_num(np.diff(way, axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    values = np.empty(len(met), complex)
    shared_out(_follow, len(met), body, _Walks(outlines, edges, met, length, normal, view, from_start), wavenumber, values)
    if mirrors:
        out[walked] = values
    else:
        np.multiply.at(out, path, values[same])
    return out


@compiled
def _beside(
    low: int, high: int, body: Skin, met: np.ndarray, length: np.ndarray, before: np.ndarray, after: np.ndarray, wavenumber: float,
    reach: np.ndarray, out: np.ndarray,
) -> None:  # fmt: skip
    """Write which lines of the paths `low` to `high` - 1 the body may change to `out` (N, M): none of a path with no line that is nearer
    than its `reach` (N,).
    """
    for n in range(low, high):
        changes = False
        for i in range(length.shape[1]):
            if length[n, i] > 1e-9:
                line = line_of(vector(met[n], i), vector(met[n], i + 1), before[n, i], after[n, i], ZERO, ZERO)
                out[n, i] = near(body.centre, body.radius[0], line, wavenumber, REACH)
                changes = changes or (out[n, i] and near(body.centre, body.radius[0], line, wavenumber, reach[n]))
        out[n] &= changes


def _rounded(viewer: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Return viewers (N, 3) that are moved by at most 1.4 % of their distance to the body, so that more lines share an outline.

    The points of the outline stay on the body, so that they change only by the body's depth times the change of direction.
    """
    away = viewer - centre
    step = 2.0 ** np.floor(np.log2(np.maximum(np.linalg.norm(away, axis=1), 1e-6)))[:, None] / 64
    return centre + np.round(away / step) * step


@compiled
def _outlines(low: int, high: int, body: Skin, viewer: np.ndarray, wavenumber: float, out: np.ndarray, edges: np.ndarray) -> None:
    for n in range(low, high):
        edges[n] = outline(body, viewer[n], wavenumber, out[n])


@compiled
def _follow(begin: int, stop: int, body: Skin, walks: _Walks, wavenumber: float, out: np.ndarray) -> None:
    """Write the factors of the paths `begin` to `stop` - 1 to `out` (N,)."""
    part, place = np.empty((2, MAX_SEGMENTS), np.complex128), np.empty((2, MAX_SEGMENTS, 3))
    later, panes = np.empty(walks.length.shape[1], np.complex128), np.empty(MAX_PANES, np.int64)
    for n in range(begin, stop):
        out[n] = _path(n, body, walks, wavenumber, part, place, later, panes)


@innermost
def _path(
    n: int, body: Skin, walks: _Walks, wavenumber: float, part: np.ndarray, place: np.ndarray, later: np.ndarray, panes: np.ndarray
) -> complex:
    """Return the factor of path `n`.

    An edge wave of one line of the path continues along its own ray. Beside the later lines, the body can shadow this ray again and create
    further edge waves. The function does not trace these further waves, but multiplies the edge wave by the factors of the later lines.

    part, place, later, panes: memory for the edge waves of a line and of a ray, and for the factors of the lines after each line.
    """
    met, length, normal, last, before = walks.met[n], walks.length[n], walks.normal[n], 0, 0.0
    while last < len(length) and length[last] > 0:
        before += length[last]
        last += 1
    after, total = 0.0, 1 + 0j  # `total` is the factor of the lines i to `last`, from the last line to the first
    for i in range(last - 1, -1, -1):
        before -= length[i]
        later[i] = total
        if walks.which[n, i] >= 0:
            line = line_of(vector(met, i), vector(met, i + 1), before if i else 0.0, after, vector(normal, i), vector(normal, i + 1))
            clear, waves = _waves(n, i, body, walks, line, wavenumber, part[0], place[0], panes)
            total *= clear
            for e in range(waves):
                onwards = later[i]
                if i + 1 < last and abs(part[0, e]) > SEEN:
                    ray = _onwards(n, i, last, body, walks, place[0, e], after, wavenumber, part[1], place[1], panes)
                    # at the border of the shadow, where half of the field passes, the wave continues as the undisturbed line does
                    undisturbed = min((2 * abs(part[0, e])) ** 4, 1.0)
                    onwards = ray + undisturbed * (onwards - ray)
                total += part[0, e] * onwards
        after += length[i]
    return total


@innermost
def _onwards(
    n: int, i: int, last: int, body: Skin, walks: _Walks, start: Point, after: float, wavenumber: float, part: np.ndarray,
    place: np.ndarray, panes: np.ndarray,
) -> complex:  # fmt: skip
    """Return the product of the factors of the lines after line `i`, for a ray that begins at `start` beside line `i` and meets the same
    mirrors.
    """
    met, normal, total = walks.met[n], walks.normal[n], 1 + 0j
    way = toward(met[i], met[i + 1], 1.0)
    target = moved(met[i + 1], way, after / norm(way))
    at, rest = (start[0], start[1], start[2]), distance(target, start)
    way, gone = toward(at, target, rest), 0.0
    for j in range(i + 1, last + 1):
        to = vector(met, j)
        if j < last:
            onto = dot(way, normal[j])
            if onto >= -1e-9:
                return total
            to = moved(at, way, max(dot(toward(at, to, 1.0), normal[j]) / onto, 0.0))
            way = moved(way, normal[j], -2 * onto)
        step = distance(to, at)
        if j > i + 1 and walks.which[n, j - 1] >= 0 and step > 1e-9:
            line = line_of(at, to, gone, max(rest - gone - step, 0.0) if j < last else 0.0, vector(normal, j - 1), vector(normal, j))
            clear, waves = _waves(n, j - 1, body, walks, line, wavenumber, part, place, panes)
            factor = clear + 0j
            for e in range(waves):
                factor += part[e]
            total *= factor
        gone += step
        at = to
    return total


@innermost
def _waves(
    n: int, i: int, body: Skin, walks: _Walks, line: Line, wavenumber: float, part: np.ndarray, place: np.ndarray, panes: np.ndarray
) -> tuple[float, int]:
    """Return 1 if a line is clear and 0 if the body blocks it, and the number of edge waves of the outline of line `i` of path `n`.

    Args:
        part: (MAX_SEGMENTS,) receives the edge waves relative to the undisturbed path. place: (MAX_SEGMENTS, 3) receives the points at
            which they start. panes: (MAX_PANES,) memory.
    """
    viewer, sign = (line.source, 1.0) if walks.from_start[n, i] else (line.receiver, -1.0)
    right, up, view = picture_axes((sign * line.way[0], sign * line.way[1], sign * line.way[2]))
    edges, layers, count = walks.outlines[walks.which[n, i]], 0, 0
    reach = reach_around(body.centre, body.radius[0], line.source, line.receiver, wavenumber)
    for e in range(walks.edges[walks.which[n, i]]):
        start, end = vector(edges[e], 0), vector(edges[e], 1)
        a, b = toward(viewer, start, 1.0), toward(viewer, end, 1.0)
        near_m, far_m, size = dot(a, view), dot(b, view), distance(start, end)
        if max(near_m, far_m) <= 0 or min(near_m, far_m) >= line.before + line.length + line.after or size < 1e-9:
            continue
        # the line passes on the body's side of the edge if `side` is positive; its winding number counts the layers that hide it
        low, high = dot(a, up), dot(b, up)
        side = dot(a, right) * high - dot(b, right) * low
        if (low <= 0) != (high <= 0) and (side > 0) == (high > low):
            layers += 1 if high > low else -1
        along = toward(start, end, size)
        value, at = _wave(start, along, size, line, wavenumber, reach)
        if value != 0:
            part[count] = value if side > 0 else -value
            put(place, count, moved(start, along, at))
            count += 1
    middle = dot(body.centre, line.way) - dot(line.start, line.way)
    blocked = layers > 0
    if middle < body.radius[0] or middle > line.length - body.radius[0]:  # a part of the body may be beyond an end of the line
        blocked = crossed(body.tree, line.start, line.end, body.opaque, panes) < 0
    return (0.0 if blocked else 1.0), count


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
