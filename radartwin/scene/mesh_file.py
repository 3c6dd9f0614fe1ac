"""Read the mesh files of scans and of objects.

trimesh parses the files. This module adds what trimesh leaves out or does wrongly: it refuses a .glb with an extension that changes the
geometry and that nobody decodes, converts quantised and sparse numbers, reads a binary .ply whose polygons differ in length, divides
polygons into triangles, and says in one line what it leaves out.

The reader checks the unpacked size of a .glb and of its pictures before unpacking, because an unpacked kilobyte can exceed the memory of
the computer.
Ref: Khronos glTF 2.0, sections 3.6.2 (accessors; an accessor without a buffer view is all zeros), 3.5.2 (the node tree) and 4.4 (binary
container); KHR_mesh_quantization; Turk 1994, The PLY Polygon File Format.
"""

from __future__ import annotations

import contextlib
import copy
import io
import json
import logging
import re
import struct
import warnings
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import trimesh
from mapbox_earcut import triangulate_float64
from PIL import Image
from trimesh.exchange import ply
from trimesh.resolvers import FilePathResolver
from trimesh.visual import ColorVisuals

from radartwin.errors import InputError, MeshError, MissingError
from radartwin.io import untrusted_json
from radartwin.io.files import inside
from radartwin.io.git_lfs import refuse_pointer
from radartwin.io.one_line import plural
from radartwin.scene.mesh_checks import MAX_EXTENT_M

MESH_SUFFIXES = (".glb", ".ply", ".obj", ".stl")
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}  # length units of mesh files
# Rotations that turn an up axis into z. The rotations permute the axes cyclically, so that handedness does not change.
TO_Z_UP = {
    "x": np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "z": np.eye(3),
    "-x": np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]),
    "-y": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "-z": np.diag([1, -1, -1]),
}
MAX_BYTES = 16 << 30  # largest size in bytes of all mesh copies together
MAX_PIXELS = 1_000_000_000  # largest number of pixels of all textures together, 3 GB of colours
PICTURES = ("image", "baseColorTexture", "emissiveTexture", "normalTexture", "occlusionTexture", "metallicRoughnessTexture")
# glTF extensions that are decoded, and the beginnings of the names of those that change only the look of a surface
DECODED = ("KHR_mesh_quantization", "KHR_draco_mesh_compression")
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "MSFT_texture_", "KHR_xmp")
INSTANCING = "EXT_mesh_gpu_instancing"  # even an optional one changes the geometry
# data type of a number for each glTF component type, and the count of numbers per element for each element type
KINDS = {
    code: np.dtype(kind) for code, kind in zip((5120, 5121, 5122, 5123, 5125, 5126), ("i1", "u1", "<i2", "<u2", "<u4", "<f4"), strict=True)
}
COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
USHORT, FLOAT = 5123, 5126
POINTS_OR_LINES, TRIANGLES, FAN = (0, 1, 2, 3), 4, 6  # modes of a glTF primitive
_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
MOST_WORDS = 40  # in the name of a picture with its options
FLAT = 1e-6  # largest |sine| of the angle at a corner in a straight line
_POLYGON = re.compile(r"^f(?:[ \t]+\S+){4}|^f\s[^\n]*-", re.MULTILINE)  # a face of an .obj with four corners, or counted backwards

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # this module reports what trimesh would only log


class MeshWarning(UserWarning):
    """Warn that the reader leaves out a part of a mesh file, such as a missing picture, points or lines."""


