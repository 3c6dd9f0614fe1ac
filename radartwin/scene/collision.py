"""Compute the overlap of two meshes, the crossings of a sensor path with surfaces, and the height of a mesh below a point.

All tests first select candidate triangles by their bounding boxes, and then intersect edges with these triangles. Meshes may be open, but
only a watertight mesh of positive volume has an inside.
"""

from __future__ import annotations

import numpy as np
import trimesh

from radartwin.errors import PoseError
from radartwin.scene.mesh_checks import inside_solid, welded
from radartwin.scene.scene import Scene

CONTACT_M = 0.002  # shallower overlaps are ignored, because rounding and the flattening of scanned surfaces cause them
_BLOCK_PAIRS = 2_000_000  # point-triangle pairs per block
_MAX_SAMPLES = 500  # largest number of vertices that are tested for being inside a solid


def overlap_m(a: trimesh.Trimesh, b: trimesh.Trimesh) -> float:
    """Compute the depth of the overlap of two meshes in metres; 0 if the meshes are apart or overlap by less than CONTACT_M.

    The depth is the shortest side of the axis-parallel box around the common volume. For an open surface, such as a wall, the common part
    is flat. The depth is then the smaller of two lengths: the second-shortest side of this box, and the distance by which the other mesh
    extends beyond the mean plane of the open surface.
    """
    low, high = np.maximum(a.bounds[0], b.bounds[0]), np.minimum(a.bounds[1], b.bounds[1])
    if (high - low < 0).any():
        return 0.0
    near_a, near_b = _triangles_in_box(a, low, high), _triangles_in_box(b, low, high)
    inside = [_vertices_inside(a, b, low, high), _vertices_inside(b, a, low, high)]
    points = np.vstack([*inside, _edge_crossings(near_a, near_b), _edge_crossings(near_b, near_a)])
    if not len(points):
        return 0.0
    sides = np.sort(np.ptp(points, axis=0))
    if sides[0] > CONTACT_M:
        return float(sides[0])
    if sides[1] <= CONTACT_M or (welded(a).is_watertight and welded(b).is_watertight):
        return 0.0
    reaches = [reach for mesh, triangles in ((a, near_b), (b, near_a)) if (reach := _reach(mesh, triangles, points)) > 0]
    depth = min([float(sides[1]), *reaches])
    return depth if depth > CONTACT_M else 0.0


def first_crossing(starts: np.ndarray, ends: np.ndarray, mesh: trimesh.Trimesh) -> int | None:
    """Return the index of the first line segment that passes through the mesh, or None if no segment does.

    The S segments lead from `starts` (S, 3) to `ends` (S, 3), in metres.
    """
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    near = np.flatnonzero(((high >= mesh.bounds[0]) & (low <= mesh.bounds[1])).all(axis=1))
    if not near.size:
        return None
    triangles = _triangles_in_box(mesh, low[near].min(axis=0), high[near].max(axis=0))
    segment, _ = _crossings(starts[near], ends[near], triangles)
    return int(near[segment[0]]) if segment.size else None


def check_path(scene: Scene, poses: np.ndarray) -> None:
    """Raise an error for a sensor path that passes through a surface or lies inside a solid.

    Args:
        poses: (F, 4, 4) sensor-to-world poses of F frames, or (F, 3) positions in metres.
    """
    poses = np.asarray(poses, dtype=np.float64)
    positions = poses[:, :3, 3] if poses.ndim == 3 else poses
    scene.check_sensor(positions)
    hits = [(hit, s) for s in scene if (hit := first_crossing(positions[:-1], positions[1:], s.mesh)) is not None]
    if hits:
        frame, surface = min(hits, key=lambda hit: hit[0])
        at = ", ".join(f"{x:.2f}" for x in positions[frame])
        raise PoseError(
            f"the sensor passes through surface '{surface.name}' between frames {frame} and {frame + 1}, "
            f"near ({at}) m; shift or shorten the trajectory, or take the surface out of the scene"
        )


