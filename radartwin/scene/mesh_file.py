"""Reading mesh files through trimesh, without its silent repairs. Textures and colours are kept; a texture that is not there is told."""

from __future__ import annotations

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
HEAD_BYTES = 65_536  # of an .obj, where it names its materials


class TextureWarning(UserWarning):
    """A mesh whose picture is not there, and which is shown in its plain colour."""


def read_meshes(source: str | Path | IO[bytes], file_type: str | None = None, name: str | Path | None = None) -> dict[str, trimesh.Trimesh]:
    """Triangle meshes of a file by name, with the transforms of its nodes applied and nothing merged or dropped.

    Args:
        source: a .glb, .ply or .obj path, or an open stream with `file_type`.
        name: how messages call a stream.
    Raises:
        MissingError: no such file.
        MeshError: not one of the three formats, not readable as what its suffix says, or more than memory holds (`mesh_limits`).
    Warns:
        TextureWarning: it names pictures that are not there; what should wear them keeps the colour of its material.
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
                if file_type == "glb":
                    check_glb(stream, label)
                beside = FilePathResolver(str(source))  # where an .obj keeps its materials and textures
                loaded = trimesh.load_scene(stream, file_type=file_type, resolver=beside, process=False, maintain_order=True)
        else:
            if file_type == "glb" and not isinstance(source, str):
                check_glb(source, label)
            loaded = trimesh.load_scene(source, file_type=file_type, process=False)
    except MeshError:
        raise
    except Exception as error:  # trimesh's readers raise whatever their parsing runs into
        raise MeshError(f"{label} cannot be read as {file_type}: {_one_line(error)}; export it again") from error
    if isinstance(source, Path) and (gone := missing_textures(source)):
        text = f"{label} names the texture {gone[0]}, which is not beside it; the surfaces keep their plain colours"
        warnings.warn(text, TextureWarning, stacklevel=2)
    check_pictures((getattr(g.visual, "material", None) for g in loaded.geometry.values() if hasattr(g, "visual")), label)
    meshes: dict[str, trimesh.Trimesh] = {}
    for node in loaded.graph.nodes_geometry:
        transform, key = loaded.graph[node]
        geometry = loaded.geometry[key]
        if isinstance(geometry, trimesh.Trimesh):
            if not np.array_equal(transform, np.eye(4)):
                geometry = geometry.copy().apply_transform(transform)
            if len(geometry.faces) and not 0 <= geometry.faces.min() <= geometry.faces.max() < len(geometry.vertices):
                raise MeshError(f"{label} has a face of vertices that it lacks; export it again")
            _plain_without_picture(geometry)
            meshes[node if node not in meshes else f"{node}_{len(meshes)}"] = geometry
    return meshes


def missing_textures(path: Path) -> list[str]:
    """Pictures and material files that a .glb or .obj names and that are not where it says; empty for all else."""
    if path.suffix.lower() == ".glb":
        named = _named_by_glb(path)
    elif path.suffix.lower() == ".obj":
        with path.open("rb") as stream:
            libraries = _named(stream.read(HEAD_BYTES), "mtllib")
        there = [path.parent / name for name in libraries if _is_beside(path, name)]
        named = libraries + [name for library in there for name in _named(library.read_bytes(), "map_Kd")]
    else:
        return []
    return [name for name in named if not _is_beside(path, name)]


def _is_beside(path: Path, name: str) -> bool:
    """Whether the name is of a file in the mesh's folder; trimesh reads no others."""
    try:
        return inside(path.parent, name).is_file()
    except (OSError, InputError):  # longer than a name can be, or elsewhere
        return False


def _named_by_glb(path: Path) -> list[str]:
    with path.open("rb") as stream:
        head = stream.read(20)
        if len(head) < 20 or head[:4] != b"glTF" or head[16:20] != b"JSON":
            return []
        try:
            images = untrusted_json.load(stream.read(struct.unpack("<I", head[12:16])[0])).get("images", [])
            named = [image.get("uri", "data:") for image in images]
            return [uri for uri in named if uri and not uri.startswith("data:")]
        except (ValueError, TypeError, AttributeError):  # whatever is wrong with it, the reader has said
            return []


def _named(text: bytes, word: str) -> list[str]:
    """What follows a word at the start of a line of a Wavefront file: the last item, after any options."""
    lines = [line.split(None, 1) for line in text.decode("utf-8", "replace").splitlines()]
    return [line[1].strip() for line in lines if len(line) == 2 and line[0] == word]


def _plain_without_picture(mesh: trimesh.Trimesh) -> None:
    """Vertex colours of the material in place of a texture that has no picture."""
    visual: Any = mesh.visual
    if visual.kind != "texture":
        return
    from PIL.Image import Image

    material = visual.material
    if not any(isinstance(getattr(material, name, None), Image) for name in ("baseColorTexture", "image")):
        mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile(material.main_color, (len(mesh.vertices), 1)))


def _one_line(error: Exception) -> str:
    return (" ".join(str(error).split()) or type(error).__name__)[:200]
