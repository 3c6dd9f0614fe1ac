"""Store each answer to a material question as one JSON line as soon as the answer arrives.

If `radartwin label` is interrupted, its next run therefore asks no question twice. A killed process leaves at most one incomplete line in
the file of answers, and the next process removes this line.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radartwin.errors import LabelError, OutputError
from radartwin.io import untrusted_json
from radartwin.io.files import make_folder
from radartwin.label.answers import Answer
from radartwin.label.questions import Question, prompt_digest
from radartwin.label.surface_match import Place

FORMAT = 1


@dataclass(frozen=True, eq=False)
class Record:
    """The stored answer to a question about a surface, with model, provider, digests of prompt and pictures, and the surface's position."""

    key: str
    model: str
    provider: str
    prompt: str
    images: tuple[str, ...]
    kind: str
    place: Place
    answer: Answer

    @classmethod
    def of(cls, question: Question, answer: Answer, model: str, provider: str) -> Record:
        return cls(question.key, model, provider, prompt_digest(), question.images, question.kind, question.place, answer)

    def to_dict(self) -> dict[str, Any]:
        return {
            "format": FORMAT, "key": self.key, "model": self.model, "provider": self.provider, "prompt": self.prompt,
            "images": list(self.images), "kind": self.kind, "answer": self.answer.to_dict(), "place": self.place.to_dict(),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Record:
        """Make a record from the JSON-compatible values that `to_dict` returned."""
        try:
            if values["format"] != FORMAT:
                raise LabelError(f"a recorded answer has format {values['format']!r}, not {FORMAT!r}; ask the question again")
            place, answer = Place.from_dict(values["place"]), Answer.from_dict(values["answer"])
            key, model, provider, prompt, kind = (str(values[name]) for name in ("key", "model", "provider", "prompt", "kind"))
            return cls(key, model, provider, prompt, tuple(values["images"]), kind, place, answer)
        except KeyError as error:
            raise LabelError(f"a recorded answer lacks {error}; ask the question again") from error
        except TypeError as error:
            raise LabelError(f"a recorded answer is not valid ({error}); ask the question again") from error


class Journal:
    """The file with the stored answers about the surfaces of one scene. Each new answer is appended to the journal file.

    Raises:
        LabelError: a line other than an incomplete last line is invalid, or the path of the file is a symbolic link.
        OutputError: the file of answers cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._records: dict[tuple[str, str], Record] = {}
        complete = 0
        if path.is_symlink():  # writing through a symbolic link could change a file outside the scene folder
            raise LabelError(f"{path} is a symbolic link; replace the link by the file")
        if path.exists():
            content = path.read_bytes()
            complete = content.rfind(b"\n") + 1
            for number, line in enumerate(content[:complete].decode("utf-8", "replace").splitlines(), 1):
                try:
                    record = Record.from_dict(untrusted_json.load(line))
                except (ValueError, TypeError) as error:
                    raise LabelError(
                        f"{path}, line {number}: {error}; remove the line and run the same command again, which repeats the question"
                    ) from error
                self._records[record.model, record.key] = record
            if complete < len(content):
                os.truncate(path, complete)

    @property
    def records(self) -> list[Record]:
        """The stored answers in order of arrival; if several have the same model and question key, only the last of them is included."""
        return list(self._records.values())

    def get(self, model: str, key: str) -> Record | None:
        return self._records.get((model, key))

    def append(self, record: Record) -> None:
        """Append the record of one answer to the file of answers. When `append` returns, the record is saved on the disk."""
        make_folder(self.path.parent)
        try:
            with self.path.open("ab") as stream:
                stream.write((json.dumps(record.to_dict(), separators=(",", ":")) + "\n").encode())
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise OutputError(f"{self.path}: cannot write ({error.strerror}); free some space and run the same command again") from error
        self._records[record.model, record.key] = record
