"""The data card of a recording set, card.yaml: whose recordings these are and what their numbers mean."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from radartwin.errors import MissingError, RecordingError
from radartwin.io import files, untrusted_yaml

CARD = "card.yaml"
UNITS = ("counts", "amplitude")


@dataclass(frozen=True)
class Card:
    """What a reader of a recording set must know.

    Attributes:
        name: of the set.
        licence: under which others may use it, such as CC-BY-4.0; "private" for none.
        units: of the samples as read: "counts" of the ADC, or "amplitude" (|a|^2 = received over transmitted power).
        sensor: board and what was special about it.
        who, when: recorded it; a name or a group, a date or a span.
        notes: anything else.
        extra: further keys of the file, kept.
    """

    name: str = ""
    licence: str = ""
    units: str = ""
    sensor: str = ""
    who: str = ""
    when: str = ""
    notes: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)

    def problems(self) -> list[str]:
        """What is missing or wrong, a line each."""
        hints = {"licence": "; say under which it may be used, such as CC-BY-4.0 or private", "units": f"; one of {', '.join(UNITS)}"}
        found = [f"{key} is missing{hints.get(key, '')}" for key in KEYS if key != "notes" and not getattr(self, key)]
        if self.units and self.units not in UNITS:
            found.append(f"units {self.units!r} are not known; choose {' or '.join(UNITS)}")
        return found

    def values(self) -> dict[str, Any]:
        """As a mapping; `of` is the inverse."""
        return {key: getattr(self, key) for key in KEYS} | dict(self.extra)

    def save(self, folder: Path) -> Path:
        """Write FOLDER/card.yaml, whole or not at all. Raises RecordingError for a card that has problems."""
        import yaml

        if problems := self.problems():
            raise RecordingError(f"{folder / CARD}: {problems[0]}")
        values = self.values()
        return files.write_atomically(folder / CARD, yaml.safe_dump(values, sort_keys=False, allow_unicode=True))

    @classmethod
    def load(cls, folder: Path) -> Card:
        """Read FOLDER/card.yaml; what it says is not checked, see `problems`.

        Raises:
            MissingError: there is none, so the folder is no recording set.
            RecordingError: it cannot be read as a YAML mapping.
        """
        import yaml

        path = folder / CARD
        if not path.is_file():
            raise MissingError(f"{folder}: no recording set, it has no {CARD}; make one with radartwin import")
        try:
            values = untrusted_yaml.load(path.read_text(encoding="utf-8"))
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            line = f"line {mark.line + 1}: " if mark is not None else ""
            raise RecordingError(f"{path}: {line}{getattr(error, 'problem', None) or 'malformed YAML'}") from error
        except (UnicodeDecodeError, ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: it cannot be read as YAML text; write it again") from error
        if not isinstance(values, dict):
            raise RecordingError(f"{path}: a mapping of {', '.join(KEYS)} is expected")
        return cls.of(values)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Card:
        """A card of plain values, as text; a date that YAML has read becomes text again."""
        known = {key: "" if values.get(key) is None else str(values[key]).strip() for key in KEYS}
        return cls(**known, extra={str(key): value for key, value in values.items() if key not in KEYS})


KEYS = tuple(f.name for f in fields(Card) if f.name != "extra")
