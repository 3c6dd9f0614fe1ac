"""Whatever a file holds, its reader returns a value or raises a UserError of one line in time. Quick cases: foreign formats."""

from __future__ import annotations

import json
import random
import re
import shutil
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import folders
import pytest

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

QUICK, THOROUGH = 25, 60  # number of changed versions of a file
SECONDS, LENGTH = 20, 2000  # longest time of a reader, and longest message


STRANGE = (
    "nan", "-inf", "1e999", "-1", "0", "1.5", "9" * 40, "true", "null", "x", "", "../x", "/", "'", '"', "\\", "é", "\x00", "- a: [", "{",
)  # fmt: skip
VALUES = (None, True, 0, -1, 1.5, float("nan"), float("inf"), 10**40, "", "x", "../x", "\x00", [], [None, [0]], {}, {"": {"x": [1e300]}})


def bytes_changed(content: bytes, draw: random.Random) -> bytes:
    """Return the content with up to four parts replaced or cut out, or arbitrary bytes."""
    if draw.random() < 0.1:
        return draw.randbytes(draw.randrange(200))
    for _ in range(draw.randint(1, 4)):
        at = draw.randrange(len(content) + 1)
        new = draw.choice([b"", b"nan", b"1e999", b"-1", b"0", b"\n", draw.randbytes(draw.randint(1, 8))])
        content = content[:at] + new + content[at + draw.randrange(40) :]
    return content


def words_changed(content: bytes, draw: random.Random) -> bytes:
    """Return the text with up to three words replaced, or with a line removed or repeated."""
    text, lines = content.decode(), content.decode().splitlines(keepends=True)
    if draw.random() < 0.3:
        lines.insert(draw.randrange(len(lines)), lines[draw.randrange(len(lines))])
        return "".join(lines if draw.random() < 0.5 else lines[: draw.randrange(len(lines))] + lines[-1:]).encode()
    for word in sorted(draw.sample(found := list(re.finditer(r"[^\s,:=\[\]{}]+", text)), min(3, len(found))), key=lambda w: -w.start()):
        text = text[: word.start()] + draw.choice(STRANGE) + text[word.end() :]
    return text.encode()


def places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Return each list or mapping of a JSON tree with each of its keys."""
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ():
        yield tree, key
        yield from places(value)


def json_changed(content: bytes, draw: random.Random) -> bytes:
    """Return the JSON tree (of the first line, if there are several) with one leaf or branch replaced."""
    tree = json.loads(content)
    node, key = draw.choice(list(places(tree)))
    node[key] = draw.choice(VALUES)
    return json.dumps(tree).encode()


def first_line_changed(content: bytes, draw: random.Random) -> bytes:
    first, rest = content.split(b"\n", 1)
    return json_changed(first, draw) + b"\n" + rest


def glb_changed(content: bytes, draw: random.Random) -> bytes:
    """Change the JSON tree inside a binary glTF file, padded to the length of the file's own."""
    length = int.from_bytes(content[12:16], "little")
    tree = json_changed(content[20 : 20 + length].rstrip(b" "), draw)
    tree += b" " * (-len(tree) % 4)
    body = len(tree).to_bytes(4, "little") + content[16:20] + tree + content[20 + length :]
    return content[:8] + (12 + len(body)).to_bytes(4, "little") + body


CHANGES = {"bytes": bytes_changed, "words": words_changed, "json": json_changed, "lines": first_line_changed, "glb": glb_changed}


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
    Case(folders.tum, "groundtruth.txt", "words", lambda folder: _read_frames(load_frames(folder, (500, 500, 32, 24), 0.001, "z"))),
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


def check(case: Case, tmp_path: Path, count: int) -> None:
    whole, draw = tmp_path / "whole", random.Random(0)
    whole.mkdir()
    case.make(whole)
    case.read(whole)  # the unchanged folder is read
    for number in range(count):
        folder = shutil.copytree(whole, tmp_path / f"changed{number}")
        (folder / case.file).write_bytes(CHANGES[case.how]((whole / case.file).read_bytes(), draw))
        reads_or_refuses(lambda folder=folder: case.read(folder))


@pytest.mark.parametrize("case", COMMON, ids=_name)
def test_a_file_with_any_content_is_read_or_refused(case: Case, tmp_path: Path) -> None:
    check(case, tmp_path, QUICK)


@pytest.mark.slow
@pytest.mark.parametrize("case", OTHERS, ids=_name)
def test_a_folder_with_a_changed_file_is_read_or_refused(case: Case, tmp_path: Path) -> None:
    check(case, tmp_path, THOROUGH)


WORDS = ("a", "mug", "1", "m", "in", "front", "of", "the", "table", "two", "boxes", "and", "left", "-3", "nan", "it")
ANSWER = b'{"material": "wood", "finish": "smooth", "confidence": 0.9, "reason": "x"}'


def test_any_sentence_and_any_answer_of_a_model_is_read_or_refused() -> None:
    draw = random.Random(0)
    for change in (bytes_changed, json_changed):
        for _ in range(QUICK):
            text = change(ANSWER, draw).decode("latin-1")
            for kind in ("surface", "object"):
                reads_or_refuses(lambda text=text, kind=kind: read_answer(text, kind))
            sentence = " ".join(draw.choices(WORDS, k=draw.randrange(12)))
            reads_or_refuses(lambda sentence=sentence, text=text: (parse(sentence), parse(text)))
