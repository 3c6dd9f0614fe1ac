"""A scanned mesh becomes a labelled scene: read and checked, segmented, flattened, one material, saved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from radartwin.materials import check_name
from radartwin.reconstruct.flatten import flattened, onto_plane
from radartwin.reconstruct.mesh_file import Axis, Unit, load_scan
from radartwin.reconstruct.segment import PlanarRegionGrowing, Segment, Segmenter
from radartwin.scene.scene import Scene, Surface

if TYPE_CHECKING:
    from radartwin.materials import Layered

LEVEL = np.cos(np.radians(15.0))  # a plane this close to horizontal is a floor, ceiling or level
UPRIGHT = np.sin(np.radians(15.0))
MIN_WALL_M2 = 1.0  # a smaller upright plane is furniture
MIN_HEIGHT_M = 1e-6  # a triangle thinner than this lost its normal to the flattening


def reconstruct(
    path: str | Path,
    out: str | Path | None = None,
    *,
    material: str | Layered = "plasterboard",
    unit: Unit = "auto",
    up: Axis = "auto",
    flatten: bool = True,
    segmenter: Segmenter | None = None,
) -> Scene:
    """Turn a scan into a scene of named surfaces.

    Args:
        path: .glb, .ply or .obj of a room.
        out: folder for scene.glb and manifest.json; None keeps the scene in memory.
        material: what every surface is labelled as until a material source says better.
        unit, up: see `radartwin.reconstruct.mesh_file.load_scan`.
        flatten: project planar segments onto their planes (see `radartwin.reconstruct.flatten`).
        segmenter: `PlanarRegionGrowing()` unless given.
    Returns:
        The scene, all of kind "room"; its provenance holds the scan report, and how far flattening moved vertices.
    Raises:
        MissingError, MeshError, ScanError: the file, see `load_scan`.
        MaterialError: an unknown material.
        OutputError: `out` cannot be written.
    """
    if isinstance(material, str):
        check_name(material)
    mesh, report = load_scan(path, unit, up)
    segments = (segmenter or PlanarRegionGrowing())(mesh)
    moved = flattened(mesh, segments) if flatten else np.asarray(mesh.vertices)
    distance = np.linalg.norm(moved - mesh.vertices, axis=1)
    surfaces = []
    for segment, name in zip(segments, segment_names(mesh, segments), strict=True):
        piece = _piece(moved, np.asarray(mesh.faces)[segment.faces], segment if flatten else None)
        if piece is not None:
            label = {"source": "uniform", "planar": segment.normal is not None}
            surfaces.append(Surface(piece, material, name, role="room", provenance=label))
    scene = Scene(
        surfaces,
        {
            "source": Path(path).name,
            "scan": report.to_dict(),
            "flattened": flatten,
            "flattening_rms_m": float(np.sqrt(np.mean(distance**2))),
            "flattening_max_m": float(distance.max()),
        },
    )
    if out is not None:
        scene.save(out)
    return scene


def segment_names(mesh: trimesh.Trimesh, segments: Sequence[Segment]) -> list[str]:
    """What the geometry says of each segment: floor, ceiling, wall_1, level_1, plane_1, part_1; numbered in order.

    The floor is the largest level plane that faces up, the ceiling the largest that faces down above it.
    """
    names: list[str] = [""] * len(segments)
    order = sorted(range(len(segments)), key=lambda k: -segments[k].area_m2)
    heights = [float(mesh.triangles_center[s.faces, 2].mean()) for s in segments]

    def vertical(k: int) -> float:
        normal = segments[k].normal
        return float(normal[2]) if normal is not None else 0.0

    floor = next((k for k in order if vertical(k) > LEVEL), None)
    if floor is not None:
        names[floor] = "floor"
    below = heights[floor] if floor is not None else -np.inf
    ceiling = next((k for k in order if vertical(k) < -LEVEL and heights[k] > below), None)
    if ceiling is not None:
        names[ceiling] = "ceiling"
    counts: dict[str, int] = {}
    for k, segment in enumerate(segments):
        if not names[k]:
            kind = _kind(segment, vertical(k))
            counts[kind] = counts.get(kind, 0) + 1
            names[k] = f"{kind}_{counts[kind]}"
    return names


def _kind(segment: Segment, vertical: float) -> str:
    if segment.normal is None:
        return "part"
    if abs(vertical) > LEVEL:
        return "level"
    return "wall" if abs(vertical) < UPRIGHT and segment.area_m2 >= MIN_WALL_M2 else "plane"


def _piece(vertices: np.ndarray, faces: np.ndarray, flat: Segment | None) -> trimesh.Trimesh | None:
    """The faces as a mesh of their own, on their plane if `flat` has one, less the ones flattening collapsed."""
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = vertices[used] if flat is None else onto_plane(vertices[used], flat)
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    faces = faces[area > MIN_HEIGHT_M * np.maximum(longest, 1e-12)]
    if len(faces) == 0:
        return None
    normals = None if flat is None or flat.normal is None else np.tile(flat.normal, (len(vertices), 1))
    mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals, process=False)
    mesh.remove_unreferenced_vertices()
    return mesh
