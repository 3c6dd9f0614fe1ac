"""How far a reconstructed mesh is from the truth of the scanned scene, and how much of what was seen it shows."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import trimesh

from radartwin.reconstruct.distance import Nearest, covered
from radartwin.reconstruct.frames import Frames
from radartwin.reconstruct.scanner.scan import ScanTruth
from radartwin.scene.scene import Scene

SAMPLE_M = 0.04  # between points compared
COVERED_M = 0.05  # a point of the truth with the mesh this near is shown
SAME_M = 0.03  # the true depth at a point's pixel, when that point is what the pixel saw
ALIGN_STEPS, ALIGN_GATE_M = 15, 0.15
FIT_POINTS, COMPARED_POINTS = 10_000, 100_000  # taken at random of the mesh's samples


@dataclasses.dataclass(frozen=True)
class Accuracy:
    """Distances in metres.

    Attributes:
        median_m, p95_m: from the mesh to the truth, after the mesh was moved as a whole to fit best, since a scan's own frame of
            reference is arbitrary.
        placed_median_m, placed_p95_m: the same where the scan says it is.
        shift_m, turn_deg: the move in between.
        coverage: share of the truth's area seen by the sensor that has the mesh within COVERED_M, after the move.
        seen: share of the truth's area that the sensor saw.
        by_surface: name -> share of its seen area that is covered, and its seen area, m2.
    """

    median_m: float
    p95_m: float
    placed_median_m: float
    placed_p95_m: float
    shift_m: float
    turn_deg: float
    coverage: float
    seen: float
    by_surface: dict[str, tuple[float, float]]

    def to_dict(self) -> dict[str, Any]:
        return dataclasses.asdict(self)


def accuracy(mesh: trimesh.Trimesh, scene: Scene, truth: ScanTruth, frames: Frames) -> Accuracy:
    """Compare a mesh fused from a virtual scan with the scene that was scanned.

    Args:
        truth, frames: of the scan: where the camera was, what each pixel saw, at which intrinsics.
    """
    nearest = Nearest([s.mesh for s in scene], SAMPLE_M)
    points = _some(covered(np.asarray(mesh.triangles), SAMPLE_M)[0], COMPARED_POINTS)
    placed, _ = nearest(points)
    move = fitted(points, nearest)
    moved = points @ move[:3, :3].T + move[:3, 3]
    distance, _ = nearest(moved)

    own, face = covered(np.asarray(nearest.triangles), SAMPLE_M)
    corners = nearest.triangles
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    area = (areas / np.bincount(face, minlength=len(areas)))[face]
    seen = seen_points(own, nearest.mesh_of[face], truth, frames)
    back = np.linalg.inv(move)
    shown = Nearest([mesh], SAMPLE_M)(own[seen] @ back[:3, :3].T + back[:3, 3])[0] < COVERED_M
    index = nearest.mesh_of[face[seen]]
    have = np.bincount(index, weights=area[seen], minlength=len(scene))
    show = np.bincount(index, weights=area[seen] * shown, minlength=len(scene))
    return Accuracy(
        median_m=float(np.median(distance)),
        p95_m=float(np.quantile(distance, 0.95)),
        placed_median_m=float(np.median(placed)),
        placed_p95_m=float(np.quantile(placed, 0.95)),
        shift_m=float(np.linalg.norm(points.mean(axis=0) - moved.mean(axis=0))),
        turn_deg=float(np.degrees(np.arccos(np.clip((np.trace(move[:3, :3]) - 1) / 2, -1, 1)))),
        coverage=float(show.sum() / max(have.sum(), 1e-12)),
        seen=float(have.sum() / area.sum()),
        by_surface={s.name: (float(show[i] / have[i]) if have[i] else 0.0, float(have[i])) for i, s in enumerate(scene) if have[i] > 0},
    )


def fitted(points: np.ndarray, nearest: Nearest) -> np.ndarray:
    """Rigid transform (4, 4) that brings points (N, 3) closest to the surfaces, point to plane."""
    from scipy.spatial.transform import Rotation

    some = _some(points, FIT_POINTS)
    corners = nearest.triangles
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-15)[:, None]
    move = np.eye(4)
    for _ in range(ALIGN_STEPS):
        now = some @ move[:3, :3].T + move[:3, 3]
        distance, face = nearest(now)
        good = distance < ALIGN_GATE_M
        middle, normal = now[good].mean(axis=0), normals[face[good]]
        gap = ((corners[face[good], 0] - now[good]) * normal).sum(axis=1)
        rows = np.hstack([np.cross(now[good] - middle, normal), normal])
        weight = 1 / (1 + (gap / 0.03) ** 2) ** 2
        step = np.linalg.solve((rows * weight[:, None]).T @ rows + 1e-6 * np.eye(6), (rows * weight[:, None]).T @ gap)
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        change = np.eye(4)
        change[:3, :3], change[:3, 3] = turn, middle + step[3:] - turn @ middle
        move = change @ move
        if np.abs(step).max() < 1e-6:
            break
    return move


def _some(points: np.ndarray, count: int) -> np.ndarray:
    return points[np.random.default_rng(0).permutation(len(points))[:count]]


def seen_points(points: np.ndarray, surface: np.ndarray, truth: ScanTruth, frames: Frames) -> np.ndarray:
    """Which points (N,) of surfaces (N,) some pixel of the scan measured."""
    seen = np.zeros(len(points), dtype=bool)
    height, width = truth.depth_m.shape[1:]
    for i, pose in enumerate(truth.poses):
        k = frames[i].intrinsics
        left = np.flatnonzero(~seen)
        left = left[(points[left] - pose[:3, 3]) @ pose[:3, 2] > 0.1]
        local = (points[left] - pose[:3, 3]) @ pose[:3, :3]
        z = local[:, 2]
        u, v = np.rint(k[0, 0] * local[:, 0] / z + k[0, 2]).astype(int), np.rint(k[1, 1] * local[:, 1] / z + k[1, 2]).astype(int)
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
        left, u, v, z = left[inside], u[inside], v[inside], z[inside]
        same = (np.abs(truth.depth_m[i, v, u] - z) < SAME_M + 0.02 * z) & (truth.surface[i, v, u] == surface[left])
        seen[left[same]] = True
    return seen
