"""Check the size of a .glb and its pictures before unpacking, because a file of a kilobyte can unpack to more than the memory.

Ref: Khronos glTF 2.0, sections 3.6.2 (accessors; one without a buffer view is zeros), 3.5.2 (the node tree) and 4.4 (the
binary container).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import IO, Any

from radartwin.errors import MeshError
from radartwin.io import untrusted_json

MAX_INSTANCES = 1_000_000  # largest number of mesh copies that the nodes place
MAX_BYTES = 16 << 30  # largest size of all mesh copies together
MAX_PIXELS = 1_000_000_000  # largest number of pixels of all textures together, 3 GB of colours
PICTURES = ("image", "baseColorTexture", "emissiveTexture", "normalTexture", "occlusionTexture", "metallicRoughnessTexture")
SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # bytes of a component
COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}  # components of an element
_JSON = 0x4E4F534A


def check_glb(stream: IO[bytes], label: str) -> None:
    """Refuse a .glb that unpacks to far more than its size. The function restores the position of the stream.

    A damaged file passes, because the reader of the file reports the damage.

    Raises:
        MeshError: arrays are far larger than the file, nodes form a circle, or there are too many copies of meshes.
    """
    start = stream.tell()
    length = stream.seek(0, 2) - start
    stream.seek(start)
    try:
        document = _document(stream)
        stored, placed, instances = _sizes(document)
    except (ValueError, LookupError, TypeError, AttributeError, struct.error, RecursionError):
        return  # not valid glTF; the reader reports it
    finally:
        stream.seek(start)
    if stored > 64 * length or placed > MAX_BYTES:
        raise MeshError(f"{label} is {length:,} bytes and would unpack to {max(stored, placed):,}; export it again, or in parts")
    if instances > MAX_INSTANCES:
        raise MeshError(f"{label} places more than {MAX_INSTANCES:,} meshes, or has nodes in a circle; export it again")


def check_pictures(materials: Iterable[Any], label: str) -> None:
    """Refuse textures with too many pixels. The check reads the pictures' headers and does not decompress them.

    Raises:
        MeshError: the textures together have more than MAX_PIXELS pixels.
    """
    from PIL.Image import Image

    pictures = {
        id(picture): picture for material in materials for name in PICTURES if isinstance(picture := getattr(material, name, None), Image)
    }
    pixels = sum(picture.width * picture.height for picture in pictures.values())
    if pixels > MAX_PIXELS:
        raise MeshError(f"{label} has textures of {pixels:,} pixels, over the limit of {MAX_PIXELS:,}; export it with smaller ones")


def _document(stream: IO[bytes]) -> dict[str, Any]:
    _, _, _, length, kind = struct.unpack("<5I", stream.read(20))
    if kind != _JSON:
        raise ValueError("the first chunk is not JSON")
    return untrusted_json.load(stream.read(length))


def _sizes(document: dict[str, Any]) -> tuple[int, int, int]:
    """Return the bytes of all accessors, the bytes of all mesh copies, and the number of mesh copies."""
    accessors = [_bytes(accessor) for accessor in document.get("accessors", [])]
    meshes = []
    for mesh in document.get("meshes", []):
        used = [index for part in mesh["primitives"] for index in (*part["attributes"].values(), part.get("indices")) if index is not None]
        meshes.append(sum(accessors[index] for index in used))
    nodes, known = document.get("nodes", []), dict[int, tuple[int, int]]()

    def subtree(index: int, ancestors: frozenset[int]) -> tuple[int, int]:
        """Return bytes and number of the mesh copies that a node and its descendants place."""
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
