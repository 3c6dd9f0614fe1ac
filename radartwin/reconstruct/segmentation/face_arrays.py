"""Compute per-face arrays of a mesh for segmentation, fit planes to sets of faces, and define segments."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import trimesh

from radartwin.reconstruct.mesh_distance import covered

SAMPLE_M = 0.03  # distance between the sample points of a face
MIN_FITTED = 12  # with fewer faces the plane takes the mean normal of the faces, because a fitted plane would follow the noise


@dataclass(frozen=True, eq=False)
class Faces:
    """Geometric properties of the F faces of a mesh, as arrays.

    Attributes:
        corners: (F, 3, 3) corner positions, metres.
        centre: (F, 3) centres, metres.
        area: (F,) areas, m2.
        normal: (F, 3) unit normals, averaged over neighbouring faces.
        coherence: (F,) length of the mean of the neighbouring unit normals; 1 if these normals are all equal.
        adjacency: (F, F) sparse matrix, 1 where two faces share an edge.
        rounds: number of times that the normals were averaged over neighbouring faces.
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
        """Compute the arrays of a mesh, and average the normals over a radius of `smoothing_m`. Larger faces keep their own normals."""
        count = len(mesh.faces)
        i, j = np.asarray(mesh.face_adjacency).reshape(-1, 2).T
        ones = np.ones(2 * len(i))
        adjacency = sp.csr_matrix((ones, (np.r_[i, j], np.r_[j, i])), shape=(count, count))
        corners = np.asarray(mesh.triangles)
        area_vector = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
        area = np.linalg.norm(area_vector, axis=1)
        small = area < smoothing_m**2 / 2
        # Averaging is a random walk over faces, so n rounds reach over about sqrt(n) edges. The limit of 20 bounds the time on fine meshes.
        edge = np.sqrt(2 * np.median(area[small])) if small.any() else np.inf
        rounds = int(np.clip(np.ceil((smoothing_m / edge) ** 2), 0, 20)) if small.any() else 0
        values = np.column_stack([area_vector, area])
        keep = values[~small]
        walk = adjacency + sp.identity(count, format="csr")
        for _ in range(rounds):
            values = walk @ values
            values[~small] = keep
        length = np.linalg.norm(values[:, :3], axis=1)
        normal = values[:, :3] / np.maximum(length, 1e-300)[:, None]
        coherence = length / np.maximum(values[:, 3], 1e-300)
        return cls(corners, corners.mean(axis=1), normal, area, coherence, adjacency, rounds)

    @functools.cached_property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (N, 3) that cover the faces and their borders, however large a face is, and the face index (N,) of each point."""
        return covered(self.corners, SAMPLE_M)

    def distance(self, which: np.ndarray, normal: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Return the distance (K,) in metres of the farthest corner of each of K faces from its plane, `normal` (K, 3), `offset` (K,)."""
        return np.abs(np.einsum("kci,ki->kc", self.corners[which], normal) - offset[:, None]).max(axis=1)

    def plane(self, which: np.ndarray) -> tuple[np.ndarray, float]:
        """Fit an area-weighted least-squares plane (unit normal, offset in metres) to the faces `which`.

        The normal points to the visible side.
        """
        weight = self.area[which] / self.area[which].sum()
        centre = weight @ self.centre[which]
        mean_normal = weight @ self.normal[which]
        normal = mean_normal / np.linalg.norm(mean_normal)
        if len(which) >= MIN_FITTED:
            spread = self.centre[which] - centre
            fitted = np.linalg.eigh((weight[:, None] * spread).T @ spread)[1][:, 0]
            normal = fitted if fitted @ mean_normal > 0 else -fitted
        return normal, float(normal @ centre)

    def planes(self, label: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit a plane to the faces of each of P pieces. Return unit normals (P, 3) and offsets (P,) in metres.

        `label` (F,) is the piece number 0..P-1 of each face; faces with -1 are ignored.
        """
        planes = [self.plane(which) for which in members(label)]
        return np.array([n for n, _ in planes]).reshape(-1, 3), np.array([d for _, d in planes])


@dataclass(frozen=True, eq=False)
class Segment:
    """A set of mesh faces that forms a single surface.

    Attributes:
        faces: (K,) face indices of the mesh.
        normal, offset_m: the fitted plane normal . x = offset_m, with the normal towards the visible side; None if the segment is not
            planar.
        body: number of the object; segments with the same number >= 0 are sides of the same object, and -1 means that the object is
            unknown.
        noise: whether the segment is a collection of scattered fragments instead of a surface.
    """

    faces: np.ndarray
    area_m2: float
    normal: np.ndarray | None = None
    offset_m: float = 0.0
    body: int = -1
    noise: bool = False


def members(label: np.ndarray) -> list[np.ndarray]:
    """Return the ascending face indices of each piece 0..max.

    `label` is the piece number of each face; faces with negative numbers are left out.
    """
    order = np.argsort(label, kind="stable")
    count = int(label.max(initial=-1)) + 1
    bounds = np.searchsorted(label[order], np.arange(count + 1))
    return [order[a:b] for a, b in itertools.pairwise(bounds)]


def thinned(points: np.ndarray, spacing_m: float = 0.03) -> np.ndarray:
    """Thin points (N, 3): return the ascending indices of a subset with a single point in each occupied cube of edge `spacing_m`."""
    key = np.floor((points - points.min(axis=0)) / spacing_m).astype(np.int64)
    size = key.max(axis=0) + 1
    return np.sort(np.unique((key[:, 0] * size[1] + key[:, 1]) * size[2] + key[:, 2], return_index=True)[1])
