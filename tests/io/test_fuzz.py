"""Whatever a file holds, its reader returns a value or raises a UserError of one line in time. Quick cases: foreign formats."""

from __future__ import annotations

import json
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import folders
import pytest
from changes import values, variants, with_changes
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from radartwin.errors import UserError
from radartwin.features.processed import Processed
from radartwin.label.answers import read_answer
from radartwin.label.journal import Journal
from radartwin.label.photos import load_photos
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.radar.studio_log import read_log
from radartwin.recognize.model import Recogniser
from radartwin.recognize.own.object_list import read_objects
from radartwin.reconstruct.frames.folder import load_own
from radartwin.reconstruct.frames.frames import Frames
from radartwin.reconstruct.frames.layouts import load_frames
from radartwin.reconstruct.scan_file import load_scan
from radartwin.recordings.examine import examine
from radartwin.recordings.mapping import read_mapping
from radartwin.recordings.recording_set import RecordingSet
from radartwin.scene import rooms
from radartwin.scene.layouts.grammar import parse
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.layouts.place import furnish
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
THOROUGH = settings(QUICK, max_examples=60)
SECONDS, LENGTH = 20, 2000  # longest time of a reader, and longest message


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
    """A valid folder, the name of the file that is changed, the kind of change, and the function that reads the folder."""

    make: Callable[[Path], object]
    file: str
    how: str
    read: Callable[[Path], object]


def _text(name: str, how: str, read: Callable[[Path], object]) -> Case:
    return Case(folders.texts, name, how, lambda folder: read(folder / name))


READERS: dict[Callable[[Path], object], tuple[str, ...]] = {
    Radar.from_file: ("radar.cfg", "radar.mmwave.json", "radar.yaml"),
    read_track: ("track.txt", "track.csv"),
    Layout.load: ("layout.yaml",),
    read_mapping: ("map.yaml",),
    read_meshes: ("a.obj", "a.ply", "a.stl"),
    read_objects: ("objects.yaml",),
}
COMMON = [
    *(_text(name, "bytes", read) for read, names in READERS.items() for name in names),
    _text("radar.mmwave.json", "json", Radar.from_file),
    _text("radar.yaml", "json", Radar.from_file),
    Case(folders.recording, "a.bin", "bytes", lambda folder: Recording.load(folder / "a")),
    Case(folders.recording, "a.json", "json", lambda folder: Recording.load(folder / "a")),
    Case(folders.scene, "manifest.json", "json", Scene.load),
    Case(folders.scene, "scene.glb", "bytes", lambda folder: read_meshes(folder / "scene.glb")),
]
OTHERS = [
    Case(folders.scene, "scene.glb", "glb", lambda folder: read_meshes(folder / "scene.glb")),
    Case(folders.scene, "scene.glb", "glb", lambda folder: load_scan(folder / "scene.glb")),
    Case(folders.labelled_scene, "answers.jsonl", "lines", lambda folder: Journal(folder / "answers.jsonl")),
    Case(folders.photos, "photos.json", "json", lambda folder: [photo.pixels() for photo in load_photos(folder)]),
    Case(folders.photos, "photos/00000.jpg", "bytes", lambda folder: [photo.pixels() for photo in load_photos(folder)]),
    Case(folders.recording_set, "index.csv", "words", _read_set),
    Case(folders.recording_set, "card.yaml", "words", _read_set),
    Case(folders.recording_set, "trajectories/a.csv", "words", _read_set),
    Case(folders.recording_set, "recordings/a.json", "json", _read_set),
    Case(folders.frames, "frames.json", "json", lambda folder: _read_frames(load_own(folder, False))),
    Case(folders.frames, "depth/0.png", "bytes", lambda folder: _read_frames(load_own(folder, False))),
    Case(folders.arkit, "frame_0.json", "json", lambda folder: _read_frames(load_frames(folder, up="z"))),
    Case(folders.pose_file, "pose.txt", "words", lambda folder: _read_frames(load_frames(folder, up="z"))),
    Case(folders.pose_file, "intrinsics.json", "json", lambda folder: _read_frames(load_frames(folder, up="z"))),
    Case(folders.tum, "depth.txt", "words", lambda folder: _read_frames(load_frames(folder, (500, 500, 32, 24), 0.001, "z"))),
    Case(
        folders.tum,
        "groundtruth.txt",
        "words",
        lambda folder: _read_frames(load_frames(folder, (500, 500, 32, 24), 0.001, "z")),
    ),
    Case(folders.model, "model.json", "json", Recogniser.load),
    Case(folders.model, "model.safetensors", "bytes", Recogniser.load),
    Case(folders.processed, "processed.npz", "bytes", Processed.load),
    Case(folders.processed, "processed.json", "json", Processed.load),
    Case(folders.log, "log.csv", "words", lambda folder: read_log(folder / "log.csv")),
    Case(folders.layout, "layout.json.yaml", "json", lambda folder: _read_layout(folder / "layout.json.yaml")),
    Case(folders.layout, "layout.yaml", "words", lambda folder: _read_layout(folder / "layout.yaml")),
    _text("radar.cfg", "words", Radar.from_file),
    _text("track.txt", "words", read_track),
    _text("track.csv", "words", read_track),
]


def _name(case: Case) -> str:
    return f"{case.make.__name__}-{case.file}-{case.how}"


def reads_or_refuses(read: Callable[[], object]) -> None:
    """Check that the reading function returns or raises a UserError with a one-line message, within the time limit."""
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


def check(case: Case, whole: Path, thoroughness: settings) -> None:
    whole.mkdir()
    case.make(whole)
    content = {path.relative_to(whole): path.read_bytes() for path in whole.rglob("*") if path.is_file()}
    case.read(whole)  # the unchanged folder is read

    @thoroughness
    @given(changed=variants(content[Path(case.file)], case.how))
    def property(changed: bytes) -> None:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "foreign"
            for name, old in content.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(old)
            (folder / case.file).write_bytes(changed)
            reads_or_refuses(lambda: case.read(folder))

    property()


@pytest.mark.parametrize("case", COMMON, ids=_name)
def test_a_file_with_any_content_is_read_or_refused(case: Case, tmp_path: Path) -> None:
    check(case, tmp_path / "whole", QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("case", OTHERS, ids=_name)
def test_a_folder_with_a_changed_file_is_read_or_refused(case: Case, tmp_path: Path) -> None:
    check(case, tmp_path / "whole", THOROUGH)


WORDS = ["a", "mug", "1", "m", "in", "front", "of", "the", "table", "two", "boxes", "and", "left", "-3", "nan", "it"]


@QUICK
@given(sentence=st.text(max_size=80) | st.lists(st.sampled_from(WORDS)).map(" ".join))
def test_any_sentence_is_a_layout_or_is_refused(sentence: str) -> None:
    reads_or_refuses(lambda: parse(sentence))


ANSWER = {"material": "wood", "finish": "smooth", "confidence": 0.9, "reason": "x"}


@QUICK
@given(text=st.text(max_size=200) | values.map(json.dumps) | with_changes(ANSWER).map(json.dumps))
def test_any_answer_of_a_model_is_read_or_refused(text: str) -> None:
    for kind in ("surface", "object"):
        reads_or_refuses(lambda kind=kind: read_answer(text, kind))
