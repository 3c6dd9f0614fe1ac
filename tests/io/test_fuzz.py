"""For any content of a file, a reader returns a value or raises a UserError of one line, within a time limit.

Inputs are valid files with bytes changed, cut or repeated, arbitrary bytes, and JSON with wrong values.
"""

from __future__ import annotations

import io
import json
import struct
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_files import studio_json

from radartwin.errors import InputError, MeshError, UserError
from radartwin.label.answers import read_answer
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recordings.mapping import read_mapping
from radartwin.scene import rooms
from radartwin.scene.layouts.grammar import parse
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.mesh_file import read_meshes
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.file import read_track

QUICK = settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
SECONDS, LENGTH = 20, 2000  # longest time of a reader, and longest message

TEXTS = {
    "radar.cfg": b"channelCfg 15 5 0\n"
    b"profileCfg 0 77 7 6 57 0 0 70 1 256 5210 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\nframeCfg 0 0 16 0 100 1 0\n",
    "radar.mmwave.json": studio_json(2).encode(),
    "radar.yaml": json.dumps(Radar.iwr1843().to_dict()).encode(),
    "track.txt": b"# t x y z qx qy qz qw\n0 0 0 1 0 0 0 1\n0.1 0.1 0 1 0 0 0 1\n0.2 0.2 0 1 0 0 0 1\n",
    "track.csv": b"t,x,y,z,yaw_deg\n0,0,0,1,0\n0.1,0.1,0,1,5\n",
    "layout.yaml": b"objects:\n  - object: mug\n    position_m: [2.0, 0.5]\n",
    "map.csv": b"file,object,room\na.bin,mug,lab\n",
    "map.yaml": b"captures:\n  - file: a.bin\n    object: mug\n    room: lab\n",
}
READERS: dict[str, Callable[[Path], Any]] = {
    "radar.cfg": Radar.from_file, "radar.mmwave.json": Radar.from_file, "radar.yaml": Radar.from_file,
    "track.txt": read_track, "track.csv": read_track,
    "layout.yaml": Layout.load, "map.csv": read_mapping, "map.yaml": read_mapping,
}  # fmt: skip

values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


def changed(seed: bytes) -> st.SearchStrategy[bytes]:
    """The seed with bytes replaced or a part cut out; or arbitrary bytes."""

    def apply(edits: list[tuple[int, int, bytes]]) -> bytes:
        content = seed
        for start, length, new in edits:
            at = start % (len(content) + 1)
            content = content[:at] + new + content[at + length % 40 :]
        return content

    edit = st.tuples(
        st.integers(0, 1 << 16), st.integers(0, 39), st.binary(max_size=8) | st.sampled_from([b"nan", b"1e999", b"-1", b"0", b"\n"])
    )
    return st.lists(edit, min_size=1, max_size=4).map(apply) | st.binary(max_size=200)


def reads_or_refuses(read: Callable[[], Any]) -> None:
    """Check that the reader returns, or raises a UserError of one line, in time."""
    started = time.monotonic()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read()
    except UserError as error:
        message = str(error).strip()
        if "\n" in message or len(message) > LENGTH:
            raise AssertionError(f"not one line: {message[:500]}") from error
    assert time.monotonic() - started < SECONDS


def written(name: str, content: bytes, read: Callable[[Path], Any]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        reads_or_refuses(lambda: read(path))


def with_changes(tree: Any) -> st.SearchStrategy[Any]:
    """A JSON tree with one leaf or branch replaced by any value."""
    places = list(_places(tree))

    def put(place: tuple, value: Any) -> Any:
        copy = json.loads(json.dumps(tree))
        node = copy
        for step in place[:-1]:
            node = node[step]
        node[place[-1]] = value
        return copy

    return st.builds(put, st.sampled_from(places), values)


def _places(tree: Any, path: tuple = ()) -> Any:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from _places(value, (*path, key))


@pytest.mark.parametrize("name", TEXTS)
def test_unchanged_text_files_are_read(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(TEXTS[name])
    READERS[name](tmp_path / name)


@pytest.mark.parametrize("name", TEXTS)
@QUICK
@given(data=st.data())
def test_a_text_file_with_any_content_is_read_or_refused(name: str, data: st.DataObject) -> None:
    written(name, data.draw(changed(TEXTS[name])), READERS[name])


@pytest.mark.parametrize("name", ["radar.mmwave.json", "radar.yaml"])
@QUICK
@given(data=st.data())
def test_a_radar_with_any_value_in_any_place_is_read_or_refused(name: str, data: st.DataObject) -> None:
    written(name, json.dumps(data.draw(with_changes(json.loads(TEXTS[name])))).encode(), Radar.from_file)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, dict]:
    """The two files of a small recording."""
    path = tmp_path_factory.mktemp("recording") / "a"
    import dataclasses

    radar = dataclasses.replace(Radar.iwr1843(), num_samples=16, num_chirps=2)
    Recording(np.ones((2, 2, 2, 4, 16), np.complex64), radar, np.eye(4)[None]).save(path)
    return path.with_suffix(".bin").read_bytes(), json.loads(path.with_suffix(".json").read_text())


@QUICK
@given(data=st.data())
def test_a_recording_with_any_content_is_read_or_refused(recording: tuple[bytes, dict], data: st.DataObject) -> None:
    counts, described = recording
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a"
        path.with_suffix(".bin").write_bytes(data.draw(changed(counts) | st.just(counts)))
        path.with_suffix(".json").write_text(json.dumps(data.draw(with_changes(described) | st.just(described))))
        reads_or_refuses(lambda: Recording.load(path))


@QUICK
@given(
    sentence=st.text(max_size=80)
    | st.lists(
        st.sampled_from(["a", "mug", "1", "m", "in", "front", "of", "the", "table", "two", "boxes", "and", "left", "-3", "nan", "it"])
    ).map(" ".join)
)
def test_any_sentence_is_a_layout_or_is_refused(sentence: str) -> None:
    reads_or_refuses(lambda: parse(sentence))


@QUICK
@given(
    text=st.text(max_size=200)
    | values.map(json.dumps)
    | with_changes({"material": "wood", "confidence": 0.9, "reason": "x"}).map(json.dumps)
)
def test_any_answer_of_a_model_is_read_or_refused(text: str) -> None:
    for kind in ("surface", "object"):
        reads_or_refuses(lambda kind=kind: read_answer(text, kind))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, dict]:
    """Geometry and manifest of a small scene."""
    folder = tmp_path_factory.mktemp("scene")
    Scene(rooms.lab().surfaces[:2]).save(folder)
    return (folder / "scene.glb").read_bytes(), json.loads((folder / "manifest.json").read_text())


