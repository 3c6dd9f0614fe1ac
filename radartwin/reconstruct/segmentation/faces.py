"""Compute per-face arrays of a mesh for segmentation, fit planes to sets of faces, and define segments."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import trimesh

MIN_FITTED = 12  # with fewer faces the plane takes their mean normal, because a fitted plane would follow their noise


@dataclass(frozen=True, eq=False)
class Faces:
    """Arrays of F faces.

    Attributes:
        corners, centre, area: (F, 3, 3) and (F, 3) in metres, and (F,) in m2.
        normal: (F, 3) normals averaged over neighbours.
        coherence: (F,) agreement of the averaged normals, 1 if they are all equal.
        adjacency: (F, F) sparse matrix, 1 where two faces share an edge.
        rounds: number of averaging rounds of the normals. Each round includes one more ring of neighbours.
    """

    corners: np.ndarray
    centre: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    coherence: np.ndarray
    adjacency: sp.csr_matrix
    rounds: int

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, smoothing_m: float) -> Faces:
        """Compute the arrays of a mesh. Faces larger than the smoothing radius keep their own normals."""
        count = len(mesh.faces)
        i, j = np.asarray(mesh.face_adjacency).reshape(-1, 2).T
        ones = np.ones(2 * len(i))
        adjacency = sp.csr_matrix((ones, (np.r_[i, j], np.r_[j, i])), shape=(count, count))
        corners = np.asarray(mesh.triangles)
        own = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        area = np.linalg.norm(own, axis=1)
        small = area < smoothing_m**2 / 2
        # Averaging is a random walk over faces, so n rounds reach about sqrt(n) edges. The limit of 20 bounds the time on fine meshes.
        edge = np.sqrt(2 * np.median(area[small])) if small.any() else np.inf
        rounds = int(np.clip(np.ceil((smoothing_m / edge) ** 2), 0, 20)) if small.any() else 0
        values = np.column_stack([own, area])
        keep = values[~small]
        walk = adjacency + sp.identity(count, format="csr")
        for _ in range(rounds):
            values = walk @ values
            values[~small] = keep
        length = np.linalg.norm(values[:, :3], axis=1)
        normal = values[:, :3] / np.maximum(length, 1e-300)[:, None]
        coherence = length / np.maximum(values[:, 3], 1e-300)
        return cls(corners, corners.mean(axis=1), normal, area, coherence, adjacency, rounds)

    def distance(self, which: np.ndarray, normal: np.ndarray, offset: np.ndarray | float) -> np.ndarray:
        """Return the distance (K,) of each face's farthest corner from one plane, or from a plane per face if `normal` is (K, 3)."""
        height = np.einsum("kci,i->kc" if normal.ndim == 1 else "kci,ki->kc", self.corners[which], normal)
        return np.abs(height - np.reshape(offset, (-1, 1))).max(axis=1, initial=0.0)

    def plane(self, which: np.ndarray) -> tuple[np.ndarray, float]:
        """Fit an area-weighted least-squares plane (normal, offset) to the faces `which`. The normal points to the visible side."""
        weight = self.area[which] / self.area[which].sum()
        centre = weight @ self.centre[which]
        shown = weight @ self.normal[which]
        normal = shown / np.linalg.norm(shown)
        if len(which) >= MIN_FITTED:
            spread = self.centre[which] - centre
            fitted = np.linalg.eigh((weight[:, None] * spread).T @ spread)[1][:, 0]
            normal = fitted if fitted @ shown > 0 else -fitted
        return normal, float(normal @ centre)

    def planes(self, label: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit a plane to each label 0..P-1. Return normals (P, 3) and offsets (P,)."""
        found = [self.plane(which) for which in members(label)]
        return np.array([n for n, _ in found]).reshape(-1, 3), np.array([d for _, d in found])


@dataclass(frozen=True, eq=False)
class Segment:
    """A set of faces that forms one surface.

    Attributes:
        faces: (K,) face indices of the mesh.
        normal, offset_m: the fitted plane normal . x = offset_m, normal towards the visible side; None if the segment is not planar.
        body: segments with the same number >= 0 are sides of one object; -1 if the segment is not part of an object.
        noise: whether the segment consists of scattered fragments and is no surface.
    """

    faces: np.ndarray
    area_m2: float
    normal: np.ndarray | None = None
    offset_m: float = 0.0
    body: int = -1
    noise: bool = False


def members(label: np.ndarray) -> list[np.ndarray]:
    """Return the ascending face indices of each label 0..max. Faces with negative labels are left out."""
    order = np.argsort(label, kind="stable")
    count = int(label.max(initial=-1)) + 1
    bounds = np.searchsorted(label[order], np.arange(count + 1))
    return [order[a:b] for a, b in itertools.pairwise(bounds)]


def thinned(points: np.ndarray, spacing_m: float = 0.03) -> np.ndarray:
    """Return the ascending indices of one point of (N, 3) per occupied cube with edge spacing_m."""
    key = np.floor((points - points.min(axis=0)) / spacing_m).astype(np.int64)
    size = key.max(axis=0) + 1
    return np.sort(np.unique((key[:, 0] * size[1] + key[:, 1]) * size[2] + key[:, 2], return_index=True)[1])
