"""Triangles for the tracer: vertex normals, smooth patches, surface indices and the Mitsuba scene.

Edges between faces whose normals differ by less than 30 degrees are smooth, so that a tessellated can is traced as a curved surface. Other
edges stay sharp even if the faces share vertices.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

SMOOTH_EDGE_RAD = np.radians(30.0)


@dataclass
class Geometry:
    """Hold the merged triangles of several surfaces."""

    corners: np.ndarray  # (F, 3, 3) float64, corners of each face, metres
    normals: np.ndarray  # (F, 3, 3) float64, unit vertex normals at the corners
    surface: np.ndarray  # (F,) int, index of the surface of each face
    # (F,) int, index of the smooth patch of each face; by default every face is its own patch
    patch: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    # (F,) mean width 2 V/A in metres of the face's mesh (volume V, area A) if the mesh is closed and faces outwards; zero for other meshes,
    # for rooms and by default
    hollow_m: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if len(self.patch) != len(self.corners):
            self.patch = np.arange(len(self.corners))
        if len(self.hollow_m) != len(self.corners):
            self.hollow_m = np.zeros(len(self.corners))

    @property
    def extent_m(self) -> float:
        """Return the largest absolute coordinate in metres, which determines the float32 resolution of a hit."""
        return float(np.abs(self.corners).max(initial=1e-3))

    @functools.cached_property
    def curved(self) -> bool:
        """Return whether any facet has different vertex normals."""
        return bool(np.ptp(self.normals, axis=1).max(initial=0.0) > 1e-6)

    @functools.cached_property
    def convex(self) -> bool:
        """Return whether the geometry is one closed convex body."""
        if not len(self.corners) or not (self.hollow_m > 0).all() or np.ptp(self.surface):
            return False
        points = self.corners - self.centre
        return bool(ConvexHull(np.unique(points.reshape(-1, 3), axis=0)).volume <= _signed_volume(points) * (1 + 1e-6))

    @property
    def grid_shift(self) -> tuple[float, float]:
        """Return the offset of a tube grid in cells: 0 for flat targets, so that edges fall between tubes, and 0.25 for curved targets.

        On a curved target the error is periodic in the offset, and its first harmonic is proportional to cos(2 pi offset), which is 0 at
        0.25. At one tube per square wavelength, the echo of spheres of 1.5 to 10 cm has these largest errors: 0.22 dB with offset 0.25,
        0.35 dB with offset 0 and 0.43 dB with offset 0.5.
        """
        return (0.25, 0.25) if self.curved else (0.0, 0.0)

    @property
    def centre(self) -> np.ndarray:
        """Return the centre (3,) of the bounding box."""
        points = self.corners.reshape(-1, 3)
        return (points.min(0) + points.max(0)) / 2

    def hull_points(self) -> np.ndarray:
        """Return points (V, 3) whose bounding box in any view contains the whole geometry."""
        return self._hull

    @functools.cached_property
    def _hull(self) -> np.ndarray:
        points = np.unique(self.corners.reshape(-1, 3), axis=0)
        if len(points) <= 64:
            return points
        try:
            return points[ConvexHull(points).vertices]
        except QhullError:  # a flat geometry has no convex hull with a volume
            return points[:: len(points) // 4000] if len(points) > 40_000 else points

    def scene(self) -> Any:
        """Return the Mitsuba scene of these triangles, built on first use."""
        return self._scene

    @functools.cached_property
    def _scene(self) -> Any:
        import mitsuba as mi

        count = len(self.corners)
        mesh = mi.Mesh("geometry", 3 * count, count)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = self.corners.astype(np.float32).ravel()
        parameters["faces"] = np.arange(3 * count, dtype=np.uint32)
        parameters.update()
        # without this option, rays slip through Embree meshes along shared edges of triangles; OptiX is watertight
        watertight = {} if "cuda" in (mi.variant() or "") else {"embree_use_robust_intersections": True}
        return mi.load_dict({"type": "scene", **watertight, "geometry": mesh})


def _signed_volume(corners: np.ndarray) -> float:
    """Return the volume in cubic metres of a closed surface of triangles (F, 3, 3), negative if the triangles face inwards."""
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def _smooth_normals(mesh: trimesh.Trimesh) -> np.ndarray:
    """Return corner normals (F, 3, 3), averaged over smooth edges. The weights are corner angles, so that slivers have little weight."""
    faces = np.asarray(mesh.faces)
    face_normals = np.asarray(mesh.face_normals)
    count = len(faces)
    pairs = np.asarray(mesh.face_adjacency)
    group = np.arange(3 * count)
    if len(pairs):
        smooth = np.asarray(mesh.face_adjacency_angles) < SMOOTH_EDGE_RAD
        pairs, edges = pairs[smooth], np.asarray(mesh.face_adjacency_edges)[smooth]
        links = []
        for end in range(2):
            # the corner of each of the two faces at this end of the shared edge
            corner = [3 * pairs[:, side] + np.argmax(faces[pairs[:, side]] == edges[:, end : end + 1], axis=1) for side in range(2)]
            links.append(np.stack(corner, axis=1))
        group = _groups(np.concatenate(links), 3 * count)
    weight = np.asarray(mesh.face_angles).reshape(-1)
    corner_normals = np.repeat(face_normals, 3, axis=0) * weight[:, None]
    total = np.stack([np.bincount(group, corner_normals[:, axis]) for axis in range(3)], axis=1)[group]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    fallback = np.repeat(face_normals, 3, axis=0)
    return np.where(length > 1e-9, total / np.maximum(length, 1e-30), fallback).reshape(count, 3, 3)


def _patches(mesh: trimesh.Trimesh) -> np.ndarray:
    """Return the index (F,) of the smooth patch of each face."""
    pairs, count = np.asarray(mesh.face_adjacency), len(mesh.faces)
    if not len(pairs):
        return np.arange(count)
    return _groups(pairs[np.asarray(mesh.face_adjacency_angles) < SMOOTH_EDGE_RAD], count)


def _groups(links: np.ndarray, count: int) -> np.ndarray:
    """Return the group number (count,) of each of `count` nodes; links (L, 2) connect nodes of one group."""
    graph = coo_matrix((np.ones(len(links), np.int8), (links[:, 0], links[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def subset(geometry: Geometry, keep: np.ndarray) -> Geometry:
    """Return the faces selected by a mask (F,)."""
    return Geometry(geometry.corners[keep], geometry.normals[keep], geometry.surface[keep], hollow_m=geometry.hollow_m[keep])


def _hollow_m(mesh: trimesh.Trimesh) -> float:
    """Return the mean width in metres of a closed mesh that faces outwards, and zero for other meshes."""
    if not mesh.is_watertight:
        return 0.0
    return max(0.0, 2 * _signed_volume(np.asarray(mesh.triangles, float)) / float(mesh.area))


def build(meshes: Sequence[trimesh.Trimesh]) -> Geometry:
    """Merge surfaces into one geometry without changing the meshes.

    Faces without area and duplicate faces of a mesh are dropped; vertices closer than 0.1 um are merged. Open meshes reflect on both sides.
    The tracer uses float32 coordinates, with a resolution of 8 um at 100 m from the origin.

    Args:
        meshes: one mesh per surface, all in one frame, in metres.
    """
    corners, normals, surface, patch, hollow = [], [], [], [], []
    for index, mesh in enumerate(meshes):
        clean = trimesh.Trimesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), process=False)
        clean.merge_vertices(digits_vertex=7)
        clean.update_faces(clean.unique_faces() & (clean.area_faces > 1e-14))
        if not clean.is_winding_consistent:
            trimesh.repair.fix_winding(clean)  # the normals of neighbours with opposite winding would cancel in the average
        if not len(clean.faces):
            continue
        corners.append(np.asarray(clean.triangles, float))
        normals.append(_smooth_normals(clean))
        patch.append(_patches(clean) + sum(len(one) for one in patch))
        surface.append(np.full(len(clean.faces), index))
        hollow.append(np.full(len(clean.faces), _hollow_m(clean)))
    if not corners:
        return Geometry(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros(0, int))
    return Geometry(
        np.concatenate(corners), np.concatenate(normals), np.concatenate(surface), np.concatenate(patch), np.concatenate(hollow)
    )
