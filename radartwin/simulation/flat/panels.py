"""Flat convex panels of a geometry, the mirrors of image sources.

Neighbouring faces of one surface in one plane are merged into convex polygons. Curved or small faces belong to no panel.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from radartwin.simulation.flat.aperture import MAX_CORNERS
from radartwin.simulation.geometry import Geometry

MAX_SIDES = 12  # largest number of corners of a panel
SMALLEST_M = 0.01  # smallest width of a panel, because edges dominate the echo of panels of a few wavelengths
FLAT_RAD = 2e-3  # largest angle between faces that count as coplanar
CONVEX = 1e-9


@dataclass(frozen=True)
class Panels:
    """Hold P convex polygons, whose corners run counter-clockwise about the normal.

    Attributes:
        corners: (P, MAX_SIDES, 3) metres. count: (P,) number of corners.
        normal: (P, 3) unit. offset: (P,) metres; points x on the plane have normal . x = offset.
        surface: (P,) index of the panel's surface.
        body: (P,) index of the convex solid that the panel bounds with its normal outwards, or -1.
            Paths meet such a panel only from outside.
        of_face: (F,) panel of each face of the geometry, or -1.
    """

    corners: np.ndarray
    count: np.ndarray
    normal: np.ndarray
    offset: np.ndarray
    surface: np.ndarray
    body: np.ndarray
    of_face: np.ndarray

    def __len__(self) -> int:
        return len(self.count)

    @property
    def centre(self) -> np.ndarray:
        """Return the mean (P, 3) of the corners."""
        used = np.arange(MAX_SIDES) < self.count[:, None]
        return (self.corners * used[..., None]).sum(1) / self.count[:, None]


def find(geometry: Geometry) -> Panels:
    """Find the panels of a geometry."""
    polygons: list[tuple[np.ndarray, np.ndarray, float, int, int]] = []
    bodies = _convex_bodies(geometry)
    of_face = np.full(len(geometry.corners), -1)
    flat = np.ptp(geometry.normals, axis=1).max(axis=1, initial=0.0) < 1e-4 if len(geometry.corners) else np.zeros(0, bool)
    for surface in np.unique(geometry.surface[flat]) if flat.any() else ():
        faces = np.flatnonzero(flat & (geometry.surface == surface))
        for members, normal, offset in _planes(geometry.corners[faces]):
            for polygon, triangles in _convex_pieces(geometry.corners[faces[members]], normal):
                if _width(polygon, normal) >= SMALLEST_M:
                    of_face[faces[members[triangles]]] = len(polygons)
                    polygons.append((polygon, normal, offset, int(surface), int(bodies[faces[members[0]]])))
    corners = np.zeros((len(polygons), MAX_SIDES, 3))
    for i, (polygon, *_) in enumerate(polygons):
        corners[i, : len(polygon)] = polygon
    return Panels(
        corners,
        np.array([len(p[0]) for p in polygons], int),
        np.array([p[1] for p in polygons]).reshape(-1, 3),
        np.array([p[2] for p in polygons]),
        np.array([p[3] for p in polygons], int),
        np.array([p[4] for p in polygons], int),
        of_face,
    )


def _convex_bodies(geometry: Geometry) -> np.ndarray:
    """Return the index (F,) of the closed convex body that each face bounds with its normal outwards, or -1."""
    bodies, number = np.full(len(geometry.corners), -1), 0
    for surface in np.unique(geometry.surface):
        faces = np.flatnonzero(geometry.surface == surface)
        mesh = trimesh.Trimesh(geometry.corners[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), process=False)
        mesh.merge_vertices(digits_vertex=7)
        parts = trimesh.graph.connected_components(np.asarray(mesh.face_adjacency).reshape(-1, 2), nodes=np.arange(len(faces)), min_len=4)
        for part in parts:
            one: Any = mesh.submesh([np.asarray(part, int)], append=True, repair=False)
            if one.is_volume and one.volume > 0 and bool(np.asarray(one.face_adjacency_convex).all()):
                bodies[faces[np.asarray(part, int)]] = number
                number += 1
    return bodies


def _planes(corners: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Return (face indices, unit normal, offset) of each set of connected coplanar faces."""
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)
    mesh.merge_vertices(digits_vertex=7)
    pairs = np.asarray(mesh.face_adjacency).reshape(-1, 2)
    pairs = pairs[np.asarray(mesh.face_adjacency_angles).reshape(-1) < FLAT_RAD]
    groups = trimesh.graph.connected_components(pairs, nodes=np.arange(len(corners)), min_len=1)
    out = []
    for group in groups:
        members = np.sort(np.asarray(group, int))
        a, b, c = corners[members].transpose(1, 0, 2)
        area = np.cross(b - a, c - a)
        area *= np.sign(area @ area[np.argmax(np.linalg.norm(area, axis=1))])[:, None]
        normal = area.sum(0)
        normal /= max(np.linalg.norm(normal), 1e-30)
        out.append((members, normal, float((corners[members].reshape(-1, 3) @ normal).mean())))
    return out


