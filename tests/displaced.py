"""Make a scene whose surfaces are slightly displaced, as in a second scan of the same room."""

import numpy as np
import trimesh

from radartwin.scene.scene import Scene


def displaced(scene: Scene, rng: np.random.Generator, offset_m: float = 0.01, tilt_deg: float = 0.2) -> Scene:
    """Move every room surface rigidly by a random offset and a random tilt, with the standard deviations `offset_m` in metres and
    `tilt_deg` in degrees. A flat surface moves along its normal.
    """
    surfaces = []
    for surface in scene:
        if surface.kind == "room":
            vertices = np.asarray(surface.mesh.vertices)
            centre = vertices.mean(axis=0)
            axes = np.linalg.svd(vertices - centre, full_matrices=False)[2]  # the last axis is the normal of a plane
            shift, turn = offset_m * rng.standard_normal(3), np.radians(tilt_deg) * rng.standard_normal(3)
            if np.abs((vertices - centre) @ axes[2]).max() < 1e-6:
                shift, turn = shift[2] * axes[2], turn[0] * axes[0] + turn[1] * axes[1]
            motion = np.array(trimesh.transformations.rotation_matrix(float(np.linalg.norm(turn)), turn, centre), dtype=float)
            motion[:3, 3] += shift
            surface = surface.moved(motion)
        surfaces.append(surface)
    return Scene(surfaces, scene.provenance)