@QUICK
@given(data=st.data())
def test_a_manifest_with_any_value_in_any_place_is_read_or_refused(scene: tuple[bytes, dict], data: st.DataObject) -> None:
    glb, manifest = scene
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.glb").write_bytes(glb)
        (Path(folder) / "manifest.json").write_text(json.dumps(data.draw(with_changes(manifest))))
        reads_or_refuses(lambda: Scene.load(folder))


@QUICK
@given(data=st.data())
def test_a_mesh_with_any_content_is_read_or_refused(scene: tuple[bytes, dict], data: st.DataObject) -> None:
    for name, content in (("a.glb", scene[0]), ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), ("a.ply", PLY)):
        written(name, data.draw(changed(content)), read_meshes)


PLY = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def glb(document: dict[str, Any], binary: bytes = b"") -> bytes:
    """A binary glTF file with this document."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        body += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body


def triangles(nodes: list[dict], accessors: list[dict], **more: Any) -> dict[str, Any]:
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [mesh],
        "accessors": accessors,
        **more,
    }


THREE = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
STORED = {"bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}]}
BOMBS = {
    "zeros that take no bytes": glb(triangles([{"mesh": 0}], [{"componentType": 5126, "count": 2_000_000_000, "type": "VEC3"}])),
    "more than the file holds": glb(triangles([{"mesh": 0}], [{**THREE, "count": 2_000_000_000}], **STORED), bytes(36)),
    "nodes that double twenty-five times": glb(
        triangles([*({"children": [k + 1, k + 1]} for k in range(25)), {"mesh": 0}], [THREE], **STORED), bytes(36)
    ),
    "nodes in a circle": glb(triangles([{"children": [1]}, {"children": [0], "mesh": 0}], [THREE], **STORED), bytes(36)),
    "a file elsewhere": glb(
        triangles(
            [{"mesh": 0}], [THREE], bufferViews=STORED["bufferViews"], buffers=[{"byteLength": 36, "uri": "../../../../../etc/passwd"}]
        )
    ),
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


@pytest.mark.parametrize("name", ["layout.yaml", "map.yaml", "radar.yaml"])
def test_yaml_with_aliases_or_python_objects_is_refused(name: str, tmp_path: Path) -> None:
    for before in (b"", b"captures:\n  - file: a.bin\n    object: *a11\n", b"objects: *a11\n"):
        (tmp_path / name).write_bytes(LAUGHS + before)
        with pytest.raises(UserError, match=r"alias|line 2"):
            READERS[name](tmp_path / name)
    for unsafe in (b"!!python/object/apply:os.system [true]\n", b"objects: !!python/name:os.system\n"):
        (tmp_path / name).write_bytes(unsafe)
        with pytest.raises(UserError):
            READERS[name](tmp_path / name)


def test_an_archive_that_unpacks_to_a_multiple_of_its_size_is_refused(tmp_path: Path) -> None:
    from radartwin.io.files import read_arrays

    header = io.BytesIO()
    np.save(header, np.zeros(0))
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", header.getvalue() + bytes(200_000_000))
    with pytest.raises(InputError, match=r"bomb\.npz"):
        read_arrays(tmp_path / "bomb.npz")
    np.savez(tmp_path / "sound.npz", a=np.zeros(1000))
    assert read_arrays(tmp_path / "sound.npz")["a"].shape == (1000,)


@pytest.mark.parametrize("key", ["scene", "radar", "hydra.launcher", "hydra.callbacks.x", "experiment"])
@pytest.mark.parametrize("word", ["os.system", "radartwinx.run"])
def test_a_configuration_cannot_name_code_outside_radartwin(key: str, word: str) -> None:
    from radartwin.config.compose import compose
    from radartwin.errors import ConfigError
    from radartwin.runs.launchers import Launcher

    override = f"+{key}._target_={word}"
    if key.startswith("hydra"):
        with pytest.raises(ConfigError, match="_target_"):
            Launcher([override if "callbacks" in key else f"{key}._target_={word}"], (), Path("unused"))
    else:
        with pytest.raises(ConfigError):
            compose([override])
