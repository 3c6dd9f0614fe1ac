"""A folder with one changed file is read or refused in one line, within a time limit.

Changes are any value in any place of a JSON tree, replaced words, lost or repeated lines of a text, and changed bytes.
"""

from __future__ import annotations

import io
import json
import re
import struct
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from made_files import log_text, recogniser
from PIL import Image
from test_fuzz import QUICK, TEXTS, changed, glb, reads_or_refuses, with_changes

from radartwin.features.processed import Processed, process
from radartwin.label.answers import Answer
from radartwin.label.journal import Journal, Record
from radartwin.label.labelling import prepare
from radartwin.label.photos import load_photos, save_photos
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recognize.model import Recogniser
from radartwin.reconstruct.frames.folder import load_own, save_frames
from radartwin.reconstruct.frames.formats import load_arkit, load_pose_file, load_tum
from radartwin.reconstruct.frames.frames import Frame, Frames
from radartwin.reconstruct.mesh_file import load_scan
from radartwin.recordings.card import Card
from radartwin.recordings.checks import examine
from radartwin.recordings.index import Row
from radartwin.recordings.recording_set import RecordingSet
from radartwin.recordings.studio_log import read_log
from radartwin.scene import rooms
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.layouts.place import furnish
from radartwin.scene.mesh_file import read_meshes
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.file import read_track

THOROUGH = settings(QUICK, max_examples=60)
CAMERA = np.array([[500.0, 0, 32], [0, 500, 24], [0, 0, 1]])
UPRIGHT = np.array([[0.0, 0, 1, 1], [-1, 0, 0, 1], [0, -1, 0, 1], [0, 0, 0, 1]])  # a camera that looks along +x


def _scene(folder: Path) -> None:
    Scene(rooms.lab().surfaces[:3], {"room": "lab"}).save(folder)


def _labelled(folder: Path) -> None:
    _scene(folder)
    journal = Journal(folder / "answers.jsonl")
    for question in prepare(folder, Scene.load(folder), views=1).questions:
        journal.append(Record.of(question, Answer("wood", 0.5, "grain"), "m", "server"))


def _photos(folder: Path) -> None:
    save_photos(folder, [(np.zeros((8, 8, 3), np.uint8), UPRIGHT, CAMERA)])


def _set(folder: Path) -> None:
    target = RecordingSet.create(folder, Card("set", "MIT", "counts", "IWR1843", "A", "2026"))
    radar = replace(Radar.iwr1843(), num_samples=16, num_chirps=2)
    path = folder.parent / "track.csv"
    path.write_bytes(TEXTS["track.csv"])
    for name, repetition in (("a", 0), ("b", 1)):
        recording = Recording(np.ones((1, 2, 2, 4, 16), np.complex64), radar, scale=1.0, provenance={"unit": "counts"})
        target.add(recording, Row(name, "mug", 1.0, "lab", "turntable", repetition, extra={"start_s": "0"}), path)


def _frames(folder: Path) -> None:
    depth, colour = np.full((48, 64), 2.0, np.float32), np.zeros((48, 64, 3), np.uint8)
    frame = Frame("0", UPRIGHT, CAMERA, depth, colour, CAMERA, np.ones((48, 64), np.uint8))
    save_frames(Frames(["0"], UPRIGHT[None], lambda i: frame, "here", ""), folder)


def _depth(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((48, 64), 2000, np.uint16)).save(path)


def _arkit(folder: Path) -> None:
    _depth(folder / "depth_0.png")
    camera = {"cameraPoseARFrame": np.eye(4).ravel().tolist(), "intrinsics": CAMERA.ravel().tolist()}
    (folder / "frame_0.json").write_text(json.dumps(camera))


def _poses(folder: Path) -> None:
    _depth(folder / "depth" / "0.png")
    _depth(folder / "depth" / "1.png")
    (folder / "pose.txt").write_text("0 0 0 0 0 0 1\n0.1 0 0 0 0 0 1 # the second\n")
    (folder / "intrinsics.json").write_text(json.dumps({"fx": 500.0, "fy": 500.0, "cx": 32.0, "cy": 24.0}))


