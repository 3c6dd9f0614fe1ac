"""RadarTwin refuses small files that declare more content than memory holds, with a one-line message and before it allocates memory."""

from __future__ import annotations

import io
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import THREE, photo_index, textured
from made_files import glb
from PIL import Image

from radartwin.errors import InputError, MeshError, RecordingError, ScanError, UserError
from radartwin.io import files, untrusted_json, untrusted_yaml
from radartwin.label.journal import Journal
from radartwin.label.photos import load_photos
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.recognize.model import Recogniser
from radartwin.recognize.own.object_list import read_objects
from radartwin.reconstruct.frames.folder import load_own
from radartwin.reconstruct.frames.pictures import picture_size, read_picture
from radartwin.recordings.mapping import read_mapping
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.mesh_file import read_meshes
from radartwin.scene.scene import Scene


def header(shape: tuple[int, ...], kind: str = "<c8") -> bytes:
    """Return the header of a .npy file that declares an array of this shape and data type."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": kind, "fortran_order": False, "shape": shape})
    return stream.getvalue()


@pytest.mark.parametrize("shape", [(10**14,), (1 << 62,), (10**9, 10**9, 10**9), (1 << 33, 0, 1 << 33, 4)])
def test_arrays_that_declare_more_than_they_hold_are_refused(shape: tuple[int, ...], tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(header(shape) + bytes(64))
    with pytest.raises(RecordingError, match=r"a\.npy"):
        load_capture(tmp_path / "a.npy", Radar.iwr1843())
    if 0 in shape:
        return
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", header(shape) + bytes(64))
    with pytest.raises(InputError, match=r"a\.npz"):
        files.read_arrays(tmp_path / "a.npz")


def png(width: int, height: int) -> bytes:
    """Return a PNG file that declares this size but contains no pixels."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b""))


def test_a_picture_of_billions_of_pixels_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(60_000, 20_000))
    for reader in (read_picture, picture_size):
        with pytest.raises(ScanError, match=r"a\.png.*too many pixels"):
            reader(tmp_path / "a.png")
    (tmp_path / "photos").mkdir()
    (tmp_path / "a.png").rename(tmp_path / "photos" / "a.jpg")
    (tmp_path / "photos.json").write_text(photo_index("photos/a.jpg"))
    with pytest.raises(InputError, match=r"a\.jpg cannot be read"):
        load_photos(tmp_path)[0].pixels()


def test_only_picture_formats_of_scanners_are_read(tmp_path: Path) -> None:
    """The file of this test is an EPS picture, on which Pillow would run Ghostscript."""
    eps = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\nshowpage\n%%EOF\n"
    (tmp_path / "depth_0.png").write_bytes(eps)
    with Image.open(tmp_path / "depth_0.png") as picture:
        assert picture.format == "EPS"
    with pytest.raises(ScanError, match=r"depth_0\.png"):
        read_picture(tmp_path / "depth_0.png")


def test_textures_larger_than_memory_are_refused(tmp_path: Path) -> None:
    picture = png(8_000, 8_000)
    (tmp_path / "a.glb").write_bytes(textured([{"bufferView": 2, "mimeType": "image/png"}] * 18, picture))
    assert (tmp_path / "a.glb").stat().st_size < 100_000
    with pytest.raises(MeshError, match="1,152,000,000 pixels"):
        read_meshes(tmp_path / "a.glb")


@pytest.mark.parametrize("faces", [[0, 1, 2_000_000_000], [0, 1, -1], [0, 1, 3]])
def test_a_face_with_a_missing_vertex_is_refused(faces: list[int], tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    text = head + f"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 {' '.join(map(str, faces))}\n"
    (tmp_path / "a.ply").write_text(text)
    with pytest.raises(MeshError, match=r"a\.ply"):
        read_meshes(tmp_path / "a.ply")


DEEP: dict[str, Callable[[Path], Any]] = {
    "manifest.json": Scene.load,
    "photos.json": load_photos,
    "frames.json": lambda folder: load_own(folder, False),
    "answers.jsonl": lambda folder: Journal(folder / "answers.jsonl"),
    "model.json": Recogniser.load,
}


@pytest.mark.parametrize("name", DEEP)
def test_deeply_nested_json_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "scene.glb").write_bytes(b"")
    (tmp_path / "model.safetensors").write_bytes(b"")
    (tmp_path / name).write_text("[" * 200_000 + "\n")
    with pytest.raises(UserError, match=name.partition(".")[0]) as caught:
        DEEP[name](tmp_path)
    assert "\n" not in str(caught.value)


