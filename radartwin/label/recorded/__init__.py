"""Answer material questions with recorded answers of a model, which are stored in the scene folder or ship with the package.

The digest of a material question (prompt and pictures) identifies its recorded answer. A new scan of the same room has other pictures and
therefore other question digests. A surface of the new scan takes the answer about the recorded surface that it overlaps most. The shipped
answers of a room are in `ROOM/answers.json` beside this file.
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
from radartwin.label.questions import Question, prompt_digest
from radartwin.label.recorded.digests import DIGESTS
from radartwin.label.surface_match import Place, matches
from radartwin.scene.scene import Scene

SHIPPED = Path(__file__).resolve().parent
FORMAT, VERSION = "radartwin-answers", 1
ANSWERS = "answers.json"  # name of the file with the recorded answers about one room
CHAIR, FURNISHED = "arkit_lidar_chair_scan", "cc0_furnished_room"
# digests (`scan_of`) of real scans: frames and mesh of the chair, and the furnished room as `radartwin demo` ships it
SCANS = {"sha256:aa3721d1a49ccb05": CHAIR, "sha256:fd3b6640d1bcd7d2": CHAIR, "sha256:bd5e325a38d3a170": FURNISHED}
JOURNAL = Path("labels") / "answers.jsonl"  # path of the stored answers within a scene folder


@dataclass(frozen=True)
class Recorded:
    """A provider that answers material questions with recorded answers: those of the model `model`, or those of all models if it is
    None.
    """

    records: Sequence[Record]
    model: str | None = None
    name = "recorded"

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Yield each answered question with a record: the record of the same question, else that of the most overlapping surface.

        A record of an overlapping surface has another key than the question, because its answer belongs to another question.
        """
        by_key = {record.key: record for record in self._usable()}
        unmatched = []
        for question in questions:
            if question.key in by_key:
                yield question, by_key[question.key]
            else:
                unmatched.append(question)
        for question, record in zip(unmatched, self.by_place([question.place for question in unmatched]), strict=True):
            if record is not None:
                yield question, record

    def by_place(self, places: Sequence[Place]) -> list[Record | None]:
        """Return for each surface position the record of the surface that it overlaps most; None if the overlap is below MIN_SHARE."""
        usable = self._usable()
        best_matches = matches(places, [record.place for record in usable])
        return [None if match is None else usable[match[0]] for match in best_matches]

    def _usable(self) -> list[Record]:
        return [record for record in self.records if self.model is None or record.model == self.model]


def room_of(scene: Scene) -> str | None:
    """Return the name of the room whose shipped answers apply to the scene, from the scene's provenance; None if there is no such room."""
    name = str(scene.provenance.get("room") or scene.provenance.get("scan_of"))
    room = SCANS.get(name, name)
    return room if room in DIGESTS else None


def shipped_rooms() -> list[str]:
    """Return the names of the rooms whose recorded answers ship with the package."""
    return sorted(DIGESTS)


@functools.cache
def shipped(room: str) -> tuple[Record, ...]:
    """Return the recorded answers about a room that ship with the package."""
    if room not in DIGESTS:
        rooms = ", ".join(shipped_rooms()) or "no room"
        raise MissingError(f"there are no recorded answers for {room}; they ship for {rooms}")
    path = SHIPPED / room / ANSWERS
    if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != DIGESTS[room]:
        raise LabelError(
            f"{path} is not the file that ships with this version; install radartwin again, or record new answers in a checkout: "
            f"python -m experiments.generators.label_questions {room} --answers FILE --model NAME --about TEXT"
        )
    return tuple(load_records(path))


def ship_records(records: Sequence[Record], room: str, to: Path = SHIPPED, about: str = "") -> Path:
    """Write recorded answers about a room, and the SHA-256 digest of their file, to the package.

    Return the path of the written answers.json.

    Args:
        to: folder that holds digests.py and one folder per room.
        about: text that states model, date and method of the answers.
    """
    path = save_records(to / room / ANSWERS, room, records, about)
    digests = {p.parent.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(to.glob(f"*/{ANSWERS}"))}
    text = (SHIPPED / "digests.py").read_text().partition("\nDIGESTS")[0]
    entries = "".join(f'    "{name}": "{digest}",\n' for name, digest in digests.items())
    write_atomically(to / "digests.py", f"{text}\nDIGESTS: dict[str, str] = {{\n{entries}}}\n")
    return path


def load_records(path: Path) -> list[Record]:
    """Read the recorded answers in an answers.json."""
    try:
        content = json.loads(path.read_text())
        if content["format"] != FORMAT or content["version"] != VERSION:
            raise KeyError("format")
        return [Record.from_dict(values) for values in content["answers"]]
    except (ValueError, KeyError, TypeError) as error:
        raise LabelError(f"{path} is not a {FORMAT} version {VERSION} file ({error}); record the answers again") from error


def save_records(path: Path, room: str, records: Sequence[Record], about: str = "") -> Path:
    """Write recorded answers to an answers.json, sorted by question key, so that the same answers give the same bytes."""
    lines = [json.dumps(record.to_dict(), separators=(",", ":")) for record in sorted(records, key=lambda r: (r.key, r.model))]
    head = f'{{"format": "{FORMAT}", "version": {VERSION}, "room": {json.dumps(room)}, "about": {json.dumps(about)}, "answers": [\n'
    return write_atomically(path, head + ",\n".join(lines) + "\n]}\n")


def records_for(scene: Scene, folder: Path | None) -> list[Record]:
    """Return all recorded answers that apply to a scene: first those in its folder, then those that ship for its room.

    Raises:
        MissingError: there are no such answers.
        LabelError: the answers that ship for the room belong to an earlier version of the questions.
    """
    records = Journal(folder / JOURNAL).records if folder is not None else []
    room = room_of(scene)
    if room is not None:
        stale = [record for record in shipped(room) if record.prompt != prompt_digest()]
        if stale:
            raise LabelError(
                f"{len(stale)} shipped answers about {room} belong to an earlier version of the questions; "
                "answer the questions again: python -m experiments.generators.label_questions"
            )
        records += shipped(room)
    if not records:
        name = scene.provenance.get("room") or Path(str(scene.provenance.get("source") or "this scene")).stem
        if folder is not None:
            raise MissingError(
                f"there are no recorded answers for {name}; ask a model: radartwin label {folder} --provider server, "
                f"or export the questions with radartwin label {folder} --export FOLDER"
            )
        raise MissingError(
            f"materials=vlm has no recorded answers for {name}; use materials=uniform, void or true, or ask a model: "
            "radartwin label SCENE --provider server"
        )
    return records
