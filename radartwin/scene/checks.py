"""What a mesh must be to be simulated: finite, not empty, of plausible size; and whether a point is inside a solid."""

from __future__ import annotations

import numpy as np
import trimesh

from radartwin.errors import MeshError

MAX_EXTENT_M = 100.0  # beyond this a "room" is a unit mistake; the radar itself folds at 11 m


def check_mesh(mesh: trimesh.Trimesh, where: str) -> None:
    """Refuse what cannot be simulated.

    Args:
        where: how the message names the mesh.
    Raises:
        MeshError: not a triangle mesh, empty, indices out of range, NaN or infinite vertices, an extent over 100 m.
    """
    if not isinstance(mesh, trimesh.Trimesh):
        raise MeshError(f"{where}: expected a trimesh.Trimesh, got {type(mesh).__name__}")
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if len(vertices) == 0 or len(faces) == 0:
        raise MeshError(f"{where}: the mesh is empty ({len(vertices)} vertices, {len(faces)} faces)")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(f"{where}: a face names vertex {int(faces.max())} of a mesh with {len(vertices)} vertices")
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        raise MeshError(f"{where}: {int(bad.sum())} of {len(vertices)} vertices are NaN or infinite; repair or export it again")
    used = vertices[faces.reshape(-1)]
    extent = float(np.ptp(used, axis=0).max())
    if extent > MAX_EXTENT_M:
        raise MeshError(f"{where} spans {extent:.4g} m, over the limit of {MAX_EXTENT_M:.0f} m; {unit_hint(extent)}")
    if extent == 0:
        raise MeshError(f"{where}: all vertices coincide; the mesh is degenerate, export it again")


def unit_hint(extent: float) -> str:
    """The unit that would make an over-large extent plausible, as a question."""
    if extent / 1000 <= MAX_EXTENT_M and extent / 1000 >= 0.5:
        return "is it in millimetres? Scale it by 0.001 to metres (radartwin reconstruct --unit mm)"
    if extent / 100 <= MAX_EXTENT_M:
        return "is it in centimetres? Scale it by 0.01 to metres (radartwin reconstruct --unit cm)"
    return "units should be metres; is it in millimetres or micrometres?"


def inside_solid(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Which points lie inside a watertight mesh of positive volume.

    Uses the generalised winding number (van Oosterom and Strackee 1983, solid angle of a triangle), which needs no ray
    direction and so has no special cases on edges.

    Args:
        points: (N, 3).
    Returns:
        (N,) bool; all False for an open mesh, or one whose normals point inwards.

    >>> box = trimesh.creation.box((2, 2, 2))
    >>> inside_solid(box, np.array([[0, 0, 0], [0, 0, 1.5]])).tolist()
    [True, False]
    """
    points = np.asarray(points, dtype=np.float64)
    inside = np.zeros(len(points), dtype=bool)
    low, high = mesh.bounds
    near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
    if near.size == 0:
        return inside
    # Vertices doubled for sharp normals or texture seams must not open the solid.
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    solid.merge_vertices(merge_tex=True, merge_norm=True)
    if not solid.is_watertight or solid.volume <= 0:
        return inside
    inside[near] = winding_number(np.asarray(solid.triangles), points[near]) > 0.5
    return inside


def winding_number(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How often triangles (T, 3, 3) wrap around points (N, 3): (N,), 1 inside an outward solid, 0 outside."""
    from radartwin.scene.pairs import winding

    return winding(np.ascontiguousarray(triangles, dtype=np.float64), np.ascontiguousarray(points, dtype=np.float64))
