"""Shadows of bodies on straight lines, as factors of the field.

The factor of a line is 1 where the line is clear and 0 where a body blocks it, plus the edge waves (`kirchhoff`) of the body's outline. The
outline is seen from the source of the path, which is the sensor or, behind a mirror, an image of the sensor. The factor is smooth across
the border of a shadow. The outline consists of those edges at which the body begins to hide the space behind it. Flat and curved bodies use
the same rule, because a curved mesh has an edge between each two facets. Transmission is not part of the factor.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh

from radartwin.compiled import innermost
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.flat.field import GRAZING_M, OUTSIDE_M
from radartwin.simulation.flat.kirchhoff import edge_part
from radartwin.simulation.flat.obstacles import Hierarchy, Point, Vector, crossed
from radartwin.simulation.flat.vectors import distance, dot, moved, toward, vector
from radartwin.simulation.geometry import Geometry

# Largest Fresnel coordinate, across an edge or along it to its nearer end. An edge beyond it changes a factor by at most 0.04; the edges of
# a hoop around the line add up (`reach_around`).
REACH = 8.0
SEEN = 0.02  # weaker edge waves are added without a test whether their edge is visible
BEYOND_M = 0.05  # edges beside a line count up to this far beyond its mirrors, because the edges of a body and its image cancel there
IN_PLANE_M = 1e-4  # an edge within this distance of a mirror's plane lies in the plane
FLAT_RAD = 1e-3  # an edge between faces whose normals differ by less than this is ignored
GROUP = 24  # largest number of edges of a part; one test of a part can leave out all its edges


class Outlines(NamedTuple):
    """Hold E edges at which bodies can begin to hide a line, in C parts.

    Attributes:
        first: (C + 1,) range of each part. centre: (C, 3), radius: (C,) ball around each part, metres. surface: (C,) its surface.
        axis: (C, 3) unit. cone: (C, 2) cosine and sine of the largest angle between the axis and the normals of the faces of the part's
            edges, at most 90 degrees.
        start, along, length, into, up, opening, sides: of each edge, as in `radartwin.simulation.flat.faces.Faces`; a side is -1 if the
            body is a mesh that is not divided into flat faces.
        other: (E, 3) unit, perpendicular to face n and to the edge, into the open sector.
    """

    first: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    surface: np.ndarray
    axis: np.ndarray
    cone: np.ndarray
    start: np.ndarray
    along: np.ndarray
    length: np.ndarray
    into: np.ndarray
    up: np.ndarray
    opening: np.ndarray
    sides: np.ndarray
    other: np.ndarray

    @staticmethod
    def concatenate(parts: "Sequence[Outlines]") -> "Outlines":
        """Join outlines; the faces of all parts must be numbered together."""
        bounds = np.cumsum([0, *(len(part.length) for part in parts)])
        first = np.concatenate([np.zeros(1, int), *(part.first[1:] + low for part, low in zip(parts, bounds, strict=False))])
        return Outlines(first, *(np.concatenate(values) for values in list(zip(*parts, strict=True))[1:]))


def of_faces(faces: Faces) -> Outlines:
    """Return the outlines of flat faces."""
    owner = faces.surface[faces.sides[:, 0]] if len(faces.length) else np.zeros(0, int)
    edges = (faces.start, faces.along, faces.length, faces.into, faces.up, faces.opening, faces.sides)
    return _parts(owner, owner, edges)


def of_mesh(geometry: Geometry) -> Outlines:
    """Return the outlines of all triangles of a geometry."""
    mesh = trimesh.Trimesh(geometry.corners.reshape(-1, 3), np.arange(3 * len(geometry.corners)).reshape(-1, 3), process=False)
    mesh.merge_vertices(digits_vertex=7)
    normal = np.cross(*np.diff(geometry.corners, axis=1).transpose(1, 0, 2)).reshape(-1, 3)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    pairs, ends = np.asarray(mesh.face_adjacency).reshape(-1, 2), np.asarray(mesh.face_adjacency_edges).reshape(-1, 2)
    alone = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    faces = np.concatenate([pairs, np.repeat(np.asarray(mesh.edges_face)[alone][:, None], 2, axis=1)]).astype(int)
    ends = np.concatenate([ends, np.asarray(mesh.edges_sorted)[alone]])
    points = np.asarray(mesh.vertices)
    start, way = points[ends[:, 0]], points[ends[:, 1]] - points[ends[:, 0]]
    length = np.linalg.norm(way, axis=1)
    along = way / np.maximum(length, 1e-30)[:, None]
    into = [_across(geometry.corners[faces[:, i]].mean(axis=1) - start, along) for i in range(2)]
    up = normal[faces[:, 0]].copy()
    closed = geometry.hollow_m[faces[:, 0]] > 0
    turn = np.arctan2(np.einsum("ij,ij->i", into[1], up), np.einsum("ij,ij->i", into[1], into[0])) % (2 * np.pi)
    turn[faces[:, 0] == faces[:, 1]] = 2 * np.pi
    inwards = ~closed & (turn < np.pi)  # a sheet hides from both sides; its open sector is the larger one
    up[inwards] *= -1
    turn = np.where(inwards, 2 * np.pi - turn, turn)
    kept = (turn > np.pi + FLAT_RAD) & (length > 0)
    owner = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(geometry.corners))[faces[:, 0]]
    sides = np.full((len(faces), 2), -1)
    # `angle` needs a right-handed system of into, up and along
    flipped = np.einsum("ij,ij->i", np.cross(into[0], up), along) < 0
    along[flipped] *= -1
    start = np.where(flipped[:, None], points[ends[:, 1]], start)
    edges = (start, along, length, into[0], up, turn / np.pi, sides)
    return _parts(owner[kept], geometry.surface[faces[kept, 0]], [values[kept] for values in edges])


def _across(way: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the unit vectors (N, 3) of the components of `way` perpendicular to `along`."""
    out = way - np.einsum("ij,ij->i", way, along)[:, None] * along
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-30)


