"""Answers that were recorded before: with this scene, or shipped for its room.

A recorded answer is found by the digest of the question, which is that of prompt and pictures, or by place: a rescan has other pictures
of the same surfaces, and each takes the answer of the recorded surface it overlaps most. Records of rooms that ship with the package lie
in `ROOM/answers.json` beside this file.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from radartwin.errors import LabelError, MissingError
from radartwin.files import write_atomically
from radartwin.label.journal import Journal, Record
from radartwin.label.place import Place, matches
from radartwin.label.questions import Question
from radartwin.scene.scene import Scene

SHIPPED = Path(__file__).resolve().parent
FORMAT, VERSION = "radartwin-answers", 1
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
    """The name under which answers for a scene would ship: the room it is, or is a scan of."""
    for key in ("room", "scan_of"):
        if isinstance(name := scene.provenance.get(key), str):
            return name
    return None


def shipped_rooms() -> list[str]:
    """Rooms whose answers come with the package."""
    return sorted(path.parent.name for path in SHIPPED.glob("*/answers.json"))


@functools.cache
def shipped(room: str) -> tuple[Record, ...]:
    """The records that ship for a room.

    Raises:
        MissingError: none do.
        LabelError: they are damaged.
    """
    path = SHIPPED / room / "answers.json"
    if room not in shipped_rooms():
        rooms = ", ".join(shipped_rooms()) or "no room"
        raise MissingError(f"there are no recorded answers for {room}; they ship for {rooms}")
    return tuple(load_records(path))


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


def save_records(path: Path, room: str, records: Sequence[Record]) -> Path:
    """Write an answers.json, sorted by key so that the same answers are the same bytes."""
    lines = [json.dumps(record.to_dict(), separators=(",", ":")) for record in sorted(records, key=lambda r: (r.key, r.model))]
    head = f'{{"format": "{FORMAT}", "version": {VERSION}, "room": {json.dumps(room)}, "answers": [\n'
    return write_atomically(path, head + ",\n".join(lines) + "\n]}\n")


def records_for(scene: Scene, folder: Path | None) -> list[Record]:
    """All records that may answer for a scene: those kept in its folder, then those that ship for its room.

    Raises:
        MissingError: there are neither.
    """
    kept = Journal(folder / JOURNAL).records if folder is not None else []
    room = room_of(scene)
    if room in shipped_rooms():
        kept += shipped(str(room))
    if not kept:
        where = room or scene.provenance.get("source", "this scene")
        raise MissingError(
            f"materials=vlm has no recorded answers for {where}; use materials=uniform, void or true, or ask a model: "
            "radartwin label SCENE --provider server"
        )
    return kept
