"""Read mesh files with trimesh, without the silent repairs of trimesh.

Meshes keep their textures and colours; a missing texture causes a warning.

The reader checks the unpacked size of a .glb and of its pictures before unpacking, because an unpacked kilobyte can exceed the memory of
the computer.
Ref: Khronos glTF 2.0, sections 3.6.2 (accessors; an accessor without a buffer view is all zeros), 3.5.2 (the node tree) and 4.4 (binary
container).
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np
import trimesh
from trimesh.resolvers import FilePathResolver
from trimesh.visual import ColorVisuals

from radartwin.errors import InputError, MeshError, MissingError
from radartwin.io import untrusted_json
from radartwin.io.files import inside

MESH_SUFFIXES = (".glb", ".ply", ".obj", ".stl")
HEAD_BYTES = 65_536  # bytes at the start of an .obj that are searched for the names of its material files
MAX_INSTANCES = 1_000_000  # largest number of mesh copies that the node tree of a .glb places
MAX_BYTES = 16 << 30  # largest size in bytes of all mesh copies together
MAX_PIXELS = 1_000_000_000  # largest number of pixels of all textures together, 3 GB of colours
PICTURES = ("image", "baseColorTexture", "emissiveTexture", "normalTexture", "occlusionTexture", "metallicRoughnessTexture")
SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # bytes per number, for each glTF component type
COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}  # numbers per element, for each glTF element type
_JSON = 0x4E4F534A


class TextureWarning(UserWarning):
    """Warn that a texture file of a mesh is missing; the mesh then has the plain colour given in the mesh file."""


def read_meshes(path: str | Path) -> dict[str, trimesh.Trimesh]:
    """Read the triangle meshes of a .glb, .ply, .obj or .stl, and return them in a dictionary by name.

    Node transforms are applied. The function returns every mesh and joins none of them. The triangles in a .stl share no vertices, so the
    function merges vertices at the same position.

    Raises:
        MissingError: the file does not exist.
        MeshError: the file has an unsupported format, is damaged, or exceeds the size limits of this module.
    Warns:
        TextureWarning: a texture file is missing; the meshes with this texture have the plain colour given in the mesh file.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise MeshError(f"{path} is not a supported mesh file; convert it to {', '.join(MESH_SUFFIXES)}")
    if not path.is_file():
        raise MissingError(f"mesh {path} is not there; check the path")
    loaded = _load(path)
    if missing := missing_textures(path):
        text = f"{path} names the texture {missing[0]}, which is not in its folder; add it, or the surfaces keep plain colours"
        warnings.warn(text, TextureWarning, stacklevel=2)
    _check_pictures((getattr(g.visual, "material", None) for g in loaded.geometry.values() if hasattr(g, "visual")), path)
    meshes: dict[str, trimesh.Trimesh] = {}
    for node in loaded.graph.nodes_geometry:
        transform, key = loaded.graph[node]
        geometry = loaded.geometry[key]
        if isinstance(geometry, trimesh.Trimesh):
            if not np.array_equal(transform, np.eye(4)):
                geometry = geometry.copy().apply_transform(transform)
            if path.suffix.lower() == ".stl":
                geometry.merge_vertices()
            if len(geometry.faces) and not 0 <= geometry.faces.min() <= geometry.faces.max() < len(geometry.vertices):
                raise MeshError(f"{path} has a face whose vertex is missing; export it again")
            _use_plain_colour_without_picture(geometry)
            meshes[node if node not in meshes else f"{node}_{len(meshes)}"] = geometry
    return meshes


def _load(path: Path) -> trimesh.Scene:
    kind = path.suffix.lower()[1:]
    try:
        with path.open("rb") as stream:
            if kind == "glb":
                _check_glb(stream, path)
            # The resolver finds the materials and textures beside an .obj.
            resolver = FilePathResolver(str(path))
            return trimesh.load_scene(stream, file_type=kind, process=False, resolver=resolver, maintain_order=True)
    except MeshError:
        raise
    except Exception as error:  # the readers of trimesh raise errors of many types
        reason = (" ".join(str(error).split()) or type(error).__name__)[:200]
        raise MeshError(f"{path} cannot be read as {kind}: {reason}; export it again") from error


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
    """Return whether `name` refers to a file in the folder of the mesh file; trimesh reads no files outside this folder."""
    try:
        return inside(path.parent, name).is_file()
    except (OSError, InputError):  # an overlong name, or a path outside the folder
        return False


