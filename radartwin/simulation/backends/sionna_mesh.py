"""Merge all surfaces of a scene into the single mesh that Sionna RT traces."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from radartwin.scene.scene import Surface

MIN_AREA_M2 = 1e-14  # faces with a smaller area, in square metres, are dropped


@dataclass(frozen=True)
class Mesh:
    """Hold all surfaces of a scene as one mesh with V vertices and T triangles."""

    vertices: np.ndarray  # (F, V, 3) vertex positions in the world at F frames, in metres, or (1, V, 3) if no surface moves
    faces: np.ndarray  # (T, 3) vertex indices of the triangles
    surface: np.ndarray  # (T,) index of the scene surface to which each triangle belongs
    poses: Mapping[int, np.ndarray]  # poses (F, 4, 4) of the moving surfaces in the world, by surface index


def merged(surfaces: tuple[Surface, ...], motion: Mapping[str, np.ndarray]) -> Mesh:
    """Merge all surfaces to one mesh, without faces smaller than MIN_AREA_M2."""
    moving = {i: motion[s.name] for i, s in enumerate(surfaces) if s.name in motion}
    frames = max((len(poses) for poses in moving.values()), default=1)
    vertices, faces, surface, count = [np.zeros((frames, 0, 3))], [np.zeros((0, 3), int)], [np.zeros(0, int)], 0
    for i, one in enumerate(surfaces):
        kept = np.asarray(one.mesh.faces)[one.mesh.area_faces > MIN_AREA_M2]
        points = np.asarray(one.mesh.vertices, float)
        turned = np.einsum("fij,vj->fvi", moving[i][:, :3, :3], points) + moving[i][:, None, :3, 3] if i in moving else points[None]
        vertices.append(np.broadcast_to(turned, (frames, len(points), 3)))
        faces.append(kept + count)
        surface.append(np.full(len(kept), i))
        count += len(points)
    return Mesh(np.concatenate(vertices, axis=1), np.concatenate(faces), np.concatenate(surface), moving)
