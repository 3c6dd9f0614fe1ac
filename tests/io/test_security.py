"""Malicious files are refused in one line. None of their code runs, and no file outside their folder is read or written.

Each file here is well formed. Damaged files are in test_fuzz.py.
"""

from __future__ import annotations

import ast
import io
import json
import logging
import os
import pickle
import socket
import struct
import subprocess
import sys
import threading
import zipfile
import zlib
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from test_fuzz import THREE, glb

from radartwin.config.compose import Composer
from radartwin.config.study import TrackingConfig
from radartwin.errors import BackendError, ConfigError, InputError, LabelError, MeshError, OutputError, RecordingError, ScanError, UserError
from radartwin.io import files, secret, untrusted_json
from radartwin.io.chat import Endpoint
from radartwin.label.journal import Journal
from radartwin.label.photos import load_photos
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.recognize.model import Recogniser
from radartwin.reconstruct.frames.folder import load_own
from radartwin.reconstruct.frames.formats import load_tum
from radartwin.reconstruct.frames.pictures import picture_size, read_picture
from radartwin.runs.experiment import read
from radartwin.runs.launchers import Launcher
from radartwin.runs.tracking import Tracker
from radartwin.scene import rooms
from radartwin.scene.mesh_file import TextureWarning, read_meshes
from radartwin.scene.scene import Scene
from radartwin.scene.viewer.page import view
from radartwin.store.products import Product, Store, save_json

ROOT = Path(__file__).resolve().parents[2]
OWNED = "owned"
KEY = "s3cr3t-w0rd-of-the-test"


