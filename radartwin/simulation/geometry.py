"""Prepare triangles for the ray tracer: vertex normals, smooth surface patches, surface indices and the Mitsuba scene.

An edge between two faces whose normals differ by less than 30 degrees counts as smooth, so that the tracer treats a can made of triangles
as a curved surface. All other edges stay sharp, even if the faces share vertices.

`build` and `subset` return the same geometry for the same content, so that its hull, convexity and Mitsuba scene are computed once. The
process keeps the most recently used geometries of up to CACHED_FACES faces together, which take about 0.5 kB per face.
"""

import atexit
import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError
from trimesh.graph import connected_component_labels

from radartwin.store.digest import array_digest, spec_digest
from radartwin.store.recent import Recent

SMOOTH_EDGE_RAD = np.radians(30.0)
CACHED_FACES = 200_000  # largest number of faces of all cached geometries together
MIN_AREA_M2 = 1e-14  # the simulation ignores faces with a smaller area, in square metres
SUBSETS = 4  # largest number of faces of all cached subsets of a geometry, as a multiple of its own number of faces


@dataclass(eq=False)
class Geometry:
    """Hold the F triangular faces of one or more surfaces. Do not write to the arrays, because several callers share a geometry."""

    corners: np.ndarray  # (F, 3, 3) float64 positions of the three corners of each face, in metres
    normals: np.ndarray  # (F, 3, 3) float64 unit normals at the three corners of each face
    surface: np.ndarray  # (F,) int index of the scene surface to which each face belongs
    # (F,) int index of the smooth surface patch to which each face belongs. By default, every face is its own patch.
    patch: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    # (F,) mean width in metres of the mesh to which each face belongs. The mean width is 2 V/A for a mesh of volume V and area A that is
    # closed and faces outwards. It is zero for other meshes, for rooms and by default.
    hollow_m: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if len(self.patch) != len(self.corners):
            self.patch = np.arange(len(self.corners))
        if len(self.hollow_m) != len(self.corners):
            self.hollow_m = np.zeros(len(self.corners))
        self.subsets: Recent[Geometry] = Recent(SUBSETS * len(self.corners))

    @functools.cached_property
    def extent_m(self) -> float:
        """Return the largest absolute coordinate in metres, which determines the float32 resolution of a hit."""
        return float(np.abs(self.corners).max(initial=1e-3))

    @property
    def lift_m(self) -> float:
        """Return a height in metres above a surface at which float32 rays can start without hitting this surface."""
        return max(2e-6 * self.extent_m, 1e-7)

    @functools.cached_property
    def curved(self) -> bool:
        """Return whether any facet belongs to a curved surface, that is, whether its three vertex normals differ."""
        return bool(np.ptp(self.normals, axis=1).max(initial=0.0) > 1e-6)

    @functools.cached_property
    def convex(self) -> bool:
        """Return whether the geometry consists of a single closed convex body."""
        if not len(self.corners) or not (self.hollow_m > 0).all() or np.ptp(self.surface):
            return False
        return bool(ConvexHull(self.points[0] - self.centre).volume <= _signed_volume(self.corners - self.centre) * (1 + 1e-6))

    @functools.cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the different corners (V, 3), and the indices (F, 3) of the corners of each face among them."""
        points, index = np.unique(self.corners.reshape(-1, 3), axis=0, return_inverse=True)
        return points, index.reshape(-1, 3)

    @functools.cached_property
    def digest(self) -> str:
        """Return the digest of the faces, for keys of stored paths."""
        return spec_digest([array_digest(array) for array in (self.corners, self.normals, self.surface, self.patch, self.hollow_m)])

    @property
    def grid_shift(self) -> tuple[float, float]:
        """Return the offset of the tube grid against the bounding box of the target along both grid axes, in grid cells.

        For flat targets the offset is 0, so that the edges of the target fall between tubes. For curved targets the offset is 0.25. The
        error of a curved target's echo is a periodic function of the offset. Its first harmonic is proportional to cos(2 pi offset), which
        is zero at an offset of 0.25. At one tube per square wavelength, the largest error of the echo of spheres of 1.5 to 10 cm
        is 0.22 dB with an offset of 0.25, 0.35 dB with an offset of 0 and 0.43 dB with an offset of 0.5.
        """
        return (0.25, 0.25) if self.curved else (0.0, 0.0)

    @functools.cached_property
    def centre(self) -> np.ndarray:
        """Return the centre (3,) of the geometry's bounding box, in metres."""
        points = self.corners.reshape(-1, 3)
        return (points.min(0) + points.max(0)) / 2

    @functools.cached_property
    def radius_m(self) -> float:
        """Return the radius in metres of the ball around the centre that contains the geometry."""
        return float(np.linalg.norm(self.corners.reshape(-1, 3) - self.centre, axis=1).max(initial=0.0))

    @functools.cached_property
    def area_vectors(self) -> np.ndarray:
        """Return vectors (F, 3) along the normals of the faces, as long as twice their areas in square metres."""
        return np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])

    def hull_points(self) -> np.ndarray:
        """Return V points (V, 3) of the geometry, whose bounding box contains the whole geometry from every viewing direction."""
        return self._hull

    @functools.cached_property
    def _hull(self) -> np.ndarray:
        points = self.points[0]
        if len(points) <= 64:
            return points
        try:
            return points[ConvexHull(points).vertices]
        except QhullError:  # a flat geometry has no convex hull with a volume
            return points if len(points) <= 40_000 else points[ConvexHull(points, qhull_options="QJ").vertices]

    @functools.cached_property
    def scene(self) -> Any:
        """Return the Mitsuba scene of the triangles."""
        import mitsuba as mi

        count = len(self.corners)
        mesh = mi.Mesh("geometry", 3 * count, count)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = self.corners.astype(np.float32).ravel()
        parameters["faces"] = np.arange(3 * count, dtype=np.uint32)
        parameters.update()
        # Without this option, rays slip through the shared edges of triangles in Embree on the CPU. OptiX on the GPU does not need it.
        watertight = {} if "cuda" in (mi.variant() or "") else {"embree_use_robust_intersections": True}
        return mi.load_dict({"type": "scene", **watertight, "geometry": mesh})


