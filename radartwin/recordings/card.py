"""Read, check and write card.yaml, the data card of a recording set. The data card states origin, licence and units of the recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from radartwin.errors import MissingError, RecordingError
from radartwin.io import files
from radartwin.radar.description_files import read_yaml

CARD = "card.yaml"
UNITS = ("counts", "amplitude")


@dataclass(frozen=True)
class Card:
    """The data card of a recording set: facts that a user of the recordings needs.

    Attributes:
        name: name of the recording set.
        licence: licence of the recordings, such as CC-BY-4.0; "private" if there is none.
        units: unit of the stored samples a: "counts" of the ADC, or "amplitude" (|a|^2 = received power / transmitted power).
        sensor: radar board, with its modifications.
        who: person or group that made the recordings.
        when: date or period in which the recordings were made.
        notes: any further text.
        extra: further keys of card.yaml, which are kept when the data card is written.
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
        """Return one line of text for each missing or invalid value of the data card."""
        hints = {"licence": "; give the licence of the recordings, such as CC-BY-4.0 or private", "units": f"; one of {', '.join(UNITS)}"}
        problems = [f"{key} is missing{hints.get(key, '')}" for key in KEYS if key != "notes" and not getattr(self, key)]
        if self.units and self.units not in UNITS:
            problems.append(f"units {self.units!r} are unknown; choose {' or '.join(UNITS)}")
        return problems

    def values(self) -> dict[str, Any]:
        """Return the data card as a mapping, from which `of` makes an equal data card."""
        return {key: getattr(self, key) for key in KEYS} | dict(self.extra)

    def save(self, folder: Path) -> Path:
        """Write FOLDER/card.yaml, completely or not at all. Raise RecordingError for a data card with missing or invalid values."""
        import yaml

        if problems := self.problems():
            raise RecordingError(f"{folder / CARD}: {problems[0]}")
        return files.write_atomically(folder / CARD, yaml.safe_dump(self.values(), sort_keys=False, allow_unicode=True))

    @classmethod
    def load(cls, folder: Path) -> Card:
        """Read FOLDER/card.yaml without checking its values; the method `problems` checks them.

        Raises:
            MissingError: the folder has no card.yaml, so it is not a recording set.
            RecordingError: card.yaml is not a YAML mapping.
        """
        path = folder / CARD
        if not path.is_file():
            raise MissingError(f"{folder}: not a recording set, because it has no {CARD}; make one with radartwin import")
        return cls.of(read_yaml(path, ", ".join(KEYS)))

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Card:
        """Make a data card from a mapping. Each value is converted to text, because YAML may have read it as a date, for example."""
        known = {key: "" if values.get(key) is None else str(values[key]).strip() for key in KEYS}
        return cls(**known, extra={str(key): value for key, value in values.items() if key not in KEYS})


KEYS = tuple(f.name for f in fields(Card) if f.name != "extra")
