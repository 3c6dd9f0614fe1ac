"""What a twin knows of a room: the truth, with every surface a little out of place and the small things missing.

This is NOT a scanner: it draws one rigid error per surface and knows nothing of rays, occlusion, resolution or drift.
It stands for two errors a radar twin has from any scan, surfaces out of place and fixtures that are missing.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import trimesh

from radartwin.scene.rooms import CLUTTER
from radartwin.scene.scene import Scene, Surface

PLANAR_M = 1e-6


def as_scanned(
    scene: Scene,
    rng: np.random.Generator,
    offset_m: float = 0.01,
    tilt_deg: float = 0.2,
    vertex_noise_m: float = 0.0,
    unscanned: Iterable[str] = CLUTTER,
) -> Scene:
    """The twin's view of a room; surfaces of kind "object" are left as they are.

    A planar surface moves along its normal and tilts about its centre, a solid moves and turns as a whole. The default
    1 cm is the absolute accuracy of phone LiDAR on objects over 10 cm (Luetzenburg et al. 2021, Scientific Reports 11,
    22221); 0.2 degrees moves the edge of a 6 m wall by the same.

    Args:
        rng: every surface takes its own child generator, so leaving one out does not change the others.
        offset_m, tilt_deg: standard deviations of position (per axis) and of angle (per axis).
        vertex_noise_m: standard deviation added along the normal to every vertex of solids; planes stay planes, as
            they do after the flattening in `radartwin.reconstruct`.
        unscanned: names that the scan missed; names the scene does not have are ignored.
    """
    missed = set(unscanned)
    children = rng.spawn(len(scene))
    return Scene(
        (
            surface if surface.kind == "object" else _displaced(surface, child, offset_m, tilt_deg, vertex_noise_m)
            for surface, child in zip(scene, children, strict=True)
            if surface.name not in missed
        ),
        {**scene.provenance, "scanned": {"offset_m": offset_m, "tilt_deg": tilt_deg, "vertex_noise_m": vertex_noise_m}},
    )


def _displaced(surface: Surface, rng: np.random.Generator, offset_m: float, tilt_deg: float, vertex_noise_m: float) -> Surface:
    vertices = np.asarray(surface.mesh.vertices)
    centre = vertices.mean(axis=0)
    axes = np.linalg.svd(vertices - centre, full_matrices=False)[2]  # the last spans the normal of a plane
    shift = offset_m * rng.standard_normal(3)
    turn = np.radians(tilt_deg) * rng.standard_normal(3)
    planar = bool(np.abs((vertices - centre) @ axes[2]).max() < PLANAR_M)
    if planar:
        shift, turn = shift[2] * axes[2], turn[0] * axes[0] + turn[1] * axes[1]
    angle = float(np.linalg.norm(turn))
    motion = np.array(trimesh.transformations.rotation_matrix(angle, turn if angle else [0, 0, 1], centre), dtype=float)
    motion[:3, 3] += shift
    moved = surface.moved(motion)
    if vertex_noise_m and not planar:
        mesh = moved.mesh
        noise = vertex_noise_m * rng.standard_normal((len(mesh.vertices), 1)) * mesh.vertex_normals
        moved = moved.replaced(mesh=trimesh.Trimesh(mesh.vertices + noise, mesh.faces, process=False))
    return moved