def read_meshes(path: str | Path) -> dict[str, trimesh.Trimesh]:
    """Read the triangle meshes of a .glb, .ply, .obj or .stl, and return them in a dictionary by name.

    Node transforms are applied. The function returns every mesh and joins none of them. The triangles in a .stl share no vertices, so the
    function merges vertices at the same position. A vertex on a seam of a picture is doubled, and keeps its normal.

    Raises:
        MissingError: the file does not exist.
        MeshError: the file has an unsupported format or extension, is damaged, is a Git LFS pointer, or exceeds the size limits of this
            module.
    Warns:
        MeshWarning: a part is left out; without its picture, a mesh has the plain colour given in the file.
    """
    path = Path(path)
    kind = path.suffix.lower()[1:]
    if f".{kind}" not in MESH_SUFFIXES:
        raise MeshError(f"{path} is not a supported mesh file; convert it to {', '.join(MESH_SUFFIXES)}")
    if not path.is_file():
        raise MissingError(f"mesh {path} is not there; check the path")
    refuse_pointer(path, MeshError)
    resolver, left_out = _Beside(path), list[str]()
    try:
        content = path.read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # vertices without a face have no texture coordinate
            scene = _load(content, kind, resolver, left_out)
    except MeshError as error:
        raise MeshError(f"{path} {error}") from None
    except Exception as error:  # the readers of trimesh raise errors of many types
        reason = (" ".join(str(error).split()) or type(error).__name__)[:200]
        raise MeshError(f"{path} cannot be read as {kind}: {reason}; export it again") from error
    _check_pictures((getattr(g.visual, "material", None) for g in scene.geometry.values() if hasattr(g, "visual")), path)
    if left_out := [*(f"the texture or material file {name}, which its folder lacks" for name in resolver.missing), *left_out]:
        warnings.warn(f"{path} is read without {' and '.join(left_out)}", MeshWarning, stacklevel=2)
    meshes: dict[str, trimesh.Trimesh] = {}
    for node in scene.graph.nodes_geometry:
        transform, key = scene.graph[node]
        geometry = scene.geometry[key]
        if isinstance(geometry, trimesh.Trimesh):
            if not np.array_equal(transform, np.eye(4)):
                geometry = geometry.copy().apply_transform(transform)
            if kind == "stl":
                geometry.merge_vertices()
            if len(geometry.faces) and not 0 <= geometry.faces.min() <= geometry.faces.max() < len(geometry.vertices):
                raise MeshError(f"{path} has a face whose vertex is missing; export it again")
            _use_plain_colour_without_picture(geometry)
            meshes[node if node not in meshes else f"{node}_{len(meshes)}"] = geometry
    return meshes


def offset_m(points: np.ndarray) -> np.ndarray:
    """Return the whole metres (3,) by which a scan with these points (N, 3) is moved towards the origin before it is stored.

    Single precision has steps of 4 um at 50 m and of 0.5 m at survey coordinates. An axis whose centre is within MAX_EXTENT_M of the
    origin keeps its coordinates.

    >>> offset_m(np.array([[452315.4, 0, -60], [452319.4, 3, 0]])).tolist()
    [452317.0, 0.0, 0.0]
    """
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    return np.where(np.abs(centre) > MAX_EXTENT_M, np.rint(centre), 0.0)


