"""Planar segments projected onto their planes.

Depth noise of a scan is millimetres to centimetres, one to several wavelengths at 77 GHz. Left in, a painted wall
scatters like rubble: its specular return is gone and a diffuse one that does not exist takes its place. Over thousands
of faces the noise of the fitted plane averages down to a fraction of a millimetre, so the plane is what is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from radartwin.reconstruct.segment import Segment

MAX_MOVE_M = 0.1  # a vertex shared by nearly parallel planes would run away along them; it is moved once, onto one
PARALLEL = 0.3  # smallest over largest singular value of planes that still define a line: about 35 degrees apart


def flattened(mesh: trimesh.Trimesh, segments: Sequence[Segment]) -> np.ndarray:
    """Vertices (V, 3) moved by the least distance that puts each on all the planes whose faces use it.

    Vertices on a wall and the floor end on their intersection line, so surfaces stay joined; vertices of no plane stay.
    Between nearly parallel planes they end in the middle, and `onto_plane` settles it per segment.
    """
    planes = [s for s in segments if s.normal is not None]
    vertices = np.array(mesh.vertices, dtype=np.float64)
    if not planes:
        return vertices
    normals = np.array([s.normal for s in planes])
    offsets = np.array([s.offset_m for s in planes])
    faces = np.asarray(mesh.faces)
    vertex = [np.unique(faces[s.faces]) for s in planes]
    plane = np.repeat(np.arange(len(planes)), [len(v) for v in vertex])
    order = np.argsort(np.concatenate(vertex), kind="stable")
    used, start = np.unique(np.concatenate(vertex)[order], return_index=True)
    groups: dict[tuple[int, ...], list[int]] = {}
    for index, members in zip(used, np.split(plane[order], start[1:]), strict=True):
        groups.setdefault(tuple(members.tolist()), []).append(int(index))
    for members, indices in groups.items():
        n, d = normals[list(members)], offsets[list(members)]
        x = vertices[indices]
        move = -(x @ n.T - d) @ np.linalg.pinv(n, rcond=PARALLEL).T
        far = np.linalg.norm(move, axis=1) > MAX_MOVE_M
        move[far] = -(x[far] @ n[0] - d[0])[:, None] * n[0]
        vertices[indices] = x + move
    return vertices


def onto_plane(vertices: np.ndarray, segment: Segment) -> np.ndarray:
    """Vertices (V, 3) projected onto the segment's plane; unchanged for a part that has none."""
    if segment.normal is None:
        return vertices
    return vertices - (vertices @ segment.normal - segment.offset_m)[:, None] * segment.normal