def _tum(folder: Path) -> None:
    _depth(folder / "depth" / "0.png")
    (folder / "depth.txt").write_text("# time file\n0.0 depth/0.png\n0.1 depth/0.png\n")
    (folder / "groundtruth.txt").write_text("# t x y z q\n0.0 0 0 0 0 0 0 1\n0.1 0.1 0 0 0 0 0 1\n")


def _model(folder: Path) -> None:
    recogniser().save(folder)


def _processed(folder: Path) -> None:
    radar = replace(Radar.iwr1843(), num_samples=32, num_chirps=8)
    noise = np.random.default_rng(0).standard_normal((2, 8, 2, 4, 32)).astype(np.complex64)
    process(Recording(noise, radar)).save(folder)


def _log(folder: Path) -> None:
    (folder / "log.csv").write_text(log_text(100, lost=2))


LAYOUT = {
    "objects": [
        {"object": "mug", "name": "first", "position_m": [2.0, 0.5], "yaw_deg": 30.0},
        {"object": "drink_can_355", "relations": [{"relation": "left of", "anchor": "first", "distance_m": 0.3}]},
        {"object": "corner_reflector", "position_m": [2.0, 1.0, 1.0], "held": True},
    ]
}


def _layout(folder: Path) -> None:
    (folder / "layout.json.yaml").write_text(json.dumps(LAYOUT))
    (folder / "layout.yaml").write_text(yaml.safe_dump(LAYOUT))


def _texts(folder: Path) -> None:
    for name, content in TEXTS.items():
        (folder / name).write_bytes(content)


def _read_layout(path: Path) -> object:
    return furnish(rooms.lab(), Layout.load(path), None)


def _read_frames(frames: Frames) -> object:
    return [frames[i] for i in range(len(frames))]


def _read_set(folder: Path) -> object:
    examine(folder)
    found = RecordingSet.load(folder)
    return [found.read(row) for row in found]


@dataclass(frozen=True)
class Case:
    """A folder, the file that is changed, the kind of change, and the reader."""

    make: Callable[[Path], object]
    file: str
    how: str
    read: Callable[[Path], object]


CASES = [
    Case(_scene, "manifest.json", "json", Scene.load),
    Case(_scene, "scene.glb", "glb", lambda folder: read_meshes(folder / "scene.glb")),
    Case(_scene, "scene.glb", "glb", lambda folder: load_scan(folder / "scene.glb")),
    Case(_labelled, "answers.jsonl", "lines", lambda folder: Journal(folder / "answers.jsonl")),
    Case(_photos, "photos.json", "json", lambda folder: [photo.pixels() for photo in load_photos(folder)]),
    Case(_photos, "photos/00000.jpg", "bytes", lambda folder: [photo.pixels() for photo in load_photos(folder)]),
    Case(_set, "index.csv", "words", _read_set),
    Case(_set, "card.yaml", "words", _read_set),
    Case(_set, "trajectories/a.csv", "words", _read_set),
    Case(_set, "recordings/a.json", "json", _read_set),
    Case(_frames, "frames.json", "json", lambda folder: _read_frames(load_own(folder, False))),
    Case(_frames, "depth/0.png", "bytes", lambda folder: _read_frames(load_own(folder, False))),
    Case(_arkit, "frame_0.json", "json", lambda folder: _read_frames(load_arkit(folder, 0.001, "z", False))),
    Case(_poses, "pose.txt", "words", lambda folder: _read_frames(load_pose_file(folder, None, 0.001, "z", False, "opencv"))),
    Case(_poses, "intrinsics.json", "json", lambda folder: _read_frames(load_pose_file(folder, None, 0.001, "z", False, "opencv"))),
    Case(_tum, "depth.txt", "words", lambda folder: _read_frames(load_tum(folder, (500, 500, 32, 24), 0.001, "z", False, "opencv"))),
    Case(_tum, "groundtruth.txt", "words", lambda folder: _read_frames(load_tum(folder, (500, 500, 32, 24), 0.001, "z", False, "opencv"))),
    Case(_model, "model.json", "json", Recogniser.load),
    Case(_model, "model.safetensors", "bytes", Recogniser.load),
    Case(_processed, "processed.npz", "bytes", Processed.load),
    Case(_processed, "processed.json", "json", Processed.load),
    Case(_log, "log.csv", "words", lambda folder: read_log(folder / "log.csv")),
    Case(_layout, "layout.json.yaml", "json", lambda folder: _read_layout(folder / "layout.json.yaml")),
    Case(_layout, "layout.yaml", "words", lambda folder: _read_layout(folder / "layout.yaml")),
    Case(_texts, "radar.cfg", "words", lambda folder: Radar.from_file(folder / "radar.cfg")),
    Case(_texts, "track.txt", "words", lambda folder: read_track(folder / "track.txt")),
    Case(_texts, "track.csv", "words", lambda folder: read_track(folder / "track.csv")),
]