def triangulated(points: np.ndarray, indices: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Divide polygons, which may be concave or have holes joined to their rim by a doubled edge, into triangles.

    Args:
        points: (V, 3) coordinates.
        indices: (N,) indices of the corners in `points`, polygon after polygon.
        sizes: (P,) number of corners of each polygon.
    Returns:
        The places of each triangle's corners in `indices`, (T, 3), and the number of its polygon, (T,), in the order of the polygons.

    >>> dart = np.array([[0, 0, 0], [2, 0, 0], [0.1, 0.1, 0], [0, 2, 0]])
    >>> triangulated(dart, np.arange(4), np.array([4]))[0].tolist()
    [[2, 3, 0], [2, 0, 1]]
    """
    starts = np.cumsum(sizes) - sizes
    corners, owners = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for size in np.unique(sizes[sizes > 2]).tolist():
        group = np.flatnonzero(sizes == size)
        at = points[indices[starts[group, None] + np.arange(size)]]
        at = at - at[:, :1]
        edge = np.roll(at, -1, axis=1) - at
        normal = np.cross(at, np.roll(at, -1, axis=1)).sum(axis=1)  # twice the vector area of the polygon
        length = np.linalg.norm(edge, axis=2)
        scale = length * np.roll(length, 1, axis=1) * np.linalg.norm(normal, axis=1)[:, None]
        sine = np.einsum("kni,ki->kn", np.cross(np.roll(edge, 1, axis=1), edge), normal) / np.where(scale > 0, scale, 1)
        # a convex polygon, or one without an area or with infinite coordinates, becomes a fan about its first corner
        fan = (sine > FLAT).all(axis=1) | ~(np.linalg.norm(normal, axis=1) > 0) | ~np.isfinite(normal).all(axis=1) | (size == 3)
        places = np.stack([np.zeros(size - 2, np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
        corners.append((starts[group[fan], None, None] + places).reshape(-1, 3))
        owners.append(np.repeat(group[fan], size - 2))
        for k in np.flatnonzero(~fan):
            places = _ears(at[k] @ np.asarray(trimesh.geometry.align_vectors(normal[k], [0, 0, 1]))[:2, :3].T)
            corners.append(starts[group[k]] + places)
            owners.append(np.full(len(places), group[k]))
    order = np.argsort(np.concatenate(owners), kind="stable")
    return np.concatenate(corners)[order], np.concatenate(owners)[order]


def _ears(ring: np.ndarray) -> np.ndarray:
    """Cut a counter-clockwise polygon (N, 2) into triangles (T, 3) that use every corner, also in straight lines, where faces may end."""
    count = len(ring)
    triangles = triangulate_float64(ring, np.array([count], np.uint32)).reshape(-1, 3).astype(np.int64)
    (x, y), (u, v) = ((ring[triangles[:, k]] - ring[triangles[:, 0]]).T for k in (1, 2))
    triangles[x * v < y * u] = triangles[x * v < y * u, ::-1]
    covered = set(triangles.ravel().tolist())
    for corner in [k for k in range(count) if k not in covered]:
        before, after = (next((k for n in range(1, count) if (k := (corner + sign * n) % count) in covered), corner) for sign in (-1, 1))
        # split the triangle that holds the edge on which the corner lies
        for triangle, place in np.argwhere((triangles == before) & (np.roll(triangles, -1, axis=1) == after)):
            apex = triangles[triangle, place - 1]
            triangles[triangle] = before, corner, apex
            triangles = np.vstack([triangles, [corner, after, apex]])
            covered.add(corner)
    return triangles


class _Beside(FilePathResolver):
    """Read the materials and pictures in the folder of the mesh file, and note those that cannot be read."""

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self.folder, self.missing = path.parent, list[str]()

    def get(self, name: str) -> bytes:
        # In an .mtl, options such as "-s 1 1 1" may stand before the name of a picture.
        words = name.split()[:MOST_WORDS] if name.startswith("-") else []
        for spelling in (name, unquote(name).replace("\\", "/"), *(" ".join(words[n:]) for n in range(1, len(words)))):
            try:
                if (file := inside(self.folder, spelling)).is_file():
                    return file.read_bytes()
            except (OSError, InputError):  # an overlong name, or a path outside the folder
                pass
        if name not in self.missing:
            self.missing.append(name)
        raise FileNotFoundError(f"{name} is not in its folder")


def _load(content: bytes, kind: str, resolver: _Beside, left_out: list[str]) -> trimesh.Scene:
    """Parse the content of a mesh file. Append to `left_out` the names of the parts that are not read."""
    if kind == "ply":
        return _load_ply(io.BytesIO(content), resolver, left_out)
    keep_order = True
    if kind == "glb":
        content = _plain_glb(content, left_out)
    elif kind == "obj":
        text = _plain_obj(trimesh.util.decode_text(content), left_out)
        content, keep_order = text.encode(), not _has_pictures(text, resolver)
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False, resolver=resolver, maintain_order=keep_order)
    if b"KHR_draco" in content and not all(np.ptp(mesh.vertices, axis=0).any() for mesh in scene.geometry.values()):
        raise ValueError("its Draco data are damaged")  # trimesh leaves zeros
    if kind == "obj" and not keep_order and "\nvn " not in text:
        for mesh in scene.geometry.values():  # trimesh divides a vertex at a seam of the picture; both parts keep the normal of the whole
            first, whole = trimesh.grouping.unique_rows(mesh.vertices)
            mesh.vertex_normals = trimesh.Trimesh(mesh.vertices[first], whole[mesh.faces], process=False).vertex_normals[whole]
    return scene


def _has_pictures(text: str, resolver: _Beside) -> bool:
    library = re.search(r"^mtllib[ \t]+(.*\S)", text, re.MULTILINE)
    try:
        return bool(library and re.search(rb"^\s*map_kd", resolver.get(library[1]), re.MULTILINE | re.IGNORECASE))
    except FileNotFoundError:
        return False


def _plain_obj(text: str, left_out: list[str]) -> str:
    """Return the text of an .obj with triangles only, each of whose corners has a positive index."""
    text = text.replace("\r\n", "\n").replace("\\\n", " ")
    skipped = Counter(re.findall(r"^([lp]|curv2?|surf)\s", text, re.MULTILINE))
    names = {"l": "line", "p": "point", "surf": "free-form surface"}
    left_out += [plural(count, names.get(key, "free-form curve")) for key, count in skipped.items()]
    if not _POLYGON.search(text):
        return text
    lines = text.replace("\t", " ").split("\n")
    keys = np.array([line[:2] for line in lines])
    at = np.flatnonzero(keys == "f ")
    polygons = [lines[k].partition("#")[0].split()[1:] for k in at]
    sizes = np.array([len(polygon) for polygon in polygons])
    words = [word + "/" * (2 - word.count("/")) for polygon in polygons for word in polygon]
    # the numbers of vertex, texture coordinate and normal of each corner, 0 where it has none
    numbers = np.fromstring(" ".join(words).replace("/-", " -").replace("/", " 0"), np.int64, sep=" ").reshape(-1, 3)
    if (numbers < 0).any():  # these count backwards from the face
        before = np.stack([np.cumsum(keys == key) for key in ("v ", "vt", "vn")], axis=1)[at]
        numbers += (numbers < 0) * np.repeat(before + 1, sizes, axis=0)
        words = [f"{v}/{t or ''}/{n or ''}" for v, t, n in numbers.tolist()]
    points = np.array([line.split()[1:4] for line, key in zip(lines, keys, strict=True) if key == "v "], np.float64)
    if numbers[:, 0].min() < 1 or numbers[:, 0].max() > len(points):
        raise ValueError("a face has a corner without a vertex")
    corners, owners = triangulated(points, numbers[:, 0] - 1, sizes)
    words = [word.rstrip("/") for word in words]
    triangles = [f"f {words[a]} {words[b]} {words[c]}" for a, b, c in corners.tolist()]
    ends = np.searchsorted(owners, np.arange(len(at)), side="right").tolist()
    for line, begin, end in zip(at.tolist(), [0, *ends], ends, strict=False):
        lines[line] = "\n".join(triangles[begin:end])
    return "\n".join(lines)


def _load_ply(stream: io.BytesIO, resolver: _Beside, left_out: list[str]) -> trimesh.Scene:
    """Parse a .ply whose polygons may have any number of corners."""
    elements, is_text, picture = ply._parse_header(stream)
    (ply._ply_ascii if is_text else _fill_binary_ply)(elements, stream)
    others = {name: elements.pop(name)["length"] for name in [*elements] if name not in ("vertex", "face")}
    left_out += [f"{plural(length, 'row')} of {name}" for name, length in others.items() if length]
    faces = elements.get("face", {"length": 0})
    if not faces["length"]:
        return trimesh.Scene()
    names, data = faces["properties"], faces["data"]
    indices, sizes = _lists(data[next(name for name in ("vertex_indices", "vertex_index", *names) if name in names)])
    if (sizes != 3).any():
        points = np.column_stack([np.ravel(elements["vertex"]["data"][axis]) for axis in "xyz"]).astype(np.float64)
        corners, owners = triangulated(points, indices, sizes)
        faces["data"] = {"vertex_indices": indices[corners]}
        faces["data"] |= {name: np.ravel(data[name])[owners] for name in ("red", "green", "blue", "alpha") if name in names}
        if "texcoord" in names:  # a pair for each corner of the polygon
            faces["data"]["texcoord"] = _lists(data["texcoord"])[0].reshape(-1, 2)[corners].reshape(-1, 6)
    image = None
    with contextlib.suppress(OSError):  # the resolver notes a missing picture
        image = Image.open(io.BytesIO(resolver.get(picture))) if picture else None
    return trimesh.Scene(trimesh.Trimesh(process=False, **ply._elements_to_kwargs(elements, True, image)))


def _lists(rows: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the lists of a .ply property, one list after the other, and the length of each list."""
    if getattr(getattr(rows, "dtype", None), "names", None):
        rows = rows["f1"]  # trimesh stores binary lists of one length as records of the length and the list
    return np.concatenate(rows), np.array([len(row) for row in rows])


def _fill_binary_ply(elements: dict[str, Any], stream: io.BytesIO) -> None:
    """Read the rows of the elements of a binary .ply. The lists of an element may have several lengths, which trimesh refuses."""
    begin, uniform = stream.tell(), copy.deepcopy(elements)
    try:
        ply._ply_binary(uniform, stream)
        return elements.update(uniform)
    except ValueError:
        stream.seek(begin)
    content, offset = stream.read(), 0
    for element in elements.values():
        # the type of a list's length, if the property is a list, and the type of its numbers
        kinds = {name: [np.dtype(kind) for kind in text.split(", ($LIST,)")] for name, text in element["properties"].items()}
        columns: dict[str, list[np.ndarray]] = {name: [] for name in kinds}
        for _ in range(element["length"]):
            for name, (*size, kind) in kinds.items():
                count = 1
                if size:
                    count = int(np.frombuffer(content, size[0], 1, offset)[0])
                    offset += size[0].itemsize
                if count < 0:
                    raise ValueError(f"a list of {name} has a negative length")
                columns[name].append(np.frombuffer(content, kind, count, offset))
                offset += count * kind.itemsize
        element["data"] = {name: rows if len(kinds[name]) == 2 else np.concatenate(rows) for name, rows in columns.items() if rows}
    if offset != len(content):
        raise ValueError("its length differs from that in its header")


def _plain_glb(content: bytes, left_out: list[str]) -> bytes:
    """Return a .glb whose numbers are stored as trimesh reads them. Raise MeshError for what neither trimesh nor this module reads."""
    magic, _, _, length, kind = struct.unpack("<5I", content[:20])
    if magic != _MAGIC or kind != _JSON:
        raise ValueError("it does not begin as binary glTF")
    document, binary = untrusted_json.load(content[20 : 20 + length]), content[28 + length :]
    for name in [*document.get("extensionsRequired", []), *({INSTANCING} & set(document.get("extensionsUsed", [])))]:
        if name not in DECODED and not name.startswith(LOOKS):
            raise MeshError(f"needs the glTF extension {name}, which RadarTwin does not read; export it without this extension")
    _check_sizes(document, len(content))
    parts = [part for mesh in document.get("meshes", []) for part in mesh["primitives"]]
    if skipped := sum(part.get("mode") in POINTS_OR_LINES for part in parts):
        left_out.append(plural(skipped, "primitive") + " of points or lines")
    if any("KHR_texture_basisu" in texture.get("extensions", {}) and "source" not in texture for texture in document.get("textures", [])):
        left_out.append("its KTX2 pictures, which RadarTwin cannot read; export it with PNG or JPEG")
    if "KHR_texture_transform" in document.get("extensionsUsed", []):
        left_out.append("the shifts of its pictures (KHR_texture_transform)")
    left_out += [f"its {key}" for key in ("skins", "animations") if document.get(key)]
    if any("targets" in part for part in parts):
        left_out.append("its morph targets: the surface has its undeformed shape")
    if "KHR_node_visibility" in document.get("extensionsUsed", []):
        left_out.append("the visibility of its nodes (KHR_node_visibility): hidden nodes are read too")
    accessors, views = document.get("accessors", []), document.setdefault("bufferViews", [])

    def replace(index: int, values: np.ndarray) -> None:
        """Store an accessor anew, at the end of the binary part."""
        nonlocal binary
        accessor = {"bufferView": len(views), "count": len(values), "type": accessors[index]["type"]}
        accessors[index] = accessor | {"componentType": next(number for number, kind in KINDS.items() if kind == values.dtype)}
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        binary += values.tobytes() + bytes(-values.nbytes % 4)

    before = len(views)
    attributes = {(name, number) for part in parts for name, number in part["attributes"].items()}
    floats = {number for name, number in attributes if name.startswith(("POSITION", "NORMAL", "TEXCOORD"))}
    # trimesh takes the low byte of colours of 16 bits
    floats |= {number for name, number in attributes if name.startswith("COLOR") and accessors[number]["componentType"] == USHORT}
    for index, accessor in enumerate(accessors):
        if "sparse" in accessor or (index in floats and accessor["componentType"] != FLOAT):
            values = _numbers(document, binary, accessor)
            replace(index, values.astype("<f4") if index in floats else values)
    for part in [part for part in parts if part.get("mode") == FAN]:
        count = accessors[part["attributes"]["POSITION"]]["count"]
        rim = _numbers(document, binary, accessors[part["indices"]])[:, 0] if "indices" in part else np.arange(count)
        accessors.append({"type": "SCALAR"})
        replace(len(accessors) - 1, np.stack([np.full(len(rim) - 2, rim[0]), rim[1:-1], rim[2:]], axis=1).reshape(-1, 1).astype("<u4"))
        part.update(indices=len(accessors) - 1, mode=TRIANGLES)
    if len(views) == before:
        return content
    document["buffers"][0]["byteLength"] = len(binary)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<5I", _MAGIC, 2, 28 + len(text) + len(binary), len(text), _JSON)
    return head + text + struct.pack("<2I", len(binary), _BINARY) + binary


def _numbers(document: dict[str, Any], binary: bytes, accessor: dict[str, Any]) -> np.ndarray:
    """Return the numbers (count, width) of a glTF accessor, with its sparse part, and normalised integers as fractions of 1."""

    def stored(part: dict[str, Any], count: int, kind: np.dtype, width: int) -> np.ndarray:
        view = document["bufferViews"][part["bufferView"]]
        if view["buffer"] != 0 or "uri" in document["buffers"][0]:
            raise MeshError("keeps quantised or sparse numbers in a second file; export it as one .glb")
        strides = (view.get("byteStride", kind.itemsize * width), kind.itemsize)
        return np.ndarray((count, width), kind, binary, view.get("byteOffset", 0) + part.get("byteOffset", 0), strides).copy()

    count, kind, width = int(accessor["count"]), KINDS[accessor["componentType"]], COUNTS[accessor["type"]]
    if "bufferView" in accessor:
        values = stored(accessor, count, kind, width)
    elif "sparse" in accessor:
        values = np.zeros((count, width), kind)
    else:
        raise MeshError("has quantised numbers in Draco compression; export it without one of the two")
    if sparse := accessor.get("sparse"):
        if sparse["count"] > count:
            raise ValueError("a sparse accessor replaces more numbers than it has")
        places = stored(sparse["indices"], sparse["count"], KINDS[sparse["indices"]["componentType"]], 1)[:, 0]
        values[places] = stored(sparse["values"], sparse["count"], kind, width)
    return np.maximum(values / np.iinfo(kind).max, -1) if accessor.get("normalized") else values


def _check_sizes(document: dict[str, Any], length: int) -> None:
    """Raise MeshError for a .glb that is much larger unpacked than its `length` in bytes, or whose nodes form no tree."""
    sizes = [int(a["count"]) * KINDS[a["componentType"]].itemsize * COUNTS[a["type"]] for a in document.get("accessors", [])]
    meshes = []
    for mesh in document.get("meshes", []):
        accessors = [number for part in mesh["primitives"] for number in (*part["attributes"].values(), part.get("indices"))]
        meshes.append(sum(sizes[number] for number in accessors if number is not None))
    nodes, scenes = document.get("nodes", []), document.get("scenes", [])
    children = [child for node in nodes for child in node.get("children", [])]
    children += scenes[document.get("scene", 0)].get("nodes", []) if scenes else []
    if len(set(children)) < len(children):
        raise MeshError("has a node with two parents, or a cycle of nodes; export it again")
    stored, placed = sum(sizes), sum(meshes[node["mesh"]] for node in nodes if "mesh" in node)
    if stored > 64 * length or placed > MAX_BYTES:
        raise MeshError(f"has {length:,} bytes but would unpack to {max(stored, placed):,} bytes; export it in smaller parts")


def _check_pictures(materials: Iterable[Any], path: Path) -> None:
    """Raise an error for textures with more than MAX_PIXELS pixels. The check reads only the headers of the pictures."""
    textures = (getattr(material, name, None) for material in materials for name in PICTURES)
    pictures = {id(picture): picture for picture in textures if isinstance(picture, Image.Image)}
    pixels = sum(picture.width * picture.height for picture in pictures.values())
    if pixels > MAX_PIXELS:
        raise MeshError(f"{path} has textures of {pixels:,} pixels, over the limit of {MAX_PIXELS:,}; export it with smaller ones")


def _use_plain_colour_without_picture(mesh: trimesh.Trimesh) -> None:
    """Replace a texture without a picture by vertex colours, which all have the plain colour given in the mesh file."""
    visual: Any = mesh.visual
    if visual.kind == "texture" and not any(isinstance(getattr(visual.material, name, None), Image.Image) for name in PICTURES[:2]):
        mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile(visual.material.main_color, (len(mesh.vertices), 1)))