def _convex_pieces(corners: np.ndarray, normal: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Merge triangles (N, 3, 3) of one plane into convex polygons: (corners (n, 3), triangle indices) of each."""
    points, index = np.unique(np.round(corners.reshape(-1, 3), 7), axis=0, return_inverse=True)
    loops = [list(loop) for loop in index.reshape(-1, 3)]
    for i, (a, b, c) in enumerate(loops):
        if np.cross(points[b] - points[a], points[c] - points[a]) @ normal < 0:
            loops[i] = [a, c, b]
    owner = {(loop[k], loop[(k + 1) % 3]): i for i, loop in enumerate(loops) for k in range(3)}
    inside: list[list[int]] = [[i] for i in range(len(loops))]
    parent = list(range(len(loops)))

    def root(i: int) -> int:
        while parent[i] != i:
            i = parent[i]
        return i

    lengths = {edge: float(np.sum((points[edge[0]] - points[edge[1]]) ** 2)) for edge in owner}
    for edge in sorted(owner, key=lambda e: (-lengths[e], e)):  # longest shared edges first, to merge squares before strips
        other = owner.get((edge[1], edge[0]))
        if other is None:
            continue
        first, second = root(owner[edge]), root(other)
        if first == second:
            continue
        merged = _merged(loops[first], loops[second])
        if merged is None:
            continue
        tidy = _without_straight(merged, points)
        if len(tidy) <= min(MAX_SIDES, MAX_CORNERS // 2) and _is_convex(tidy, points, normal):
            loops[first] = merged
            inside[first] += inside[second]
            parent[second] = first
    return [
        (points[_without_straight(loops[i], points)], np.array(inside[i])) for i in range(len(loops)) if parent[i] == i
    ]  # fmt: skip


def _merged(first: list[int], second: list[int]) -> list[int] | None:
    """Join two counter-clockwise loops along their common chain of edges; None if they also touch elsewhere."""
    edges = [(a, b) for loop in (first, second) for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]
    known = set(edges)
    border = {a: b for a, b in edges if (b, a) not in known}
    if len(border) != sum((b, a) not in known for a, b in edges):
        return None
    start = next(iter(border), None)
    if start is None:
        return None
    loop = [start]
    while border[loop[-1]] != start:
        loop.append(border[loop[-1]])
        if len(loop) > len(border):
            return None
    return loop if len(loop) == len(border) else None


def _turns(loop: list[int], points: np.ndarray) -> np.ndarray:
    """Return the cross products (n, 3) of the unit edges before and after each corner."""
    at = points[loop]
    ahead = np.concatenate([at[1:], at[:1]]) - at
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-30)
    (a, b, c), (x, y, z) = np.concatenate([ahead[-1:], ahead[:-1]]).T, ahead.T  # written out, because np.cross is slow for small arrays
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def _without_straight(loop: list[int], points: np.ndarray) -> list[int]:
    bend = np.linalg.norm(_turns(loop, points), axis=1) > 1e-6
    return [corner for corner, keep in zip(loop, bend, strict=True) if keep]


def _is_convex(loop: list[int], points: np.ndarray, normal: np.ndarray) -> bool:
    return len(loop) >= 3 and bool((_turns(loop, points) @ normal > -CONVEX).all())


def _width(polygon: np.ndarray, normal: np.ndarray) -> float:
    """Return the smallest extent of a convex polygon perpendicular to one of its edges."""
    if len(polygon) < 3:
        return 0.0
    edges = np.roll(polygon, -1, axis=0) - polygon
    across = np.cross(normal, edges / np.maximum(np.linalg.norm(edges, axis=1, keepdims=True), 1e-30))
    return float(np.ptp(polygon @ across.T, axis=0).min())
