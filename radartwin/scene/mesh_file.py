"""Read mesh files with trimesh, without its silent repairs. Meshes keep their textures and colours; a missing texture causes a warning."""

from __future__ import annotations

import contextlib
import struct
import warnings
from pathlib import Path
from typing import IO, Any

import numpy as np
import trimesh
from trimesh.resolvers import FilePathResolver
from trimesh.visual import ColorVisuals

from radartwin.errors import InputError, MeshError, MissingError
from radartwin.io import untrusted_json
from radartwin.io.files import inside
from radartwin.scene.mesh_limits import check_glb, check_pictures

MESH_SUFFIXES = (".glb", ".ply", ".obj")
HEAD_BYTES = 65_536  # bytes at the start of an .obj that are searched for the names of its material files


class TextureWarning(UserWarning):
    """Warn that a texture file of a mesh is missing; the mesh has the plain colour of its material instead."""


def read_meshes(source: str | Path | IO[bytes], file_type: str | None = None, name: str | Path | None = None) -> dict[str, trimesh.Trimesh]:
    """Read the triangle meshes of a file, as a dictionary by name. Node transforms are applied; no mesh is merged or dropped.

    Args:
        source: a .glb, .ply or .obj path, or an open stream together with `file_type`.
        name: name of the stream in error messages.
    Raises:
        MissingError: the file does not exist.
        MeshError: the file has another format, is damaged, or exceeds the limits of `mesh_limits`.
    Warns:
        TextureWarning: a picture is missing; its surfaces have the plain colour of their material.
    """
    label = str(source if name is None else name)
    if file_type is None:
        path = Path(source)  # type: ignore[arg-type]
        if path.suffix.lower() not in MESH_SUFFIXES:
            raise MeshError(f"{label} is not a supported mesh file; convert it to {', '.join(MESH_SUFFIXES)}")
        if not path.is_file():
            raise MissingError(f"mesh {label} is not there; check the path")
        # The resolver finds the materials and textures beside an .obj.
        loaded = _load(path, path.suffix.lower()[1:], label, resolver=FilePathResolver(str(path)), maintain_order=True)
        if missing := missing_textures(path):
            text = f"{label} names the texture {missing[0]}, which is not beside it; the surfaces keep their plain colours"
            warnings.warn(text, TextureWarning, stacklevel=2)
    else:
        loaded = _load(source, file_type, label)  # type: ignore[arg-type]
    check_pictures((getattr(g.visual, "material", None) for g in loaded.geometry.values() if hasattr(g, "visual")), label)
    meshes: dict[str, trimesh.Trimesh] = {}
    for node in loaded.graph.nodes_geometry:
        transform, key = loaded.graph[node]
        geometry = loaded.geometry[key]
        if isinstance(geometry, trimesh.Trimesh):
            if not np.array_equal(transform, np.eye(4)):
                geometry = geometry.copy().apply_transform(transform)
            if len(geometry.faces) and not 0 <= geometry.faces.min() <= geometry.faces.max() < len(geometry.vertices):
                raise MeshError(f"{label} has a face whose vertex is missing; export it again")
            _use_plain_colour_without_picture(geometry)
            meshes[node if node not in meshes else f"{node}_{len(meshes)}"] = geometry
    return meshes


def _load(source: Path | IO[bytes], file_type: str, label: str, **options: Any) -> trimesh.Scene:
    try:
        with source.open("rb") if isinstance(source, Path) else contextlib.nullcontext(source) as stream:
            if file_type == "glb":
                check_glb(stream, label)
            return trimesh.load_scene(stream, file_type=file_type, process=False, **options)
    except MeshError:
        raise
    except Exception as error:  # trimesh's readers raise errors of many types
        reason = (" ".join(str(error).split()) or type(error).__name__)[:200]
        raise MeshError(f"{label} cannot be read as {file_type}: {reason}; export it again") from error


def missing_textures(path: Path) -> list[str]:
    """Return the missing pictures and material files that a .glb or .obj refers to; an empty list for other formats."""
    if path.suffix.lower() == ".glb":
        named = _pictures_of_glb(path)
    elif path.suffix.lower() == ".obj":
        with path.open("rb") as stream:
            libraries = _values_of(stream.read(HEAD_BYTES), "mtllib")
        present = [path.parent / name for name in libraries if _is_beside(path, name)]
        named = libraries + [name for library in present for name in _values_of(library.read_bytes(), "map_Kd")]
    else:
        return []
    return [name for name in named if not _is_beside(path, name)]


def _is_beside(path: Path, name: str) -> bool:
    """Return whether the name refers to a file in the mesh's folder; trimesh reads no files outside it."""
    try:
        return inside(path.parent, name).is_file()
    except (OSError, InputError):  # an overlong name, or a path outside the folder
        return False


def _pictures_of_glb(path: Path) -> list[str]:
    with path.open("rb") as stream:
        head = stream.read(20)
        if len(head) < 20 or head[:4] != b"glTF" or head[16:20] != b"JSON":
            return []
        try:
            images = untrusted_json.load(stream.read(struct.unpack("<I", head[12:16])[0])).get("images", [])
            named = [image.get("uri", "data:") for image in images]
            return [uri for uri in named if uri and not uri.startswith("data:")]
        except (ValueError, TypeError, AttributeError):  # trimesh's reader reports damage
            return []


def _values_of(text: bytes, key: str) -> list[str]:
    """Return the text after the key in each line of a Wavefront file that begins with this key."""
    lines = [line.split(None, 1) for line in text.decode("utf-8", "replace").splitlines()]
    return [line[1].strip() for line in lines if len(line) == 2 and line[0] == key]


def _use_plain_colour_without_picture(mesh: trimesh.Trimesh) -> None:
    """Replace a texture that has no picture by the material's colour at the vertices."""
    visual: Any = mesh.visual
    if visual.kind != "texture":
        return
    from PIL.Image import Image

    material = visual.material
    if not any(isinstance(getattr(material, name, None), Image) for name in ("baseColorTexture", "image")):
        mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile(material.main_color, (len(mesh.vertices), 1)))