STRANGE = (
    "nan", "-inf", "1e999", "-1", "0", "1.5", "9" * 40, "true", "null", "x", "", "../x", "/", "'", '"', "\\", "é", "\x00", "- a: [", "{",
)  # fmt: skip
_WORD = re.compile(r"[^\s,:=\[\]{}]+")


def replaced(seed: str) -> st.SearchStrategy[str]:
    """The text with one to three words replaced, or with a line lost or repeated."""
    words, lines = list(_WORD.finditer(seed)), seed.splitlines(keepends=True)

    def put(edits: Sequence[tuple[int, str]]) -> str:
        text = seed
        for at, new in sorted(edits, reverse=True):  # from the end, so that places stay
            text = text[: words[at].start()] + new + text[words[at].end() :]
        return text

    places = st.integers(0, len(words) - 1)
    edits = st.lists(st.tuples(places, st.sampled_from(STRANGE)), min_size=1, max_size=3, unique_by=lambda edit: edit[0]).map(put)
    line = st.integers(0, len(lines) - 1)
    lost = line.map(lambda k: "".join(lines[:k] + lines[k + 1 :]))
    repeated = st.tuples(line, line).map(lambda pair: "".join([*lines[: pair[0]], lines[pair[1]], *lines[pair[0] :]]))
    return edits | lost | repeated


def variants(content: bytes, how: str) -> st.SearchStrategy[bytes]:
    if how == "json":
        return with_changes(json.loads(content)).map(lambda tree: json.dumps(tree).encode())
    if how == "words":
        return replaced(content.decode()).map(str.encode)
    if how == "lines":
        lines = content.decode().splitlines()
        return with_changes(json.loads(lines[0])).map(lambda tree: (json.dumps(tree) + "\n" + "\n".join(lines[1:]) + "\n").encode())
    if how == "glb":
        length = struct.unpack("<I", content[12:16])[0]
        stream = io.BytesIO(content[20 + length :])
        size = struct.unpack("<II", stream.read(8))[0]
        binary = stream.read(size)
        return with_changes(json.loads(content[20 : 20 + length])).map(lambda tree: glb(tree, binary))
    return changed(content)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.make.__name__}-{case.file}-{case.how}")
def test_a_folder_with_a_changed_file_is_read_or_refused(case: Case, tmp_path_factory: pytest.TempPathFactory) -> None:
    whole = tmp_path_factory.mktemp("whole") / "whole"
    whole.mkdir()
    case.make(whole)
    content = {path.relative_to(whole): path.read_bytes() for path in whole.rglob("*") if path.is_file()}
    if not case.file.startswith("radar"):
        case.read(whole)  # the unchanged folder is read

    @THOROUGH
    @given(data=st.data())
    def property(data: st.DataObject) -> None:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "foreign"
            for name, old in content.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(old)
            (folder / case.file).write_bytes(data.draw(variants(content[Path(case.file)], case.how)))
            reads_or_refuses(lambda: case.read(folder))

    property()


def test_replaced_words_change_the_text() -> None:
    seen: set[Any] = set()

    @QUICK
    @given(text=replaced("a: 1, b: [2]\nc: 3\n"))
    def property(text: str) -> None:
        seen.add(text)

    property()
    assert len(seen) > 10
    assert all(text != "a: 1, b: [2]\nc: 3\n" for text in seen if len(text) < 15)