class Evil:
    """A pickle of this object calls `open` when it is read."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return open, (str(self.mark), "w")


@pytest.fixture
def mark(tmp_path: Path) -> Iterator[Path]:
    """A file that exists if the code of an attack has run."""
    path = tmp_path / OWNED
    pickle.loads(pickle.dumps(Evil(path))).close()
    assert path.exists(), "the attack does not work, so the test shows nothing"
    path.unlink()
    yield path
    assert not path.exists(), "the code of the attack has run"


# --- code ---------------------------------------------------------------------------------------------------------------

FORBIDDEN = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "tarfile"}
CALLS = {"eval", "exec", "compile", "__import__"}


@pytest.mark.parametrize("package", ["radartwin", "experiments", "analysis"])
def test_no_module_unpickles_evaluates_text_or_calls_a_shell(package: str) -> None:
    for path in sorted((ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            where = f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = {alias.name.partition(".")[0] for alias in node.names} | {str(getattr(node, "module", "")).partition(".")[0]}
                assert not names & FORBIDDEN, where
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
            assert called not in CALLS, where
            assert given.get("shell", "False") == "False", where
            if called in ("np.load", "numpy.load"):
                assert given.get("allow_pickle") == "False", where
            if called.startswith("yaml.") and "load" in called:
                assert called == "yaml.load", where
                assert "loader" in ast.unparse(node.args[1]), where
            if called.endswith(".from_pretrained") and "Model" in called:
                assert given.get("use_safetensors") == "True", where
            assert called not in ("torch.load", "pyfunc.load_model", "mlflow.pyfunc.load_model", "os.system", "os.popen"), where
            assert "trust_remote_code" not in given, where


def test_arrays_of_objects_are_not_unpickled(tmp_path: Path, mark: Path) -> None:
    array = np.array([Evil(mark)], dtype=object)
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    np.savez(tmp_path / "a.npz", a=array)
    with pytest.raises(InputError, match=r"a\.npz"):
        files.read_arrays(tmp_path / "a.npz")
    with pytest.raises(RecordingError, match=r"a\.npy"):
        load_capture(tmp_path / "a.npy", Radar.iwr1843())
    (tmp_path / "b.npy").write_bytes(pickle.dumps(Evil(mark)))
    with pytest.raises(RecordingError, match=r"b\.npy"):
        load_capture(tmp_path / "b.npy", Radar.iwr1843())


def test_a_pickle_is_refused_as_a_model(tmp_path: Path, mark: Path) -> None:
    (tmp_path / "model.json").write_text(json.dumps({"format": "radartwin recogniser 1", "sha256": "0"}))
    (tmp_path / "model.safetensors").write_bytes(pickle.dumps(Evil(mark)))
    with pytest.raises(InputError, match="not a usable model"):
        Recogniser.load(tmp_path)
    import hashlib

    content = pickle.dumps(Evil(mark))
    described = json.loads((tmp_path / "model.json").read_text()) | {"sha256": hashlib.sha256(content).hexdigest()}
    (tmp_path / "model.json").write_text(json.dumps(described))
    with pytest.raises(InputError, match="not a usable model"):
        Recogniser.load(tmp_path)


@pytest.mark.parametrize(
    "node",
    [
        {"job_logging": {"version": 1, "handlers": {"x": {"()": "os.open", "path": OWNED, "flags": 65}}, "root": {"handlers": ["x"]}}},
        {"job_logging": {"version": 1, "handlers": {"x": {"class": "logging.os.open", "path": OWNED, "flags": 65}}}},
        {"hydra_logging": {"version": 1, "filters": {"x": {"()": "ext://os.open"}}}},
        {"job": {"env_set": {"PYTHONPATH": "/tmp/evil"}}},
        {"launcher": {"_target_": "radartwin.runs.dashboard.subprocess.Popen"}},
        {"launcher": {"_target_": "radartwin.runs.dashboard.os.system"}},
        {"callbacks": {"x": {"_target_": "os.system"}}},
        {"sweeper": {"_target_": "builtins.exec"}},
    ],
)
def test_an_experiment_file_cannot_make_hydra_call_code(node: dict[str, Any], tmp_path: Path, mark: Path) -> None:
    (tmp_path / "experiment").mkdir()
    content = {"experiment": {"name": "evil", "module": "evil"}, "hydra": node}
    (tmp_path / "experiment" / "evil.yaml").write_text(f"# @package _global_\n{json.dumps(content).replace(OWNED, str(mark))}\n")
    with pytest.raises(ConfigError, match="refused"):
        Composer([tmp_path]).compose(["experiment=evil", "seed=1"])


def test_known_launchers_are_accepted(tmp_path: Path) -> None:
    handlers = list(logging.getLogger().handlers)
    for launcher in ("basic", "joblib", "slurm", "submitit_local"):
        Launcher([f"hydra/launcher={launcher}"], (), tmp_path)
    Launcher(["hydra/job_logging=default", "hydra/hydra_logging=default"], (), tmp_path)
    assert logging.getLogger().handlers == handlers


# --- memory -------------------------------------------------------------------------------------------------------------


def header(shape: tuple[int, ...], kind: str = "<c8") -> bytes:
    """A .npy header with this shape."""
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


def test_an_archive_in_place_of_a_cube_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.zeros(3))
    (tmp_path / "a.npz").rename(tmp_path / "a.npy")
    with pytest.raises(RecordingError, match=r"a\.npy"):
        load_capture(tmp_path / "a.npy", Radar.iwr1843())


def png(width: int, height: int) -> bytes:
    """A black picture whose file has a thousandth of its number of pixels in bytes."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(1 + width // 8 + 1)) for _ in range(height)) + packer.flush()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)) + chunk(b"IDAT", rows)


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
    """Pillow would run Ghostscript on this file."""
    eps = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\nshowpage\n%%EOF\n"
    (tmp_path / "depth_0.png").write_bytes(eps)
    with Image.open(tmp_path / "depth_0.png") as picture:
        assert picture.format == "EPS"
    with pytest.raises(ScanError, match=r"depth_0\.png"):
        read_picture(tmp_path / "depth_0.png")


def textured(images: list[dict[str, Any]], picture: bytes) -> bytes:
    """A .glb of triangles, each with one of these images; `picture` follows the geometry."""
    count, places = len(images), np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    return glb(
        {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(count))}],
            "nodes": [{"mesh": i} for i in range(count)],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": i}]} for i in range(count)],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(count)],
            "textures": [{"source": i} for i in range(count)], "images": images,
            "accessors": [THREE, {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}],
            "bufferViews": [
                {"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24},
                {"buffer": 0, "byteOffset": 60, "byteLength": len(picture)},
            ],
            "buffers": [{"byteLength": 60 + len(picture)}],
        },
        places + bytes(24) + picture + bytes(-len(picture) % 4),
    )  # fmt: skip


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


