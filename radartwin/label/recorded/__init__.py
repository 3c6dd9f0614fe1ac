"""Answers that were recorded before: with this scene, or shipped for its room.

A recorded answer is found by the digest of the question, which is that of prompt and pictures, or by place: a rescan has other pictures
of the same surfaces, and each takes the answer of the recorded surface it overlaps most. Records of rooms that ship with the package lie
in `ROOM/answers.json` beside this file.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from radartwin.errors import LabelError, MissingError
from radartwin.io.files import write_atomically
from radartwin.label.journal import Journal, Record
from radartwin.label.place import Place, matches
from radartwin.label.questions import Question
from radartwin.label.recorded.digests import DIGESTS
from radartwin.scene.scene import Scene

SHIPPED = Path(__file__).resolve().parent
FORMAT, VERSION = "radartwin-answers", 1
ANSWERS = "answers.json"  # of a room
CHAIR = "arkit_lidar_chair_scan"
SCANS = {"sha256:aa3721d1a49ccb05": CHAIR, "sha256:fd3b6640d1bcd7d2": CHAIR}  # real scans by `scan_of`: its frames, its exported mesh
JOURNAL = Path("labels") / "answers.jsonl"  # in a scene folder


@dataclass(frozen=True)
class Recorded:
    """The provider.

    Args:
        records: what was answered.
        model: only answers of this model; None takes any.
    """

    records: Sequence[Record]
    model: str | None = None
    name: str = "recorded"

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Answers to these very questions, else those of the recorded surfaces in the same place, marked as such by another key."""
        by_key = {record.key: record for record in self._usable()}
        left = []
        for question in questions:
            if question.key in by_key:
                yield question, by_key[question.key]
            else:
                left.append(question)
        for question, record in zip(left, self.by_place([question.place for question in left]), strict=True):
            if record is not None:
                yield question, record

    def by_place(self, places: Sequence[Place]) -> list[Record | None]:
        """For each place, the record of the surface that it overlaps most; None where it overlaps none enough."""
        usable = self._usable()
        found = matches(places, [record.place for record in usable])
        return [None if match is None else usable[match[0]] for match in found]

    def _usable(self) -> list[Record]:
        return [record for record in self.records if self.model is None or record.model == self.model]


def room_of(scene: Scene) -> str | None:
    """The room whose shipped answers may serve a scene: the one it is, or is a scan of; None where none do. File names do not count."""
    told = scene.provenance.get("room") or scene.provenance.get("scan_of")
    room = SCANS.get(str(told), str(told))
    return room if room in DIGESTS else None


def shipped_rooms() -> list[str]:
    """Rooms whose answers come with the package."""
    return sorted(DIGESTS)


@functools.cache
def shipped(room: str) -> tuple[Record, ...]:
    """The records that ship for a room.

    Raises:
        MissingError: none do.
        LabelError: they are damaged, or not the ones that were shipped.
    """
    if room not in DIGESTS:
        rooms = ", ".join(shipped_rooms()) or "no room"
        raise MissingError(f"there are no recorded answers for {room}; they ship for {rooms}")
    path = SHIPPED / room / ANSWERS
    if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != DIGESTS[room]:
        raise LabelError(f"{path} is not the file that ships with this version; install radartwin again, or ship it anew after a change")
    return tuple(load_records(path))


def ship(folders: Path | Sequence[Path], room: str, to: Path = SHIPPED, about: str = "") -> Path:
    """Make the answers that label scene folders the ones that ship for a room: those their manifests name, and their digest.

    Args:
        folders: scene folders of one room labelled by `radartwin label`, one or several scans of it.
        to: where the rooms' folders and digests.py lie.
        about: who answered, when and how, in words.
    Returns:
        The answers.json.
    Raises:
        MissingError: a folder has no answers that its manifest names.
    """
    records = {}
    for folder in [folders] if isinstance(folders, Path) else folders:
        named = {surface.provenance.get("key") for surface in Scene.load(folder)}
        own = [record for record in Journal(folder / JOURNAL).records if record.key[:12] in named]
        if not own:
            raise MissingError(f"{folder} is not labelled by answers of its own; run radartwin label on it first")
        records |= {(record.model, record.key): record for record in own}
    path = save_records(to / room / ANSWERS, room, list(records.values()), about)
    digests = {p.parent.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(to.glob(f"*/{ANSWERS}"))}
    text = (SHIPPED / "digests.py").read_text().partition("\nDIGESTS")[0]
    entries = "".join(f'    "{name}": "{digest}",\n' for name, digest in digests.items())
    write_atomically(to / "digests.py", f"{text}\nDIGESTS: dict[str, str] = {{\n{entries}}}\n")
    return path


def load_records(path: Path) -> list[Record]:
    """Records of an answers.json.

    Raises:
        LabelError: it is none.
    """
    try:
        content = json.loads(path.read_text())
        if content["format"] != FORMAT or content["version"] != VERSION:
            raise KeyError("format")
        return [Record.from_dict(values) for values in content["answers"]]
    except (ValueError, KeyError, TypeError) as error:
        raise LabelError(f"{path} is not a {FORMAT} version {VERSION} file ({error}); record the answers again") from error


def save_records(path: Path, room: str, records: Sequence[Record], about: str = "") -> Path:
    """Write an answers.json, sorted by key so that the same answers are the same bytes; `about` says who answered, when and how."""
    lines = [json.dumps(record.to_dict(), separators=(",", ":")) for record in sorted(records, key=lambda r: (r.key, r.model))]
    head = f'{{"format": "{FORMAT}", "version": {VERSION}, "room": {json.dumps(room)}, "about": {json.dumps(about)}, "answers": [\n'
    return write_atomically(path, head + ",\n".join(lines) + "\n]}\n")


def records_for(scene: Scene, folder: Path | None) -> list[Record]:
    """All records that may answer for a scene: those kept in its folder, then those that ship for its room.

    Raises:
        MissingError: there are neither.
    """
    kept = Journal(folder / JOURNAL).records if folder is not None else []
    room = room_of(scene)
    if room is not None:
        kept += shipped(room)
    if not kept:
        name = scene.provenance.get("room") or Path(str(scene.provenance.get("source") or "this scene")).stem
        if folder is not None:
            raise MissingError(
                f"there are no recorded answers for {name}; ask a model: radartwin label {folder} --provider server, "
                f"or write the questions for any other with radartwin label {folder} --export FOLDER"
            )
        raise MissingError(
            f"materials=vlm has no recorded answers for {name}; use materials=uniform, void or true, or ask a model: "
            "radartwin label SCENE --provider server"
        )
    return kept
