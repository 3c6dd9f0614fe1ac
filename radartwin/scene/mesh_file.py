"""Reading mesh files through trimesh, without its silent repairs."""

from __future__ import annotations

from pathlib import Path
from typing import IO

import numpy as np
import trimesh

from radartwin.errors import MeshError, MissingError

MESH_SUFFIXES = (".glb", ".ply", ".obj")


def read_meshes(source: str | Path | IO[bytes], file_type: str | None = None, name: str | Path | None = None) -> dict[str, trimesh.Trimesh]:
    """Triangle meshes of a file by name, with the transforms of its nodes applied and nothing merged or dropped.

    Args:
        source: a .glb, .ply or .obj path, or an open stream with `file_type`.
        name: how messages call a stream.
    Raises:
        MissingError: no such file.
        MeshError: not one of the three formats, or not readable as what its suffix says.
    """
    label = str(name if name is not None else source)
    if file_type is None:
        path = Path(source)  # type: ignore[arg-type]
        if path.suffix.lower() not in MESH_SUFFIXES:
            raise MeshError(f"{label} is not a mesh this reads; convert it to {', '.join(MESH_SUFFIXES)}")
        if not path.is_file():
            raise MissingError(f"mesh {label} is not there; check the path")
        source, file_type = path, path.suffix.lower()[1:]
    try:
        if isinstance(source, Path):
            with source.open("rb") as stream:
                loaded = trimesh.load_scene(stream, file_type=file_type, process=False, maintain_order=True)
        else:
            loaded = trimesh.load_scene(source, file_type=file_type, process=False)
    except Exception as error:  # trimesh's readers raise whatever their parsing runs into
        raise MeshError(f"{label} cannot be read as {file_type}: {_one_line(error)}; export it again") from error
    meshes: dict[str, trimesh.Trimesh] = {}
    for node in loaded.graph.nodes_geometry:
        transform, key = loaded.graph[node]
        geometry = loaded.geometry[key]
        if isinstance(geometry, trimesh.Trimesh):
            if not np.array_equal(transform, np.eye(4)):
                geometry = geometry.copy().apply_transform(transform)
            meshes[node if node not in meshes else f"{node}_{len(meshes)}"] = geometry
    return meshes


def _one_line(error: Exception) -> str:
    return (" ".join(str(error).split()) or type(error).__name__)[:200]