BRACKETS = "[" * 200_000
DEEP: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "manifest.json": (BRACKETS, Scene.load),
    "photos.json": (BRACKETS, load_photos),
    "frames.json": (BRACKETS, lambda folder: load_own(folder, False)),
    "answers.jsonl": (BRACKETS + "\n", lambda folder: Journal(folder / "answers.jsonl")),
    "model.json": (BRACKETS, Recogniser.load),
}


@pytest.mark.parametrize("name", DEEP)
def test_deeply_nested_json_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    content, reader = DEEP[name]
    (tmp_path / "scene.glb").write_bytes(b"")
    (tmp_path / "model.safetensors").write_bytes(b"")
    (tmp_path / name).write_text(content)
    with pytest.raises(UserError, match=name.partition(".")[0]) as caught:
        reader(tmp_path)
    assert "\n" not in str(caught.value)


def test_json_above_the_size_limit_is_refused_before_it_is_parsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(untrusted_json, "MAX_BYTES", 1000)
    with (tmp_path / "a.json").open("wb") as stream:
        stream.truncate(10_000_000_000)  # a sparse file, which is never read as a whole
    with pytest.raises(ValueError, match="more than"):
        untrusted_json.read(tmp_path / "a.json")


# --- files elsewhere ----------------------------------------------------------------------------------------------------


def photo_index(file: str) -> str:
    entry = {"file": file, "pose": np.eye(4).tolist(), "intrinsics": np.eye(3).tolist()}
    return json.dumps({"format": "radartwin-photos", "version": 1, "photos": [entry]})


def frame_index(folder: Path, name: str) -> None:
    frame = {"name": "0", "pose": np.eye(4).tolist(), "intrinsics": np.eye(3).tolist(), "colour_intrinsics": None}
    frame |= {"depth": name, "colour": None, "confidence": None}
    content = {"format": "radartwin-frames", "version": 1, "depth_unit_m": 0.001, "frames": [frame]}
    (folder / "frames.json").write_text(json.dumps(content))


def tum_folder(folder: Path, name: str) -> None:
    (folder / "depth.txt").write_text(f"0.0 {name}\n")
    (folder / "groundtruth.txt").write_text("0.0 0 0 0 0 0 0 1\n")


INDICES: dict[str, tuple[Callable[[Path, str], object], Callable[[Path], object]]] = {
    "photos.json": (lambda folder, name: (folder / "photos.json").write_text(photo_index(name)), load_photos),
    "frames.json": (frame_index, lambda folder: load_own(folder, False)),
    "depth.txt": (tum_folder, lambda folder: load_tum(folder, (500, 500, 320, 240), 0.0002, "z", False, "opencv")),
}


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("path", ["up", "root", "link"])
def test_an_index_cannot_name_a_file_outside_its_folder(index: str, path: str, tmp_path: Path) -> None:
    write, reader = INDICES[index]
    folder, private = tmp_path / "foreign", tmp_path / "private.png"
    folder.mkdir()
    Image.fromarray(np.full((480, 640), 2000, np.uint16)).save(private)
    (folder / "link.png").symlink_to(private)
    write(folder, {"up": "../private.png", "root": str(private), "link": "link.png"}[path])
    with pytest.raises(UserError, match="which is not in it"):
        reader(folder)