def test_json_above_the_size_limit_is_refused_before_it_is_parsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(untrusted_json, "MAX_BYTES", 1000)
    with (tmp_path / "a.json").open("wb") as stream:
        stream.truncate(10_000_000_000)  # a sparse file, which is never read as a whole
    with pytest.raises(ValueError, match="more than"):
        untrusted_json.read(tmp_path / "a.json")


def triangles(nodes: list[dict], accessor: dict[str, Any], **more: Any) -> bytes:
    """Return a .glb file with one mesh, which these scene nodes place several times."""
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    start = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
    return glb({**start, "nodes": nodes, "meshes": [mesh], "accessors": [accessor], **more}, bytes(36) if "buffers" in more else b"")


STORED = {"bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}]}
ELSEWHERE = STORED | {"buffers": [{"byteLength": 36, "uri": "../../../../../etc/passwd"}]}
BOMBS = {
    "zeros that take no bytes": triangles([{"mesh": 0}], {"componentType": 5126, "count": 2_000_000_000, "type": "VEC3"}),
    "more than the file holds": triangles([{"mesh": 0}], THREE | {"count": 2_000_000_000}, **STORED),
    "more replacements than numbers": triangles(
        [{"mesh": 0}],
        THREE | {"sparse": {"count": 2_000_000_000, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 1}}},
        bufferViews=[{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteLength": 36, "byteStride": 0}],
        buffers=[{"byteLength": 36}],
    ),
    "nodes that double": triangles([*({"children": [k + 1, k + 1]} for k in range(25)), {"mesh": 0}], THREE, **STORED),
    "nodes in a circle": triangles([{"children": [1]}, {"children": [0], "mesh": 0}], THREE, **STORED),
    "a file elsewhere": triangles([{"mesh": 0}], THREE, **ELSEWHERE),
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_mesh_larger_than_memory_or_with_files_elsewhere_is_refused(bomb: str, tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(BOMBS[bomb])
    started = time.monotonic()
    with pytest.raises(MeshError, match=r"a\.glb"):
        read_meshes(tmp_path / "a.glb")
    assert time.monotonic() - started < 5


LAUGHS = b"a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + b"".join(
    b"a%d: &a%d [%s]\n" % (k, k, b", ".join([b"*a%d" % (k - 1)] * 9)) for k in range(1, 12)
)


@pytest.mark.parametrize("read", [Layout.load, read_mapping, read_objects, Radar.from_file])
def test_yaml_with_aliases_python_objects_or_excessive_size_is_refused(read: Callable[[Path], object], tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    for before in (b"", b"captures:\n  - file: a.bin\n    object: *a11\n", b"objects: *a11\n"):
        file.write_bytes(LAUGHS + before)
        with pytest.raises(UserError, match=r"alias|line 2"):
            read(file)
    for unsafe in (b"!!python/object/apply:os.system [true]\n", b"objects: !!python/name:os.system\n"):
        file.write_bytes(unsafe)
        with pytest.raises(UserError):
            read(file)
    file.write_text("objects: [" + "0, " * (untrusted_yaml.MAX_CHARACTERS // 3) + "0]\n")
    with pytest.raises(UserError, match=r"a\.yaml.*more than [\d,]+ characters"):
        read(file)


def test_an_archive_that_unpacks_to_a_multiple_of_its_size_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", header((0,)) + bytes(200_000_000))
    with pytest.raises(InputError, match=r"bomb\.npz"):
        files.read_arrays(tmp_path / "bomb.npz")
    np.savez(tmp_path / "sound.npz", a=np.zeros(1000))
    assert files.read_arrays(tmp_path / "sound.npz")["a"].shape == (1000,)