def top_below(mesh: trimesh.Trimesh, points: np.ndarray, limit_m: float | np.ndarray = np.inf) -> np.ndarray:
    """Return the height of the mesh below each point: where a line that goes down from the height `limit_m` first meets the mesh.

    Args:
        points: (P, 2) x and y coordinates in metres.
        limit_m: height in metres from which the vertical line starts, scalar or (P,).
    Returns:
        (P,) heights in metres; -inf for a point whose vertical line does not meet the mesh.
    """
    out = np.full(len(points), -np.inf)
    if not len(points):
        return out
    low, high = points.min(axis=0), points.max(axis=0)
    triangles = _triangles_in_box(mesh, np.array([*low, -np.inf]), np.array([*high, np.inf]))
    edge1, edge2 = triangles[:, 1, :2] - triangles[:, 0, :2], triangles[:, 2, :2] - triangles[:, 0, :2]
    twice = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    flat = np.abs(twice) > 1e-12
    triangles, edge1, edge2, twice = triangles[flat], edge1[flat], edge2[flat], twice[flat]
    step = max(1, _BLOCK_PAIRS // max(1, len(triangles)))
    limits = np.broadcast_to(limit_m, len(points))
    for start in range(0, len(points), step):
        block = slice(start, start + step)
        to = points[block, None] - triangles[None, :, 0, :2]
        u = (to[..., 0] * edge2[:, 1] - to[..., 1] * edge2[:, 0]) / twice
        v = (edge1[:, 0] * to[..., 1] - edge1[:, 1] * to[..., 0]) / twice
        within = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
        z = triangles[:, 0, 2] + u * (triangles[:, 1, 2] - triangles[:, 0, 2]) + v * (triangles[:, 2, 2] - triangles[:, 0, 2])
        z = np.where(within & (z <= limits[block, None]), z, -np.inf)
        out[block] = z.max(axis=1, initial=-np.inf)
    return out


def _triangles_in_box(mesh: trimesh.Trimesh, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the triangles (T, 3, 3) of a mesh whose bounding boxes overlap the box from `low` to `high`."""
    triangles = np.asarray(mesh.triangles, dtype=np.float64)
    return triangles[((triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)).all(axis=1)]


def _vertices_inside(a: trimesh.Trimesh, b: trimesh.Trimesh, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the vertices (N, 3) of mesh `a` inside the solid `b`. Of a fine mesh, only a sample of the vertices is tested."""
    vertices = np.asarray(a.vertices, dtype=np.float64)
    vertices = vertices[((vertices >= low) & (vertices <= high)).all(axis=1)]
    vertices = vertices[:: max(1, len(vertices) // _MAX_SAMPLES)]
    return vertices[inside_solid(b, vertices)] if len(vertices) else vertices


def _edge_crossings(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the points (N, 3) where edges of triangles `a` pass through triangles `b`."""
    if not len(a) or not len(b):
        return np.zeros((0, 3))
    edges = np.concatenate([a[:, [0, 1]], a[:, [1, 2]], a[:, [2, 0]]])
    # Two triangles share an edge in opposite directions. One copy is dropped if no coordinate increases along the edge while another
    # decreases. Otherwise both copies stay.
    once = (edges[:, 0] <= edges[:, 1]).all(axis=1) | ~(edges[:, 0] >= edges[:, 1]).all(axis=1)
    edges = edges[once]
    segment, share = _crossings(edges[:, 0], edges[:, 1], b)
    return edges[segment, 0] + share[:, None] * (edges[segment, 1] - edges[segment, 0])


def _crossings(starts: np.ndarray, ends: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ascending segment indices (N,) of crossings of segments with triangles, and their places (N,): 0 at start, 1 at end."""
    from radartwin.scene.pairs import crossing  # compiled, so imported only where needed

    capacity = 4096
    while True:
        segment, share = np.zeros(capacity, dtype=np.int64), np.zeros(capacity)
        count = crossing(np.ascontiguousarray(starts), np.ascontiguousarray(ends), np.ascontiguousarray(triangles), segment, share)
        if count <= capacity:
            return segment[:count], share[:count]
        capacity = count


def _reach(mesh: trimesh.Trimesh, triangles: np.ndarray, points: np.ndarray) -> float:
    """Return how far `mesh` extends beyond the mean plane of `triangles` near the crossing points, on the side where it extends less."""
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal = areas.sum(axis=0)
    if not np.linalg.norm(normal) > 0.5 * np.linalg.norm(areas, axis=1).sum():
        return 0.0  # the triangles are too curved for a mean plane
    along = (np.asarray(mesh.vertices) - points.mean(axis=0)) @ (normal / np.linalg.norm(normal))
    return float(max(0.0, min(along.max(), -along.min())))