def _parts(owner: np.ndarray, surface: np.ndarray, edges: Sequence[np.ndarray]) -> Outlines:
    """Divide the edges of each `owner` (a surface or a connected body) into parts. The edges of a part are near each other and belong to
    faces of similar normals.
    """
    start, along, length, into, up, opening, _ = edges
    other = np.sin(np.pi * opening)[:, None] * into - np.cos(np.pi * opening)[:, None] * up
    middle = start + length[:, None] / 2 * along
    likeness = np.concatenate([(up + other) / np.maximum(np.linalg.norm(up + other, axis=1), 1e-30)[:, None], middle], axis=1)
    pieces = [np.flatnonzero(owner == one) for one in np.unique(owner)]
    divided = [_halved(piece, likeness) for piece in pieces]
    groups = [group for some in divided for group in some]
    order = np.concatenate([np.zeros(0, int), *groups])
    first = np.cumsum([0, *(len(group) for group in groups)])
    centre, radius, axis, cone = np.zeros((len(groups), 3)), np.zeros(len(groups)), np.zeros((len(groups), 3)), np.zeros((len(groups), 2))
    for i, group in enumerate(groups):
        points = np.concatenate([start[group], start[group] + length[group, None] * along[group]])
        centre[i] = (points.min(axis=0) + points.max(axis=0)) / 2
        radius[i] = np.linalg.norm(points - centre[i], axis=1).max()
        normals = np.concatenate([up[group], other[group]])
        axis[i] = normals.sum(axis=0) / max(np.linalg.norm(normals.sum(axis=0)), 1e-30)
        widest = np.arccos(np.clip((normals @ axis[i]).min(), 0.0, 1.0))
        cone[i] = np.cos(widest), np.sin(widest)
    edges = [np.ascontiguousarray(values[order]) for values in (*edges, other)]
    part_surface = np.array([surface[piece[0]] for piece, some in zip(pieces, divided, strict=True) for _ in some], int)
    return Outlines(first, centre, radius, part_surface, axis, cone, *edges)


