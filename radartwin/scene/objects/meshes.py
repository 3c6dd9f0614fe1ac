"""Build objects from mesh files, scanned or drawn, in the same frame as the catalogue objects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from radartwin.errors import MeshError
from radartwin.materials import Layered
from radartwin.scene.checks import check_mesh
from radartwin.scene.mesh_file import read_meshes
from radartwin.scene.surface import Surface

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
SMALLEST_M, LARGEST_M = 0.01, 1.0  # limits for the size of an object on a table or a turntable
UP = {"z": np.eye(4), "y": trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])}


def from_mesh(
    path: str | Path,
    material: str | Layered,
    name: str = "",
    *,
    unit: str = "m",
    up: str = "z",
    roughness_m: float = 0.0,
    minc: str | None = None,
) -> tuple[Surface, ...]:
    """Read a mesh file as an object: in metres, z up, standing on z = 0, centred on the z axis.

    Args:
        path: .obj, .ply or .glb file; the surfaces have its texture and colours.
        material: material of the whole object.
        name: name of the surfaces; by default the stem of the file name.
        unit: length unit of the file: m, cm, mm or in.
        up: upward axis of the file, z or y.
        minc: MINC category, if known.
    Returns:
        One surface per mesh of the file, all of the same name.
    Raises:
        MissingError: the file does not exist.
        MeshError: the mesh is unreadable, empty, or not between 1 cm and 1 m long.
    """
    if unit not in UNITS:
        raise MeshError(f"{path}: unit is {unit!r}; choose {', '.join(UNITS)}")
    if up not in UP:
        raise MeshError(f"{path}: up is {up!r}; choose {' or '.join(UP)}")
    meshes = list(read_meshes(path).values())
    if not meshes:
        raise MeshError(f"{path} holds no triangles; give a mesh, not a point cloud")
    turn = UP[up] @ np.diag([UNITS[unit]] * 3 + [1.0])
    moved = [mesh.copy().apply_transform(turn) for mesh in meshes]
    low = np.min([mesh.bounds[0] for mesh in moved], axis=0)
    high = np.max([mesh.bounds[1] for mesh in moved], axis=0)
    extent = float((high - low).max())
    if np.isfinite(extent) and not SMALLEST_M <= extent <= LARGEST_M:
        raise MeshError(f"{path} is {extent:.4g} m long in unit={unit}; objects measure 1 cm to 1 m.{_unit_hint(extent / UNITS[unit])}")
    for mesh in moved:
        check_mesh(mesh, str(path))
    shift = -np.append((low + high)[:2] / 2, low[2])
    provenance = {"source": "given", "confidence": None, "stand_in": False, "minc": minc, "file": Path(path).name}
    return tuple(
        Surface(mesh.apply_translation(shift), material, name or Path(path).stem, roughness_m, "object", provenance) for mesh in moved
    )


def _unit_hint(length: float) -> str:
    """Return a question that suggests the units in which the object would be 5 to 35 cm long, like a household object."""
    fits = [unit for unit, scale in UNITS.items() if 0.05 <= length * scale <= 0.35]
    return f" Pass unit={' or unit='.join(fits)}?" if fits else ""
