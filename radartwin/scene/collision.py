"""What is in the way: meshes that overlap, paths that pass through surfaces, and what lies below a point.

Bounding boxes first, then pairs of edges and triangles; nothing has to be watertight, but only a watertight mesh of positive volume
has an inside.
"""

from __future__ import annotations

import numpy as np
import trimesh

from radartwin.errors import PoseError
from radartwin.scene.checks import inside_solid
from radartwin.scene.scene import Scene

CONTACT_M = 0.002  # shallower overlaps are contact: the gaps of floating-point meshes and flattened scans
_PAIRS = 2_000_000  # points times triangles in one block
_INSIDE = 500  # vertices that are asked whether they are inside a solid


def overlap_m(a: trimesh.Trimesh, b: trimesh.Trimesh) -> float:
    """How deep two meshes reach into each other: 0 if they are apart or touch by less than CONTACT_M.

    It is the narrowest side of the box around what both occupy. What a solid and an open surface, such as a wall, have in common is
    flat: then it is the next side of that box, or, if that is less, how far the one reaches beyond the other's mean plane.
    """
    low, high = np.maximum(a.bounds[0], b.bounds[0]), np.minimum(a.bounds[1], b.bounds[1])
    if (high - low < 0).any():
        return 0.0
    near_a, near_b = _near(a, low, high), _near(b, low, high)
    inside = [_inside(a, b, low, high), _inside(b, a, low, high)]
    points = np.vstack([*inside, _cuts(near_a, near_b), _cuts(near_b, near_a)])
    if not len(points):
        return 0.0
    sides = np.sort(np.ptp(points, axis=0))
    if sides[0] > CONTACT_M:
        return float(sides[0])
    if sides[1] <= CONTACT_M or (_closed(a) and _closed(b)):
        return 0.0
    reaches = [reach for one, other in ((a, near_b), (b, near_a)) if (reach := _reach(one, other, points)) > 0]
    depth = min([float(sides[1]), *reaches])
    return depth if depth > CONTACT_M else 0.0


def first_crossing(starts: np.ndarray, ends: np.ndarray, mesh: trimesh.Trimesh) -> int | None:
    """The first of segments (S, 3) to (S, 3) that passes through the mesh, or None."""
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    near = np.flatnonzero(((high >= mesh.bounds[0]) & (low <= mesh.bounds[1])).all(axis=1))
    if not near.size:
        return None
    triangles = _near(mesh, low[near].min(axis=0), high[near].max(axis=0))
    segment, _ = _crossings(starts[near], ends[near], triangles)
    return int(near[segment[0]]) if segment.size else None


def check_path(scene: Scene, poses: np.ndarray) -> None:
    """Refuse a sensor that passes through a surface between frames, or is inside a solid.

    Args:
        poses: (F, 4, 4) sensor-to-world, or (F, 3) positions.
    Raises:
        PoseError: naming frame and surface of the first crossing; SceneError: naming those of a sensor inside a solid.
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
    """The highest point of a mesh straight below (or above) each of points (P, 2), at most at `limit_m`: (P,) metres, -inf for none."""
    out = np.full(len(points), -np.inf)
    if not len(points):
        return out
    low, high = points.min(axis=0), points.max(axis=0)
    triangles = _near(mesh, np.array([*low, -np.inf]), np.array([*high, np.inf]))
    edge1, edge2 = triangles[:, 1, :2] - triangles[:, 0, :2], triangles[:, 2, :2] - triangles[:, 0, :2]
    twice = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    flat = np.abs(twice) > 1e-12
    triangles, edge1, edge2, twice = triangles[flat], edge1[flat], edge2[flat], twice[flat]
    step = max(1, _PAIRS // max(1, len(triangles)))
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


def _near(mesh: trimesh.Trimesh, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The triangles (T, 3, 3) whose boxes meet a box."""
    triangles = np.asarray(mesh.triangles, dtype=np.float64)
    return triangles[((triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)).all(axis=1)]


def _inside(a: trimesh.Trimesh, b: trimesh.Trimesh, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Vertices of `a` inside the solid `b`, (N, 3); of fine meshes some, since the cuts already bound what both occupy."""
    vertices = np.asarray(a.vertices, dtype=np.float64)
    vertices = vertices[((vertices >= low) & (vertices <= high)).all(axis=1)]
    vertices = vertices[:: max(1, len(vertices) // _INSIDE)]
    return vertices[inside_solid(b, vertices)] if len(vertices) else vertices


def _cuts(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Where edges of triangles `a` pass through triangles `b`, (N, 3)."""
    if not len(a) or not len(b):
        return np.zeros((0, 3))
    edges = np.concatenate([a[:, [0, 1]], a[:, [1, 2]], a[:, [2, 0]]])
    kept = (edges[:, 0] <= edges[:, 1]).all(axis=1) | ~(edges[:, 0] >= edges[:, 1]).all(axis=1)  # most shared edges once
    edges = edges[kept]
    segment, share = _crossings(edges[:, 0], edges[:, 1], b)
    return edges[segment, 0] + share[:, None] * (edges[segment, 1] - edges[segment, 0])


def _crossings(starts: np.ndarray, ends: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Segments that pass through triangles: their indices, in order, and where along each."""
    from radartwin.scene.pairs import crossing

    room = 4096
    while True:
        segment, share = np.zeros(room, dtype=np.int64), np.zeros(room)
        count = crossing(np.ascontiguousarray(starts), np.ascontiguousarray(ends), np.ascontiguousarray(triangles), segment, share)
        if count <= room:
            return segment[:count], share[:count]
        room = count


def _reach(mesh: trimesh.Trimesh, triangles: np.ndarray, points: np.ndarray) -> float:
    """How far `mesh` reaches beyond the mean plane of `triangles` around the cut, on the side where it reaches less."""
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal = areas.sum(axis=0)
    if not np.linalg.norm(normal) > 0.5 * np.linalg.norm(areas, axis=1).sum():
        return 0.0  # curved around the cut: it has no plane
    along = (np.asarray(mesh.vertices) - points.mean(axis=0)) @ (normal / np.linalg.norm(normal))
    return float(max(0.0, min(along.max(), -along.min())))


def _closed(mesh: trimesh.Trimesh) -> bool:
    """Whether the mesh is watertight once vertices doubled for sharp normals or seams are one."""
    merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    merged.merge_vertices(merge_tex=True, merge_norm=True)
    return bool(merged.is_watertight)