def _halved(group: np.ndarray, likeness: np.ndarray) -> list[np.ndarray]:
    """Divide the indices of a group at the median of the column of `likeness` with the largest range, down to GROUP indices each."""
    if len(group) <= GROUP:
        return [group]
    column = likeness[group, np.ptp(likeness[group], axis=0).argmax()]
    order = group[np.argsort(column, kind="stable")]
    return [*_halved(order[: len(order) // 2], likeness), *_halved(order[len(order) // 2 :], likeness)]


@innermost
def near(centre: Vector, radius: float, source: Vector, way: Vector, low: float, high: float, total: float, excess: float) -> bool:
    """Return whether a ball can reach into the part from `low` to `high` of the ellipsoid about a straight path of the length `total`.

    A path over a point on the surface of the ellipsoid is longer than the straight path by `excess`.
    """
    along = dot(centre, way) - dot(source, way)
    aside = math.sqrt(max(distance(centre, source) ** 2 - along * along, 0.0))
    if along + radius < low or along - radius > high:
        return False
    thickest = min(max(0.5 * total, along - radius), along + radius)
    share = (thickest - 0.5 * total) / (0.5 * (total + excess))
    return aside < radius + 0.5 * math.sqrt(excess * (2 * total + excess) * max(1 - share * share, 0.0))


@innermost
def reach_around(centre: Vector, radius: float, source: Vector, receiver: Vector, wavenumber: float) -> float:
    """Return the Fresnel coordinate up to which the edges of a body in a ball change the field of a line: all edges if the line passes
    through the ball, and REACH if the ball is farther than REACH from the line.
    """
    length = distance(source, receiver)
    if length < 1e-9:
        return REACH
    way = toward(source, receiver, length)
    along = min(max(dot(centre, way) - dot(source, way), 0.0), length)
    aside = distance(centre, moved(source, way, along))
    unit = math.sqrt(math.pi / wavenumber * max(along * (length - along) / length, 1e-6))  # width of one Fresnel coordinate
    share = min(max(1 - (aside - radius) / (REACH * unit), 0.0), 1.0)
    return REACH + share * max((aside + radius) / (0.9 * unit) - REACH, 0.0)


@innermost
def _has_silhouette(outlines: Outlines, c: int, source: Vector) -> bool:
    """Return False if a source is in front of all faces at the edges of part `c`, or behind all of them: no edge is a silhouette."""
    way = toward(vector(outlines.centre, c), source, 1.0)
    axis = vector(outlines.axis, c)
    along = dot(way, axis)
    across = math.sqrt(max(dot(way, way) - along * along, 0.0))
    return abs(along) * outlines.cone[c, 0] - across * outlines.cone[c, 1] <= outlines.radius[c] + OUTSIDE_M


@innermost
def _touches(outlines: Outlines, c: int, point: Point, normal: Point) -> bool:
    """Return whether the ball around part `c` reaches the plane of a mirror with a point and a normal; False for a normal of zero."""
    height, size = 0.0, 0.0
    for k in range(3):
        height += (outlines.centre[c, k] - point[k]) * normal[k]
        size += abs(normal[k])
    return size > 0 and abs(height) < outlines.radius[c] + IN_PLANE_M


@innermost
def _lies_in(outlines: Outlines, e: int, point: Point, normal: Point) -> bool:
    """Return whether edge `e` lies in the plane of a mirror with a point and a normal; False for a normal of zero."""
    first, slope, size = 0.0, 0.0, 0.0
    for k in range(3):
        first += (outlines.start[e, k] - point[k]) * normal[k]
        slope += outlines.along[e, k] * normal[k]
        size += abs(normal[k])
    return size > 0 and abs(first) < IN_PLANE_M and abs(first + outlines.length[e] * slope) < IN_PLANE_M


@innermost
def factor(
    outlines: Outlines, tree: Hierarchy, opaque: np.ndarray, start: Point, end: Point, before: float, after: float,
    normal_a: Point, normal_b: Point, wavenumber: float, mirror_a: int, mirror_b: int, found: np.ndarray, others: np.ndarray,
) -> complex:  # fmt: skip
    """Return the factor of a line for exp(+j k L): 1 if it is clear and 0 if a body blocks it, plus the edge waves of all bodies.

    Args:
        outlines, tree: edges and triangles of all bodies. opaque: (surfaces,) whether a surface blocks.
        start, end: (3,) ends of the line. before, after: lengths in metres of the path from its source to `start` and from `end` to its
            receiver, over mirrors at the ends; zero where the line starts at the source or ends at the receiver.
        normal_a, normal_b: (3,) normals of the mirrors at the ends, or zero. An edge in the plane of a mirror does not count, because the
            body and its image join there without an edge.
        mirror_a, mirror_b: mirrors of the path, or -1; their own edges do not count.
        found, others: (MAX_PANES,) int and (surfaces,) bool, memory.
    """
    whole = 1 + 0j if crossed(tree, start, end, opaque, found) >= 0 else 0j
    length = distance(start, end)
    if length < 1e-9:
        return whole
    way = toward(start, end, length)
    source, receiver = moved(start, way, -before), moved(end, way, after)
    # `excess` is the excess length for the Fresnel coordinate REACH both across and along an edge.
    total, excess = before + length + after, math.pi * REACH * REACH / wavenumber
    low, high = before - BEYOND_M - excess, before + length + BEYOND_M + excess
    blocking = 0  # number of surfaces that block
    for i in range(len(opaque)):
        others[i] = opaque[i]
        blocking += opaque[i]
    for c in range(len(outlines.radius)):
        if not _has_silhouette(outlines, c, source):
            continue
        if not near(vector(outlines.centre, c), outlines.radius[c], source, way, low, high, total, excess):
            continue
        at_a, at_b = _touches(outlines, c, start, normal_a), _touches(outlines, c, end, normal_b)
        for e in range(outlines.first[c], outlines.first[c + 1]):
            if not _is_silhouette(outlines, e, source):
                continue
            own = (at_a and _lies_in(outlines, e, start, normal_a)) or (at_b and _lies_in(outlines, e, end, normal_b))
            for k in range(2):
                own |= outlines.sides[e, k] >= 0 and (outlines.sides[e, k] in (mirror_a, mirror_b))
            if own:
                continue
            begin, along = vector(outlines.start, e), vector(outlines.along, e)
            value, z = edge_part(begin, along, outlines.length[e], source, receiver, wavenumber, REACH)
            if value == 0:
                continue
            z = min(max(z, 0.0), outlines.length[e])
            half = 0.5 * math.pi * outlines.opening[e]
            x = moved(moved(begin, along, z), vector(outlines.into, e), OUTSIDE_M * math.cos(half))
            x = moved(x, vector(outlines.up, e), OUTSIDE_M * math.sin(half))
            reached = dot(x, way) - dot(start, way)
            if (before > 0 and reached < -BEYOND_M) or (after > 0 and reached > length + BEYOND_M):
                continue  # the path has left the line at a mirror
            if abs(value) > SEEN:
                own_blocks = opaque[outlines.surface[c]]
                others[outlines.surface[c]] = False  # a thick body hides its own outline, but the wave creeps around it
                hidden = blocking > own_blocks and (crossed(tree, start, x, others, found) < 0 or crossed(tree, x, end, others, found) < 0)
                others[outlines.surface[c]] = own_blocks
                if hidden:
                    continue
            whole += _side(outlines, e, source, receiver) * value
    return whole


@innermost
def _is_silhouette(outlines: Outlines, e: int, source: Point) -> bool:
    """Return whether a source sees exactly one of the two faces of edge `e`, so that the edge begins to hide the space behind it."""
    over, over_n = 0.0, 0.0
    for k in range(3):
        over += (source[k] - outlines.start[e, k]) * outlines.up[e, k]
        over_n += (source[k] - outlines.start[e, k]) * outlines.other[e, k]
    return outlines.opening[e] > 1 and (over >= -GRAZING_M) != (over_n >= -GRAZING_M)  # a source in the plane of a face sees it


@innermost
def _side(outlines: Outlines, e: int, start: Point, end: Point) -> float:
    """Return +1 if edge `e`, which is a silhouette from `start`, hides `end`, and -1 if it hides a place beside `end`."""
    at, into, up = vector(outlines.start, e), vector(outlines.into, e), vector(outlines.up, e)
    source, receiver = toward(at, start, 1.0), toward(at, end, 1.0)
    above = dot(receiver, up) >= 0  # face 0; `turned` has the sign of the sine of the angle from source to receiver
    turned = dot(source, into) * dot(receiver, up) - dot(source, up) * dot(receiver, into)
    if dot(source, up) >= 0:
        return 1.0 if not above and turned < 0 else -1.0
    return 1.0 if (above and turned > 0) or (not above and dot(receiver, vector(outlines.other, e)) < 0) else -1.0