@pytest.mark.parametrize("uri", ["../private.png", "{private}", "file://{private}", "link.png"])
def test_a_mesh_reads_no_picture_outside_its_folder(uri: str, tmp_path: Path) -> None:
    folder, private = tmp_path / "foreign", tmp_path / "private.png"
    folder.mkdir()
    Image.fromarray(np.full((8, 8, 3), 77, np.uint8)).save(private)
    (folder / "link.png").symlink_to(private)
    (folder / "a.glb").write_bytes(textured([{"uri": uri.format(private=private)}], b""))
    (folder / "b.mtl").write_text(f"newmtl m\nmap_Kd {uri.format(private=private)}\n")
    (folder / "b.obj").write_text("mtllib b.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    for name in ("a.glb", "b.obj"):
        with pytest.warns(TextureWarning):
            (mesh,) = read_meshes(folder / name).values()
        visual: Any = mesh.visual
        material = getattr(visual, "material", None)
        assert getattr(material, "baseColorTexture", None) is None
        assert visual.kind == "vertex"  # the plain colour of the material
        assert getattr(material, "image", None) is None


def test_a_mesh_with_a_device_as_material_file_is_read_without_materials(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib /dev/zero\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.warns(UserWarning, match="/dev/zero"):
        assert len(read_meshes(tmp_path / "a.obj")) == 1


def test_a_journal_behind_a_link_does_not_change_the_linked_file(tmp_path: Path) -> None:
    thesis = tmp_path / "thesis"
    thesis.write_bytes(b"years of work without a line's end")
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "answers.jsonl").symlink_to(thesis)
    with pytest.raises(LabelError, match="is a link"):
        Journal(tmp_path / "scene" / "answers.jsonl")
    assert thesis.read_bytes() == b"years of work without a line's end"


def test_locks_and_writes_do_not_follow_links(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    (tmp_path / "lock").symlink_to(victim)
    with pytest.raises(OutputError, match="lock"), files.lock(tmp_path / "lock"):
        pass
    with pytest.raises(OutputError, match="lock"):
        files.drop_stale(tmp_path / "lock")
    target = tmp_path / "manifest.json"
    files.unfinished(target).symlink_to(victim)
    files.write_atomically(target, "mine")
    assert target.read_text() == "mine"
    assert not target.is_symlink()
    assert not victim.exists()


@pytest.mark.parametrize("name", ["../../../x", "/x", "a\0b"])
def test_a_foreign_cache_cannot_name_files_outside_its_folder(name: str, tmp_path: Path) -> None:
    content = {"table": "t", "rows": [], "metrics": {}, "keys": [], "figures": [name], "models": []}
    save_json(tmp_path, "result", content)
    with pytest.raises(InputError, match="not the result of a run"):
        read(Product(tmp_path, "0" * 32, True))
    from analysis.main import report_verb

    (tmp_path / "tables").mkdir()
    index = {"environment": {"run_key": "0", "profile": "quick", "figures": [name]}}
    (tmp_path / "tables" / "index.json").write_text(json.dumps(index))
    with pytest.raises(InputError, match="damaged"):
        report_verb(tmp_path)


def test_a_product_with_a_link_is_built_again(tmp_path: Path) -> None:
    private, spec = tmp_path / "private", {"seed": 1}
    private.write_text("of the user")
    build: Callable[[Path], object] = lambda folder: save_json(folder, "note", {"a": 1})  # noqa: E731
    product = Store(tmp_path / "cache").fetch("recording", spec, ["radartwin.constants"], build)
    (product.path / "stolen").symlink_to(private)
    again = Store(tmp_path / "cache").fetch("recording", spec, ["radartwin.constants"], build)
    assert not again.reused
    assert sorted(path.name for path in again.path.iterdir()) == ["meta.json", "note.json"]
    assert private.read_text() == "of the user"


# --- pages and terminals ------------------------------------------------------------------------------------------------


def test_names_of_a_scene_are_escaped_in_its_page(tmp_path: Path) -> None:
    from dataclasses import replace

    nasty = "</script><script>alert(1)</script>"
    surfaces = [replace(surface, name=nasty, provenance={"source": nasty}) for surface in rooms.lab().surfaces[:2]]
    view(Scene(surfaces, {"room": nasty}), tmp_path / "view.html")
    assert "<script>alert" not in (tmp_path / "view.html").read_text()


def test_a_file_name_sends_no_control_characters(inside: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    done = inside("process", "\x1b]0;owned\x07\x1b[2J.bin")
    assert done.returncode == 2
    assert "\x1b" not in done.stderr
    assert "\x07" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


# --- keys ---------------------------------------------------------------------------------------------------------------


class _Echo(BaseHTTPRequestHandler):
    """A server that repeats the received key in its refusal or its answer."""

    status = 401
    location = ""

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        key = self.headers.get("Authorization", "")
        answer = {"choices": [{"message": {"content": f"{{key: {key}}}"}}], "error": f"Incorrect API key provided: {key}"}
        content = json.dumps(answer).encode()
        self.send_response(self.status)
        if self.location:
            self.send_header("Location", self.location)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    do_GET = do_POST

    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture
def echo() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), _Echo) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


def test_a_key_that_the_server_repeats_is_hidden_in_messages_and_answers(echo: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADARTWIN_LLM_KEY", KEY)
    endpoint = Endpoint(f"{echo}/v1", "m")
    with pytest.raises(BackendError, match="401") as caught:
        endpoint.complete([], {}, "x")
    assert KEY not in str(caught.value)
    assert secret.HIDDEN in str(caught.value)
    monkeypatch.setattr(_Echo, "status", 200)
    assert endpoint.complete([], {}, "x") == "{key: Bearer ***}"


def test_the_key_is_not_sent_to_the_target_of_a_redirection(echo: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as elsewhere:
        elsewhere.setblocking(False)
        monkeypatch.setenv("RADARTWIN_LLM_KEY", KEY)
        monkeypatch.setattr(_Echo, "status", 307)
        monkeypatch.setattr(_Echo, "location", f"http://127.0.0.1:{elsewhere.getsockname()[1]}/v1/chat/completions")
        with pytest.raises(BackendError, match="307"):
            Endpoint(f"{echo}/v1", "m").complete([], {}, "x")
        with pytest.raises(BlockingIOError):  # no connection was made
            elsewhere.accept()


@pytest.mark.parametrize("ending", ["\n", " ", "\r\n"])
def test_white_space_after_a_key_is_not_sent(echo: str, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADARTWIN_LLM_KEY", KEY + ending)
    monkeypatch.setattr(_Echo, "status", 200)
    assert Endpoint(f"{echo}/v1", "m").complete([], {}, "x") == "{key: Bearer ***}"


@pytest.mark.parametrize("bad", [KEY[:8] + "\n" + KEY[8:], KEY + "é", KEY + "\x07"])
def test_an_invalid_key_is_refused_and_not_printed(bad: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADARTWIN_LLM_KEY", bad)
    with pytest.raises(ConfigError, match="RADARTWIN_LLM_KEY") as caught:
        Endpoint("http://127.0.0.1:9/v1", "m").complete([], {}, "x")
    assert KEY[:8] not in str(caught.value)


@pytest.mark.parametrize("token", [KEY, f"{KEY}\n"])
def test_the_token_of_the_tracking_server_is_in_no_message(echo: str, token: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_TOKEN", token)
    with pytest.raises(BackendError) as caught:
        Tracker(TrackingConfig(uri=echo), tmp_path).prepare()
    assert KEY not in str(caught.value)


@pytest.mark.parametrize("source", ["file", "override"])
def test_a_configuration_cannot_carry_a_key_into_the_results(source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADARTWIN_VLM_KEY", KEY)
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "evil.yaml").write_text(
        "# @package _global_\nexperiment: {name: '${oc.env:RADARTWIN_VLM_KEY}', module: evil}\n"
    )
    overrides = ["experiment=evil"] if source == "file" else [f"output=runs-{KEY}"]
    with pytest.raises(ConfigError, match="holds a secret of the environment") as caught:
        Composer([tmp_path]).compose(overrides)
    assert KEY not in str(caught.value)


def test_messages_of_the_command_line_hide_keys(tmp_path: Path) -> None:
    environment = {**os.environ, "RADARTWIN_VLM_KEY": KEY, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "radartwin", "process", f"{KEY}.bin"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 2
    assert KEY not in done.stdout + done.stderr
