"""Smooth and decimate parts that are not flat, and measure the simplification error."""

from __future__ import annotations

from typing import Any

import fast_simplification
import numpy as np
import trimesh

from radartwin.reconstruct.distance import to_mesh

FACE_M2 = 0.003  # area per remaining face: triangles of 8 cm
MIN_FACES, MAX_FACES = 24, 600
ERROR_M = 0.03  # 95 % of the scanned vertices lie within this distance of the simplified part
TRIES = 4


def simplified(mesh: trimesh.Trimesh, faces: np.ndarray) -> tuple[trimesh.Trimesh, float] | None:
    """Simplify the part of a scan that consists of `faces` (K,).

    The part is smoothed without shrinkage (Taubin 1995), then edges are collapsed by quadric error (Garland and Heckbert 1997).

    Returns:
        The simplified mesh.
        The 95th percentile of the scanned vertices' distance from it, metres.
        If no face remains, None is returned instead of both.
    """
    used, index = np.unique(np.asarray(mesh.faces)[faces], return_inverse=True)
    points = np.asarray(mesh.vertices)[used]
    index = index.reshape(-1, 3)
    piece = trimesh.Trimesh(points, index, process=False)
    area = float(piece.area)
    if area <= 0 or float(np.ptp(points, axis=0).max()) <= 0:
        return None
    target = int(np.clip(area / FACE_M2, MIN_FACES, MAX_FACES))
    best = piece
    error = 0.0
    if len(index) > target:
        smooth = _smoothed(points, np.asarray(piece.edges_unique))
        for _ in range(TRIES):
            if target >= len(index):
                best, error = piece, 0.0
                break
            best, error = _decimated(smooth, index, target, points)
            if error <= ERROR_M:
                break
            target *= 2
    corners = np.asarray(best.triangles)
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    thin = 2 * np.asarray(best.area_faces) < 1e-6 * np.maximum(sides.max(axis=1), 1e-12)
    best.update_faces(~thin)
    best.remove_unreferenced_vertices()
    return (best, error) if len(best.faces) else None


def _decimated(smooth: np.ndarray, index: np.ndarray, target: int, points: np.ndarray) -> tuple[trimesh.Trimesh, float]:
    triangles: Any = index
    out: Any = fast_simplification.simplify(smooth, triangles, target_count=target)
    mesh = trimesh.Trimesh(np.asarray(out[0], dtype=float), out[1], process=False)
    if not len(mesh.faces):
        return trimesh.Trimesh(points, index, process=False), 0.0
    return mesh, float(np.quantile(to_mesh(points[:: max(1, len(points) // 4000)], mesh), 0.95))


def _smoothed(points: np.ndarray, edges: np.ndarray, rounds: int = 6) -> np.ndarray:
    """Taubin smoothing: alternate a step towards the mean of the neighbours with a slightly longer step away from it."""
    count = np.maximum(np.bincount(edges.ravel(), minlength=len(points)), 1)[:, None]
    for step in (0.5, -0.53) * rounds:
        mean = np.zeros_like(points)
        for a, b in (edges.T, edges.T[::-1]):
            for k in range(3):
                mean[:, k] += np.bincount(a, points[b, k], minlength=len(points))
        points = points + step * (mean / count - points)
    return points
