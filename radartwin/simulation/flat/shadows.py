"""Shadows of bodies on straight lines, as factors of the field.

The factor of a line is 1 where it is clear and 0 where a body blocks it, plus the edge waves (`kirchhoff`) of the body's outline as seen
from the line's start. It is smooth across the border of a shadow. The outline consists of those edges at which the body begins to hide
what is behind. Flat and curved bodies use the same rule, because a curved mesh has an edge between each two facets. Transmission is not
part of the factor.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import trimesh

from radartwin.compiled import compiled, innermost
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.flat.field import NUDGE
from radartwin.simulation.flat.kirchhoff import edge_part
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, crossed
from radartwin.simulation.geometry import Geometry

REACH = 8.0  # Fresnel coordinate beyond which edges are ignored; such an edge changes a factor by at most 0.04
SEEN = 0.02  # weaker edge waves are added without a test whether their edge is visible
OUTSIDE_M = 2e-6  # visibility is tested this far outside an edge
FLAT_RAD = 1e-3  # edges between faces whose normals differ less are no edges


class Outlines(NamedTuple):
    """Hold E edges at which bodies can begin to hide a line, in C parts.

    Attributes:
        first: (C + 1,) range of each part. centre: (C, 3), radius: (C,) ball around each part, metres. surface: (C,) its surface.
        start, along, length, into, up, opening, sides: of each edge, as in `radartwin.simulation.flat.faces.Faces`; a side is -1 where the
            body is a mesh without faces.
    """

    first: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    surface: np.ndarray
    start: np.ndarray
    along: np.ndarray
    length: np.ndarray
    into: np.ndarray
    up: np.ndarray
    opening: np.ndarray
    sides: np.ndarray

    @staticmethod
    def concatenate(parts: "Sequence[Outlines]") -> "Outlines":
        """Join outlines; the faces of all parts must be numbered together."""
        bounds = np.cumsum([0, *(len(part.length) for part in parts)])
        first = np.concatenate([np.zeros(1, int), *(part.first[1:] + low for part, low in zip(parts, bounds, strict=False))])
        return Outlines(first, *(np.concatenate(values) for values in list(zip(*parts, strict=True))[1:]))


def of_faces(faces: Faces) -> Outlines:
    """Return the outlines of flat faces, one part per surface."""
    owner = faces.surface[faces.sides[:, 0]] if len(faces.length) else np.zeros(0, int)
    edges = (faces.start, faces.along, faces.length, faces.into, faces.up, faces.opening, faces.sides)
    return _parts(owner, owner, edges)


def of_mesh(geometry: Geometry) -> Outlines:
    """Return the outlines of all triangles of a geometry, one part per connected piece."""
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
    order = np.argsort(owner, kind="stable")
    edges = [np.ascontiguousarray(values[order]) for values in edges]
    first = np.append(np.flatnonzero(np.diff(owner[order], prepend=-1)), len(owner))
    centre, radius = np.zeros((len(first) - 1, 3)), np.zeros(len(first) - 1)
    for i in range(len(first) - 1):
        here = slice(first[i], first[i + 1])
        points = np.concatenate([edges[0][here], edges[0][here] + edges[2][here, None] * edges[1][here]])
        centre[i] = (points.min(axis=0) + points.max(axis=0)) / 2
        radius[i] = np.linalg.norm(points - centre[i], axis=1).max()
    return Outlines(first, centre, radius, np.ascontiguousarray(surface[order][first[:-1]], int), *edges)


@innermost
def _is_near(centre: np.ndarray, radius: float, start: np.ndarray, end: np.ndarray, wavenumber: float) -> bool:
    """Return whether a ball lies within the Fresnel coordinate REACH of a line."""
    square, along, away = 0.0, 0.0, 0.0
    for k in range(3):
        square += (end[k] - start[k]) ** 2
        along += (centre[k] - start[k]) * (end[k] - start[k])
    share = min(max(along / max(square, 1e-12), 0.0), 1.0)
    for k in range(3):
        away += (centre[k] - start[k] - share * (end[k] - start[k])) ** 2
    # an excess length e over a line of length L reaches at most sqrt(e (2 L + e))/2 to the side
    excess = math.pi * REACH * REACH / (2 * wavenumber)
    return math.sqrt(away) < radius + 0.5 * math.sqrt(excess * (2 * math.sqrt(square) + excess)) + excess


@compiled
def factor(
    outlines: Outlines, tree: Hierarchy, opaque: np.ndarray, start: np.ndarray, end: np.ndarray, wavenumber: float, mirror_a: int,
    mirror_b: int,
) -> complex:  # fmt: skip
    """Return the factor of a line for exp(+j k L).

    Args:
        outlines, tree: edges and triangles of all bodies. opaque: (surfaces,) whether a surface blocks.
        start, end: (3,) ends of the line. mirror_a, mirror_b: faces on which the ends lie, or -1; their own edges do not count.
    """
    found = np.empty(MAX_PANES, np.int64)
    total = complex(1.0 if crossed(tree, start, end, opaque, found) >= 0 else 0.0, 0.0)
    x = np.empty(3)
    others = opaque.copy()
    for c in range(len(outlines.radius)):
        if not _is_near(outlines.centre[c], outlines.radius[c], start, end, wavenumber):
            continue
        for e in range(outlines.first[c], outlines.first[c + 1]):
            own = False
            for side in range(2):
                own |= outlines.sides[e, side] >= 0 and (outlines.sides[e, side] in (mirror_a, mirror_b))
            if own:
                continue
            part = edge_part(outlines.start[e], outlines.along[e], outlines.length[e], start, end, wavenumber, REACH)
            if part == 0:
                continue
            sign = _side(outlines, e, start, end)
            if sign == 0:
                continue
            if abs(part) > SEEN:
                z_s, z_r, h_s, h_r = 0.0, 0.0, 0.0, 0.0
                for k in range(3):
                    z_s += (start[k] - outlines.start[e, k]) * outlines.along[e, k]
                    z_r += (end[k] - outlines.start[e, k]) * outlines.along[e, k]
                for k in range(3):
                    h_s += (start[k] - outlines.start[e, k] - z_s * outlines.along[e, k]) ** 2
                    h_r += (end[k] - outlines.start[e, k] - z_r * outlines.along[e, k]) ** 2
                h_s, h_r = math.sqrt(h_s), math.sqrt(h_r)
                z = min(max((z_s * h_r + z_r * h_s) / max(h_s + h_r, 1e-12), 0.0), outlines.length[e])
                half = 0.5 * math.pi * outlines.opening[e]
                for k in range(3):
                    outwards = math.cos(half) * outlines.into[e, k] + math.sin(half) * outlines.up[e, k]
                    x[k] = outlines.start[e, k] + z * outlines.along[e, k] + OUTSIDE_M * outwards
                others[outlines.surface[c]] = False  # a thick body hides its own outline, but the wave creeps around it
                hidden = crossed(tree, start, x, others, found) < 0 or crossed(tree, x, end, others, found) < 0
                others[outlines.surface[c]] = opaque[outlines.surface[c]]
                if hidden:
                    continue
            total += sign * part
    return total


@innermost
def _side(outlines: Outlines, e: int, start: np.ndarray, end: np.ndarray) -> float:
    """Return +1 if edge `e` hides `end` from `start`, -1 if it hides a place beside `end`, 0 if it hides nothing."""
    limit = outlines.opening[e] * math.pi
    up, into = 0.0, 0.0
    for k in range(3):
        up += (start[k] - outlines.start[e, k]) * outlines.up[e, k]
        into += (start[k] - outlines.start[e, k]) * outlines.into[e, k]
    source = math.atan2(up, into)
    if source < 0:
        source += 2 * math.pi
    if source > limit or limit - math.pi <= source <= math.pi:
        return 0.0
    up, into = 0.0, 0.0
    for k in range(3):
        up += (end[k] - outlines.start[e, k]) * outlines.up[e, k]
        into += (end[k] - outlines.start[e, k]) * outlines.into[e, k]
    receiver = math.atan2(up, into)
    if receiver < 0:
        receiver += 2 * math.pi
    if source < math.pi:
        return 1.0 if receiver > source + math.pi else -1.0
    return 1.0 if receiver < source - math.pi or receiver > limit else -1.0


@compiled
def cast(
    begin: int, stop: int, outlines: Outlines, tree: Hierarchy, opaque: np.ndarray, sensor: np.ndarray, points: np.ndarray,
    wavenumber: float, out: np.ndarray,
) -> None:  # fmt: skip
    """Write the product of the factors of all lines of the paths `begin` to `stop` - 1 to `out` (N,).

    The paths begin a little beside the sensor, because the factor of a line exactly over an edge is not defined.

    Args:
        outlines, tree, opaque: the bodies that cast shadows. sensor: (N, 3) first and last point of each path. points: (N, V, 3) the points
            between, nan beyond the last.
    """
    for n in range(begin, stop):
        begins = sensor[n] + NUDGE / wavenumber
        total, at = 1 + 0j, begins
        for i in range(points.shape[1]):
            if math.isnan(points[n, i, 0]):
                break
            total *= factor(outlines, tree, opaque, at, points[n, i], wavenumber, -1, -1)
            at = points[n, i]
        out[n] = total * factor(outlines, tree, opaque, at, begins, wavenumber, -1, -1)
