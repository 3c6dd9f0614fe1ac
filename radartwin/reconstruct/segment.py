"""Coherent surfaces of a scan: planes grown over the mesh, and what is left as connected parts.

Region growing after Rabbani, van den Heuvel and Vosselman 2006, Segmentation of point clouds using smoothness
constraint: seeds in order of local flatness, neighbours join while normal and distance fit the plane, the plane is
refitted as it grows. Normals are averaged over neighbouring faces first: 5 mm of depth noise on 5 cm triangles turns a
face by 8 degrees.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp
import trimesh
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True, eq=False)
class Segment:
    """A set of faces that is one surface.

    Attributes:
        faces: (K,) face indices of the mesh.
        area_m2: their area.
        normal: (3,) of the fitted plane on the side the faces show, or None for a part that is not planar.
        offset_m: the plane is normal . x = offset_m.
    """

    faces: np.ndarray
    area_m2: float
    normal: np.ndarray | None = None
    offset_m: float = 0.0


class Segmenter(Protocol):
    """Mesh in, segments out; together they hold every face once, planes first, largest first."""

    def __call__(self, mesh: trimesh.Trimesh) -> list[Segment]: ...


@dataclass(frozen=True)
class PlanarRegionGrowing:
    """The default segmenter.

    Attributes:
        angle_deg: a face joins while its smoothed normal is this close to the plane's.
        distance_m: and its centre this close to the plane; about twice the depth noise (phone LiDAR: 1-2 cm).
        min_area_m2: a smaller plane is not one; its faces go to the leftovers.
        smoothing_m: radius over which normals are averaged; a triangle larger than this keeps its own.
        loose_deg: leftovers that touch a plane and lie within distance_m, corners and all, join it up to this angle:
            noise, not shape.
        merge_deg: touching planes that agree to this angle and distance_m are one.
        min_part_m2: connected leftovers below this area are gathered in one last segment of fragments.
    """

    angle_deg: float = 25.0
    distance_m: float = 0.04
    min_area_m2: float = 0.1
    smoothing_m: float = 0.08
    loose_deg: float = 60.0
    merge_deg: float = 10.0
    min_part_m2: float = 0.01

    def __call__(self, mesh: trimesh.Trimesh) -> list[Segment]:
        faces = _Faces.of(mesh, self.smoothing_m)
        label = self._grow(faces)
        label = self._merge(faces, label)
        self._absorb(faces, label)
        self._settle(faces, label)
        planes = [_plane_segment(faces, np.flatnonzero(label == k)) for k in range(label.max() + 1)]
        planes.sort(key=lambda s: -s.area_m2)
        return planes + self._parts(faces, np.flatnonzero(label < 0))

    def _grow(self, faces: _Faces) -> np.ndarray:
        """Plane index of every face, -1 for none."""
        label = np.full(len(faces.area), -1)
        tried = np.zeros(len(faces.area), dtype=bool)
        mark = np.full(len(faces.area), -1)  # the last seed whose region held a face: one array for all, not one each
        count = 0
        for seed in np.argsort(-faces.coherence, kind="stable"):
            if tried[seed] or label[seed] >= 0:
                continue
            region = self._region(faces, int(seed), label, mark)
            if faces.area[region].sum() >= self.min_area_m2:
                label[region] = count
                count += 1
            else:
                tried[region] = True
        return label

    def _region(self, faces: _Faces, seed: int, label: np.ndarray, mark: np.ndarray) -> np.ndarray:
        mark[seed] = seed
        frontier = np.array([seed])
        rings, count = [frontier], 1
        normal, offset = faces.normal[seed], float(faces.normal[seed] @ faces.centre[seed])
        fitted = 1
        while frontier.size:
            near = faces.neighbours(frontier)
            near = near[(mark[near] != seed) & (label[near] < 0)]
            frontier = near[self._fits(faces, near, normal, offset, self.angle_deg)]
            mark[frontier] = seed
            rings.append(frontier)
            count += len(frontier)
            if count > 1.2 * fitted:  # refit as it grows by a fifth: often while small, rarely when settled
                normal, offset = faces.plane(np.concatenate(rings))
                fitted = count
        inside = np.concatenate(rings)
        normal, offset = faces.plane(inside)
        keep = self._fits(faces, inside, normal, offset, self.angle_deg)
        return inside[keep] if keep.any() else inside

    def _fits(self, faces: _Faces, which: np.ndarray, normal: np.ndarray, offset: float, angle_deg: float) -> np.ndarray:
        straight = faces.normal[which] @ normal > np.cos(np.radians(angle_deg))
        return straight & (np.abs(faces.centre[which] @ normal - offset) < self.distance_m)

    def _merge(self, faces: _Faces, label: np.ndarray) -> np.ndarray:
        """Join touching planes that are one plane, until none are left."""
        while True:
            planes = [faces.plane(np.flatnonzero(label == k)) for k in range(label.max() + 1)]
            centres = [faces.mean(np.flatnonzero(label == k)) for k in range(len(planes))]
            joined = np.arange(len(planes))
            for i, j in _touching(faces, label):
                (n, d), (m, e) = planes[i], planes[j]
                close = max(abs(centres[j] @ n - d), abs(centres[i] @ m - e)) < self.distance_m
                if close and n @ m > np.cos(np.radians(self.merge_deg)) and joined[i] == i and joined[j] == j:
                    joined[j] = i
                    planes[i] = faces.plane(np.flatnonzero((label == i) | (label == j)))
            if (joined == np.arange(len(planes))).all():
                return label
            while (joined[joined] != joined).any():
                joined = joined[joined]
            _, packed = np.unique(joined, return_inverse=True)
            label = np.where(label >= 0, packed[np.maximum(label, 0)], -1)

    def _absorb(self, faces: _Faces, label: np.ndarray) -> None:
        """Let leftovers join the plane they touch and lie in, ring by ring, in place."""
        for k in range(label.max() + 1):
            frontier = np.flatnonzero(label == k)
            normal, offset = faces.plane(frontier)
            while frontier.size:
                near = faces.neighbours(frontier)
                near = near[label[near] < 0]
                fits = self._fits(faces, near, normal, offset, self.loose_deg)
                frontier = near[fits & (faces.reach(near, normal, offset) < self.distance_m)]
                label[frontier] = k

    def _settle(self, faces: _Faces, label: np.ndarray) -> None:
        """Give faces on the seam of two planes to the one their corners lie closer to, ring by ring, in place.

        Smoothed normals blur a crease over a face or two on either side of it.
        """
        planes = [faces.plane(np.flatnonzero(label == k)) for k in range(label.max() + 1)]
        for _ in range(2 * faces.rounds):
            coo = faces.adjacency.tocoo()
            here, there = label[coo.row], label[coo.col]
            seam = (here >= 0) & (there >= 0) & (here != there)
            face, other = coo.row[seam], there[seam]
            own, new = (np.full(len(face), np.inf) for _ in range(2))
            for k, (normal, offset) in enumerate(planes):
                for at, which in ((own, label[face] == k), (new, other == k)):
                    at[which] = faces.reach(face[which], normal, offset)
            label[face[new < own]] = other[new < own]

    def _parts(self, faces: _Faces, left: np.ndarray) -> list[Segment]:
        if left.size == 0:
            return []
        count, part = connected_components(faces.adjacency[left][:, left], directed=False)
        area = np.bincount(part, faces.area[left], count)
        large = np.flatnonzero(area >= self.min_part_m2)
        parts = [Segment(left[part == k], float(area[k])) for k in large[np.argsort(-area[large], kind="stable")]]
        fragments = left[area[part] < self.min_part_m2]
        if fragments.size:
            parts.append(Segment(fragments, float(faces.area[fragments].sum())))
        return parts


@dataclass(frozen=True, eq=False)
class _Faces:
    """Per-face arrays of a mesh: corners (F, 3, 3), centre and smoothed normal (F, 3), area and coherence (F,), adjacency."""

    corners: np.ndarray
    centre: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    coherence: np.ndarray
    adjacency: sp.csr_matrix
    rounds: int

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, smoothing_m: float) -> _Faces:
        count = len(mesh.faces)
        i, j = np.asarray(mesh.face_adjacency).reshape(-1, 2).T
        ones = np.ones(2 * len(i), dtype=np.float64)
        adjacency = sp.csr_matrix((ones, (np.r_[i, j], np.r_[j, i])), shape=(count, count))
        area = np.asarray(mesh.area_faces)
        own = area[:, None] * mesh.face_normals
        small = area < smoothing_m**2 / 2
        # Averaging is a random walk over faces: n rounds reach about sqrt(n) edges. 20 bounds the time on fine meshes.
        edge = np.sqrt(2 * np.median(area[small])) if small.any() else np.inf
        rounds = int(np.clip(np.ceil((smoothing_m / edge) ** 2), 0, 20)) if small.any() else 0
        weighted, total = own, area
        for _ in range(rounds):
            weighted = np.where(small[:, None], weighted + adjacency @ weighted, own)
            total = np.where(small, total + adjacency @ total, area)
        length = np.linalg.norm(weighted, axis=1)
        normal = weighted / np.maximum(length, 1e-300)[:, None]
        coherence = length / np.maximum(total, 1e-300)
        corners = np.asarray(mesh.triangles)
        return cls(corners, corners.mean(axis=1), normal, area, coherence, adjacency, rounds)

    def neighbours(self, which: np.ndarray) -> np.ndarray:
        """Faces that share an edge with any of `which`, each once."""
        start, stop = self.adjacency.indptr[which], self.adjacency.indptr[which + 1]
        counts = stop - start
        index = np.repeat(start - np.r_[0, np.cumsum(counts)[:-1]], counts) + np.arange(counts.sum())
        return np.unique(self.adjacency.indices[index])

    def reach(self, which: np.ndarray, normal: np.ndarray, offset: float) -> np.ndarray:
        """Distance of the farthest corner of each face from a plane."""
        return np.abs(self.corners[which] @ normal - offset).max(axis=1, initial=0.0)

    def mean(self, which: np.ndarray) -> np.ndarray:
        return np.average(self.centre[which], axis=0, weights=self.area[which])

    def plane(self, which: np.ndarray) -> tuple[np.ndarray, float]:
        """Area-weighted least-squares plane (normal, offset), the normal on the side the faces show.

        A handful of faces fits noise better than the plane, so below 12 the mean normal is taken.
        """
        weight = self.area[which] / self.area[which].sum()
        centre = weight @ self.centre[which]
        shown = weight @ self.normal[which]
        normal = shown / np.linalg.norm(shown)
        if len(which) >= 12:
            spread = self.centre[which] - centre
            fitted = np.linalg.eigh((weight[:, None] * spread).T @ spread)[1][:, 0]
            normal = fitted if fitted @ shown > 0 else -fitted
        return normal, float(normal @ centre)


def _plane_segment(faces: _Faces, which: np.ndarray) -> Segment:
    normal, offset = faces.plane(which)
    return Segment(which, float(faces.area[which].sum()), normal, offset)


def _touching(faces: _Faces, label: np.ndarray) -> Iterator[tuple[int, int]]:
    """Pairs of planes that share an edge, in order."""
    coo = faces.adjacency.tocoo()
    a, b = label[coo.row], label[coo.col]
    pairs = np.stack([a, b], axis=1)[(a >= 0) & (a < b)]
    return ((int(i), int(j)) for i, j in np.unique(pairs, axis=0))
