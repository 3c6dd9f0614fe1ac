"""Check a mesh before simulation (finite, not empty, plausible size), and test whether a point is inside a solid."""

from __future__ import annotations

import numpy as np
import trimesh

from radartwin.errors import MeshError

MAX_EXTENT_M = 100.0  # a larger mesh has a wrong length unit; for comparison, the maximum unambiguous range of the default radar is 11 m


def check_mesh(mesh: trimesh.Trimesh, where: str) -> None:
    """Raise an error for a mesh that cannot be simulated."""
    if not isinstance(mesh, trimesh.Trimesh):
        raise MeshError(f"{where}: expected a trimesh.Trimesh, got {type(mesh).__name__}")
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if len(vertices) == 0 or len(faces) == 0:
        raise MeshError(f"{where}: the mesh is empty ({len(vertices)} vertices, {len(faces)} faces); export it again")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(f"{where}: a face refers to vertex {int(faces.max())} of a mesh with {len(vertices)} vertices; export it again")
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise MeshError(f"{where}: {int(bad.sum())} of {len(vertices)} vertices are NaN or infinite; repair or export it again")
    extent = float(np.ptp(vertices[faces.reshape(-1)], axis=0).max())
    if extent > MAX_EXTENT_M:
        raise MeshError(f"{where} spans {extent:.4g} m, over the limit of {MAX_EXTENT_M:.0f} m; {unit_hint(extent)}")
    if extent == 0:
        raise MeshError(f"{where}: all vertices coincide; the mesh is degenerate, export it again")


def unit_hint(extent: float) -> str:
    """Return the part of an error message that suggests a length unit in which the extent of a too large mesh would be plausible."""
    if extent / 1000 <= MAX_EXTENT_M and extent / 1000 >= 0.5:
        return "if it is in millimetres, scale it by 0.001 to metres (radartwin reconstruct --unit mm)"
    if extent / 100 <= MAX_EXTENT_M:
        return "if it is in centimetres, scale it by 0.01 to metres (radartwin reconstruct --unit cm)"
    return "convert the coordinates to metres"


def welded(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a copy of a mesh without duplicate vertices, which would leave the mesh open at sharp edges and texture seams."""
    out = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    out.merge_vertices(merge_tex=True, merge_norm=True)
    return out


def inside_solid(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Test whether each point lies inside a watertight mesh of positive volume.

    The test computes the generalised winding number from the solid angles of the triangles (van Oosterom and Strackee 1983). Unlike ray
    casting, the winding number needs no special treatment of edges.

    Args:
        points: (N, 3) positions in metres, in the frame of the mesh.
    Returns:
        (N,) boolean mask of the points inside; all False for an open mesh and for a mesh whose normals point inwards.

    >>> box = trimesh.creation.box((2, 2, 2))
    >>> inside_solid(box, np.array([[0, 0, 0], [0, 0, 1.5]])).tolist()
    [True, False]
    """
    from radartwin.scene.pairs import winding_number  # compiled, so imported only where needed

    points = np.asarray(points, dtype=np.float64)
    inside = np.zeros(len(points), dtype=bool)
    low, high = mesh.bounds
    near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
    if near.size == 0:
        return inside
    solid = welded(mesh)
    if solid.is_watertight and solid.volume > 0:
        triangles = np.ascontiguousarray(solid.triangles, dtype=np.float64)
        inside[near] = winding_number(triangles, np.ascontiguousarray(points[near])) > 0.5
    return inside
