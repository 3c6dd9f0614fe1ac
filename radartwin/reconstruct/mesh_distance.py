"""Measure distances from points to triangle meshes, and spread points evenly on meshes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from scipy.spatial import KDTree

SPACING_M = 0.02
NEIGHBOURS = 6


class Nearest:
    """Finds the triangle nearest to each given point among the triangles of several meshes, from sample points on the triangles.

    The sample points are about `spacing_m` apart. For each given point, the search computes the exact distances to the triangles of the
    NEIGHBOURS nearest sample points. The smallest of these exact distances exceeds the true distance d from the point to
    the meshes by less than spacing_m^2 / (2 d).
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh], spacing_m: float = SPACING_M) -> None:
        triangles = np.vstack([np.asarray(m.triangles, dtype=np.float64) for m in meshes])
        self.mesh_of = np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes])
        self.triangles = triangles
        samples, self._face = covered(triangles, spacing_m)
        self._tree = KDTree(samples, balanced_tree=False, compact_nodes=False)

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distance (N,) in metres from points (N, 3) to the nearest triangle, and the triangle's index (N,) in `triangles`."""
        points = np.asarray(points, dtype=np.float64)
        _, near = self._tree.query(points, k=min(NEIGHBOURS, self._tree.n), workers=-1)
        near = near.reshape(len(points), -1)
        best = np.full(len(points), np.inf)
        which = np.zeros(len(points), dtype=np.int64)
        for column in near.T:
            face = self._face[column]
            distance = np.linalg.norm(points - trimesh.triangles.closest_point(self.triangles[face], points), axis=1)
            closer = distance < best
            best[closer], which[closer] = distance[closer], face[closer]
        return best, which


def to_mesh(points: np.ndarray, mesh: trimesh.Trimesh) -> np.ndarray:
    """Return the distances (N,) in metres from points (N, 3) to a mesh.

    >>> box = trimesh.creation.box((2, 2, 2))
    >>> to_mesh(np.array([[0.0, 0.0, 1.5], [1.0, 1.0, 1.0]]), box).round(6).tolist()
    [0.5, 0.0]
    """
    return Nearest([mesh])(points)[0]


def covered(triangles: np.ndarray, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Sample triangles (F, 3, 3) so that every point of a triangle is at most about `spacing_m` away from a sample on this triangle.

    Returns the samples (N, 3) in metres, and the index (N,) of the triangle on which each sample lies.
    """
    longest = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    steps = np.maximum(np.ceil(longest / spacing_m).astype(int), 1)
    points, faces = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    for n in np.unique(steps):
        group = np.flatnonzero(steps == n)
        if n == 1:
            points.append(triangles[group].mean(axis=1))
            faces.append(group)
            continue
        u, v = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
        inside = u + v <= n
        weights = np.stack([n - u[inside] - v[inside], u[inside], v[inside]], axis=1) / n
        points.append((weights @ triangles[group]).reshape(-1, 3))
        faces.append(np.repeat(group, len(weights)))
    return np.vstack(points), np.concatenate(faces)


def spread(mesh: trimesh.Trimesh, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (N, 3) spread evenly on a mesh, one point per area of about spacing_m^2, and the face index (N,) of each point."""
    points, face = covered(np.asarray(mesh.triangles), spacing_m)
    area = np.asarray(mesh.area_faces) / np.maximum(np.bincount(face, minlength=len(mesh.faces)), 1)
    total = np.cumsum(area[face])
    count = max(1, round(total[-1] / spacing_m**2)) if len(total) else 0
    sample = np.searchsorted(total, (np.arange(count) + 0.5) / max(count, 1) * (total[-1] if len(total) else 0.0))
    return points[sample], face[sample]


def farthest_points(points: np.ndarray, count: int, first: int = 0) -> list[int]:
    """Select `count` of the points (N, D) far apart by farthest-point sampling from point number `first`, and return their indices."""
    indices = [first]
    distance = np.linalg.norm(points - points[first], axis=1)
    while len(indices) < min(count, len(points)):
        indices.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[indices[-1]], axis=1))
    return indices
