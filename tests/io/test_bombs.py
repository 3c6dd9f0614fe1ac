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


def archive(content: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.npy", content)
    return stream.getvalue()


def png(width: int, height: int) -> bytes:
    """Return a PNG file that declares this size but contains no pixels."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b""))


def ply(*corners: int) -> bytes:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    return f"{head}property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 {' '.join(map(str, corners))}\n".encode()


def triangles(nodes: list[dict], accessor: dict[str, Any], **more: Any) -> bytes:
    """Return a .glb file with one mesh, which these scene nodes place several times."""
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    start = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
    return glb({**start, "nodes": nodes, "meshes": [mesh], "accessors": [accessor], **more}, bytes(36) if "buffers" in more else b"")


STORED = {"bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}]}
ELSEWHERE = STORED | {"buffers": [{"byteLength": 36, "uri": "../../../../../etc/passwd"}]}
TWO_VIEWS = {
    "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteLength": 36, "byteStride": 0}], "buffers": [{"byteLength": 36}],
}  # fmt: skip
SPARSE = {"count": 2_000_000_000, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 1}}
EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\nshowpage\n%%EOF\n"  # Pillow would run Ghostscript on it
Reader = Callable[[Path], object]
PIXELS = "too many pixels"
# The reader, its error, the suffix of the file, a word of the message, and the file.
SMALL_FILES: list[tuple[Reader, type[UserError], str, str, bytes]] = [
    *(
        (lambda path: load_capture(path, Radar.iwr1843()), RecordingError, ".npy", "", header(shape) + bytes(64))
        for shape in ((10**14,), (1 << 62,), (10**9, 10**9, 10**9), (1 << 33, 0, 1 << 33, 4))
    ),
    (files.read_arrays, InputError, ".npz", "", archive(header((10**14,)) + bytes(64))),
    *((read, ScanError, ".png", PIXELS, png(60_000, 20_000)) for read in (read_picture, picture_size)),
    (read_picture, ScanError, ".png", "", EPS),
    *((read_meshes, MeshError, ".ply", "", ply(*corners)) for corners in ((0, 1, 2_000_000_000), (0, 1, -1), (0, 1, 3))),
    *(
        (read_meshes, MeshError, ".glb", word, content)
        for word, content in (
            ("1,152,000,000 pixels", textured([{"bufferView": 2, "mimeType": "image/png"}] * 18, png(8_000, 8_000))),
            ("", triangles([{"mesh": 0}], {"componentType": 5126, "count": 2_000_000_000, "type": "VEC3"})),  # zeros that take no bytes
            ("", triangles([{"mesh": 0}], THREE | {"count": 2_000_000_000}, **STORED)),  # more than the file holds
            ("", triangles([{"mesh": 0}], THREE | {"sparse": SPARSE}, **TWO_VIEWS)),  # more replacements than numbers
            ("", triangles([*({"children": [k + 1, k + 1]} for k in range(25)), {"mesh": 0}], THREE, **STORED)),  # nodes that double
            ("", triangles([{"children": [1]}, {"children": [0], "mesh": 0}], THREE, **STORED)),  # nodes in a circle
            ("", triangles([{"mesh": 0}], THREE, **ELSEWHERE)),
        )
    ),
]


@pytest.mark.parametrize(("read", "error", "suffix", "word", "content"), SMALL_FILES, ids=range(len(SMALL_FILES)))
def test_a_small_file_that_declares_too_much_is_refused_at_once(
    read: Reader, error: type[UserError], suffix: str, word: str, content: bytes, tmp_path: Path
) -> None:
    (tmp_path / f"a{suffix}").write_bytes(content)
    assert len(content) < 100_000
    started = time.process_time()
    with pytest.raises(error, match=rf"(?=.*a\{suffix}).*{word}"):
        read(tmp_path / f"a{suffix}")
    assert time.process_time() - started < 5


def test_photographs_and_archives_that_unpack_to_much_more_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(png(60_000, 20_000))
    (tmp_path / "photos.json").write_text(photo_index("a.jpg"))
    with pytest.raises(InputError, match=r"a\.jpg cannot be read"):
        load_photos(tmp_path)[0].pixels()
    (tmp_path / "bomb.npz").write_bytes(archive(header((0,)) + bytes(200_000_000)))
    with pytest.raises(InputError, match=r"bomb\.npz"):
        files.read_arrays(tmp_path / "bomb.npz")
    np.savez(tmp_path / "sound.npz", a=np.zeros(1000))
    assert files.read_arrays(tmp_path / "sound.npz")["a"].shape == (1000,)


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
