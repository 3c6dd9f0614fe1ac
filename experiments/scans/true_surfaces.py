"""Prepare true surfaces for scoring segments: cut them into separate pieces, sample them evenly, and mark the samples that the sensor
saw.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import trimesh
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from radartwin.reconstruct.mesh_distance import covered, spread
from radartwin.scene.scene import Scene, Surface

SPACING_M = 0.04  # distance between samples, on the scan and on the true surfaces
REACH_M = 0.12  # a point belongs to no true surface if all of them are farther away
AGREEING = 0.7  # smallest cosine between agreeing normals, so that the underside of an object does not count as the floor below it
APART_M = 0.05  # a wider gap splits a true surface
FLUSH_M = 0.015  # a smaller step between surfaces is within a phone's depth noise (10 to 20 mm)
SHARP = np.radians(30.0)
CLEAR = ("glass", "mirror")  # MINC categories that depth sensors see through

# (points (N, 3), normals (N, 3), surfaces (N,)) of the scanned scene -> (N,) whether the sensor saw each point.
Sighted = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Truth:
    """True surfaces of a room, cut into K pieces and sampled at N points."""

    scene: Scene  # its K surfaces are the pieces of the true surfaces
    clear: np.ndarray  # (K,) whether a piece is glass or a mirror
    points: np.ndarray  # (N, 3) in metres, one per SPACING_M^2
    normals: np.ndarray  # (N, 3) unit normals of the points
    piece: np.ndarray  # (N,) index of the piece of each point
    seen: np.ndarray  # (N,) whether the sensor saw a point
    outlines: np.ndarray  # (E, 3) points in metres along the edges of the pieces

    @classmethod
    def of(cls, truth: Scene, sighted: Sighted | None = None) -> Truth:
        """Cut a true scene into pieces and sample the pieces. If `sighted` is None, all sampled points count as seen."""
        parts = [(piece, number) for number, surface in enumerate(truth) for piece in pieces(surface)]
        scene = Scene(piece for piece, _ in parts)
        points, normals, piece = samples(scene)
        whole = np.array([number for _, number in parts])
        seen = np.ones(len(points), bool) if sighted is None else sighted(points, normals, whole[piece])
        clear = np.array([s.provenance.get("minc") in CLEAR for s in scene])
        return cls(scene, clear, points, normals, piece, seen, np.concatenate([outline_points(s.mesh) for s in scene]))

    def owners(self) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """Return a function of points and normals (M, 3) that finds the index (M,) of the nearest piece (`nearest`), or -1."""
        close = [covered(np.asarray(s.mesh.triangles, dtype=float), SPACING_M) for s in self.scene]
        points, normals, unit = _joined(self.scene, close)
        tree = KDTree(points, balanced_tree=False)
        return lambda places, directions: nearest(tree, unit, normals, places, directions)

    def flush(self) -> np.ndarray:
        """Return for each piece (K,) the share of its seen samples that are within FLUSH_M of the plane of another, parallel piece."""
        tree = KDTree(self.points)
        here = np.flatnonzero(self.seen)
        _, near = tree.query(self.points[here], k=24, distance_upper_bound=3 * SPACING_M, workers=-1)
        there = near < len(self.points)
        index = np.where(there, near, 0)
        other = there & (self.piece[index] != self.piece[here][:, None])
        alike = np.einsum("nki,ni->nk", self.normals[index], self.normals[here]) > 0.95
        proud = np.abs(np.einsum("nki,ni->nk", self.points[index] - self.points[here][:, None], self.normals[here]))
        level = (other & alike & (proud < FLUSH_M)).any(axis=1)
        count = np.bincount(self.piece[here], minlength=len(self.scene))
        return np.bincount(self.piece[here], weights=level, minlength=len(self.scene)) / np.maximum(count, 1)


def samples(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample a scene with one point per SPACING_M^2. Returns points (N, 3) in metres, their unit normals, and surface indices (N,)."""
    return _joined(scene, [spread(s.mesh, SPACING_M) for s in scene])


def _joined(scene: Scene, parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Join the points (N, 3) and face indices (N,) of all surfaces to (points, normals, surface indices), as `samples` returns them."""
    points = [at for at, _ in parts]
    normals = [np.asarray(s.mesh.face_normals)[face] for s, (_, face) in zip(scene, parts, strict=True)]
    number = np.repeat(np.arange(len(parts)), np.array([len(at) for at in points], int))
    return np.concatenate([np.zeros((0, 3)), *points]), np.concatenate([np.zeros((0, 3)), *normals]), number


def nearest(
    tree: KDTree, owner: np.ndarray, owner_normals: np.ndarray, points: np.ndarray, normals: np.ndarray, strict: bool = False
) -> np.ndarray:
    """Return the `owner` (N,) of the nearest sample, first with an agreeing normal (`strict`: only so); -1 if none is within REACH_M."""
    ranks: Any = range(1, min(10, tree.n) + 1)
    distance, near = tree.query(points, k=ranks, distance_upper_bound=REACH_M, workers=-1)
    known = np.isfinite(distance)
    index = np.where(known, near, 0)
    agrees = np.einsum("nki,ni->nk", owner_normals[index], normals) > AGREEING
    rank = np.where(known & (agrees | (not strict)), distance + np.where(agrees, 0.0, 0.05), np.inf)
    best = rank.argmin(axis=1)
    rows = np.arange(len(points))
    return np.where(np.isfinite(rank[rows, best]), owner[index[rows, best]], -1)


def pieces(surface: Surface) -> list[Surface]:
    """Split a surface into the parts that are more than APART_M apart from each other. The largest part comes first."""
    mesh = surface.mesh.copy()
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=6)
    points, face = covered(np.asarray(mesh.triangles, dtype=float), APART_M / 2)
    pairs = KDTree(points).query_pairs(APART_M, output_type="ndarray")
    links = np.vstack([face[pairs], np.asarray(mesh.face_adjacency).reshape(-1, 2)])
    count, part = connected_components(sp.coo_matrix((np.ones(len(links)), links.T), shape=(len(mesh.faces),) * 2), directed=False)
    if count == 1:
        return [surface]
    area = np.bincount(part, mesh.area_faces, count)
    out = []
    for number, k in enumerate(np.argsort(-area, kind="stable"), 1):
        piece = trimesh.Trimesh(mesh.vertices, np.asarray(mesh.faces)[part == k], process=False)
        out.append(surface.replaced(mesh=piece, name=f"{surface.name}.{number}"))
    return out


def outline_points(mesh: trimesh.Trimesh) -> np.ndarray:
    """Return points (N, 3) along the open edges and the sharp edges of a mesh."""
    vertices, index = np.unique(np.round(np.asarray(mesh.vertices), 6), axis=0, return_inverse=True)
    welded = trimesh.Trimesh(vertices, index.reshape(-1)[np.asarray(mesh.faces)], process=False)
    pairs, count = np.unique(welded.edges_sorted, axis=0, return_counts=True)
    angles = np.asarray(welded.face_adjacency_angles)
    sharp = np.asarray(welded.face_adjacency_edges).reshape(-1, 2)[angles > SHARP]
    ends = vertices[np.vstack([pairs[count == 1], sharp])]
    steps = np.maximum(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / (SPACING_M / 2)).astype(int), 1)
    share = np.concatenate([(np.arange(n) + 0.5) / n for n in steps]) if len(steps) else np.zeros(0)
    start, stop = np.repeat(ends[:, 0], steps, axis=0), np.repeat(ends[:, 1], steps, axis=0)
    return start + share[:, None] * (stop - start)