def _pictures_of_glb(path: Path) -> list[str]:
    with path.open("rb") as stream:
        try:
            named = [image.get("uri", "data:") for image in _glb_document(stream).get("images", [])]
            return [uri for uri in named if uri and not uri.startswith("data:")]
        except (ValueError, TypeError, AttributeError, struct.error):  # the reader of trimesh reports the damage
            return []


def _values_of(text: bytes, key: str) -> list[str]:
    """Return the text after `key` in each line that begins with `key`, from the bytes of a Wavefront file (.obj or .mtl)."""
    lines = [line.split(None, 1) for line in text.decode("utf-8", "replace").splitlines()]
    return [line[1].strip() for line in lines if len(line) == 2 and line[0] == key]


def _use_plain_colour_without_picture(mesh: trimesh.Trimesh) -> None:
    """Replace a texture without a picture by vertex colours, which all have the plain colour given in the mesh file."""
    visual: Any = mesh.visual
    if visual.kind != "texture":
        return
    from PIL.Image import Image

    material = visual.material
    if not any(isinstance(getattr(material, name, None), Image) for name in ("baseColorTexture", "image")):
        mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile(material.main_color, (len(mesh.vertices), 1)))


def _check_glb(stream: IO[bytes], path: Path) -> None:
    """Raise an error for a .glb that is much larger unpacked than its file, or that places too many mesh copies.

    A damaged file passes this check, because the reader of trimesh reports the damage.
    """
    length = stream.seek(0, 2)
    stream.seek(0)
    try:
        document = _glb_document(stream)
        stored, placed, instances = _sizes(document)
    except (ValueError, LookupError, TypeError, AttributeError, struct.error, RecursionError):
        return  # not valid glTF; the reader reports it
    finally:
        stream.seek(0)
    if stored > 64 * length or placed > MAX_BYTES:
        raise MeshError(f"{path} has {length:,} bytes but would unpack to {max(stored, placed):,} bytes; export it in smaller parts")
    if instances > MAX_INSTANCES:
        raise MeshError(f"{path} places more than {MAX_INSTANCES:,} meshes, or has a cycle of nodes; export it again")


def _check_pictures(materials: Iterable[Any], path: Path) -> None:
    """Raise an error for textures with more than MAX_PIXELS pixels. The check reads only the headers of the pictures."""
    from PIL.Image import Image

    pictures = {
        id(picture): picture for material in materials for name in PICTURES if isinstance(picture := getattr(material, name, None), Image)
    }
    pixels = sum(picture.width * picture.height for picture in pictures.values())
    if pixels > MAX_PIXELS:
        raise MeshError(f"{path} has textures of {pixels:,} pixels, over the limit of {MAX_PIXELS:,}; export it with smaller ones")


def _glb_document(stream: IO[bytes]) -> dict[str, Any]:
    """Read the JSON chunk of a .glb file. A damaged file raises ValueError or struct.error."""
    _, _, _, length, kind = struct.unpack("<5I", stream.read(20))
    if kind != _JSON:
        raise ValueError("the first chunk is not JSON")
    return untrusted_json.load(stream.read(length))


def _sizes(document: dict[str, Any]) -> tuple[int, int, int]:
    """Return the unpacked bytes of all accessors, the unpacked bytes of all mesh copies, and the number of mesh
    copies of a glTF document.
    """
    accessors = [_bytes(accessor) for accessor in document.get("accessors", [])]
    meshes = []
    for mesh in document.get("meshes", []):
        used = [index for part in mesh["primitives"] for index in (*part["attributes"].values(), part.get("indices")) if index is not None]
        meshes.append(sum(accessors[index] for index in used))
    nodes, known = document.get("nodes", []), dict[int, tuple[int, int]]()

    def subtree(index: int, ancestors: frozenset[int]) -> tuple[int, int]:
        """Return the unpacked bytes and the number of the mesh copies that a node and its descendants place."""
        if index in ancestors:
            return 0, MAX_INSTANCES + 1
        if index not in known:
            node = nodes[index]
            total = (meshes[node["mesh"]], 1) if "mesh" in node else (0, 0)
            for child in node.get("children", []):
                size, count = subtree(child, ancestors | {index})
                total = (total[0] + size, total[1] + count)
            known[index] = total
        return known[index]

    roots = [subtree(root, frozenset()) for scene in document.get("scenes", []) for root in scene.get("nodes", [])]
    return sum(accessors), sum(size for size, _ in roots), sum(count for _, count in roots)


def _bytes(accessor: dict[str, Any]) -> int:
    return int(accessor["count"]) * SIZES[accessor["componentType"]] * COUNTS[accessor["type"]]