def _signed_volume(corners: np.ndarray) -> float:
    """Return the volume in cubic metres of a closed surface of triangles (F, 3, 3), negative if the triangles face inwards."""
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def _smooth(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Return unit normals (F, 3, 3) at the corners of the faces, and the index (F,) of the smooth surface patch of each face.

    A normal is the average over all faces that are connected by smooth edges at a vertex. Each face normal is weighted by the angle of its
    corner, so that thin triangles have little weight.
    """
    faces, face_normals = np.asarray(mesh.faces), np.repeat(np.asarray(mesh.face_normals), 3, axis=0)
    smooth = np.asarray(mesh.face_adjacency_angles) < SMOOTH_EDGE_RAD
    pairs, edges = np.asarray(mesh.face_adjacency)[smooth], np.asarray(mesh.face_adjacency_edges)[smooth]
    # For each of the two faces at a shared edge, find the corner that lies at each end of the edge.
    links = [
        [3 * face + np.argmax(faces[face] == edges[:, end : end + 1], axis=1) for face in pairs.T] for end in range(2)
    ]  # fmt: skip
    group = connected_component_labels(np.concatenate(links, axis=1).T, 3 * len(faces))
    weighted = face_normals * np.asarray(mesh.face_angles).reshape(-1, 1)
    total = np.stack([np.bincount(group, weighted[:, axis]) for axis in range(3)], axis=1)[group]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals = np.where(length > 1e-9, total / np.maximum(length, 1e-30), face_normals)
    return normals.reshape(-1, 3, 3), connected_component_labels(pairs, len(faces))


def subset(geometry: Geometry, keep: np.ndarray) -> Geometry:
    """Return a geometry with only those faces that the mask `keep` (F,) selects."""
    arrays = geometry.corners, geometry.normals, geometry.surface
    return geometry.subsets.get(
        keep.tobytes(), int(np.count_nonzero(keep)),
        lambda: Geometry(*(array[keep] for array in arrays), hollow_m=geometry.hollow_m[keep]),
    )  # fmt: skip


def _hollow_m(mesh: trimesh.Trimesh) -> float:
    """Return the mean width of a mesh in metres (2 volume/area) if the mesh is closed and faces outwards, and zero otherwise."""
    if not mesh.is_watertight:
        return 0.0
    return max(0.0, 2 * _signed_volume(np.asarray(mesh.triangles, float)) / float(mesh.area))


_cached: Recent[Geometry] = Recent(CACHED_FACES)
atexit.register(_cached.clear)  # Mitsuba scenes must be freed before Mitsuba is unloaded


def build(meshes: Sequence[trimesh.Trimesh]) -> Geometry:
    """Merge the meshes of several surfaces into one geometry. The function does not change the meshes.

    The function drops faces without area and duplicate faces, and merges vertices closer than 0.1 um. In the tracer, open meshes reflect on
    both sides. The tracer uses float32 coordinates, whose resolution is 8 um at 100 m from the origin.

    Args:
        meshes: one mesh per surface, all in the same coordinate frame, in metres.
    """
    contents = [(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)) for mesh in meshes]
    key = tuple(array.tobytes() for content in contents for array in content)
    return _cached.get(key, sum(len(faces) for _, faces in contents), lambda: _built(contents))


def _built(contents: Sequence[tuple[np.ndarray, np.ndarray]]) -> Geometry:
    """Return the geometry of `build` from the vertices (V, 3) and faces (F, 3) of each mesh."""
    corners, normals, surface, patch, hollow = [], [], [], [], []
    for index, (vertices, faces) in enumerate(contents):
        clean = trimesh.Trimesh(vertices, faces, process=False)
        clean.merge_vertices(digits_vertex=7)
        clean.update_faces(clean.unique_faces() & (clean.area_faces > MIN_AREA_M2))
        if not clean.is_winding_consistent:
            trimesh.repair.fix_winding(clean)  # normals of neighbouring faces with opposite winding would cancel in `_smooth`
        if not len(clean.faces):
            continue
        corners.append(np.asarray(clean.triangles, float))
        normal, patches = _smooth(clean)
        normals.append(normal)
        patch.append(patches + sum(len(ids) for ids in patch))
        surface.append(np.full(len(clean.faces), index))
        hollow.append(np.full(len(clean.faces), _hollow_m(clean)))
    if not corners:
        return Geometry(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros(0, int))
    return Geometry(
        np.concatenate(corners), np.concatenate(normals), np.concatenate(surface), np.concatenate(patch), np.concatenate(hollow)
    )
