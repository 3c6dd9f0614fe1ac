"""Read mapping files, which assign recording conditions (object, distance, ...) to captures by their folder and file names.

A YAML mapping file contains the data card of a new recording set, and a list of entries. If several entries match a capture, a later entry
overrides the values of the earlier entries:

    card: {name: court, licence: CC-BY-4.0, sensor: IWR1843BOOST, who: A. Researcher, when: 2026-03-01}
    captures:
      - file: "**"
        room: squash_court
        motion: depth
      - file: "{object}_{distance_m}m/run{repetition}_*"
      - file: mug_1m/run3_adc_data
        split: test

The pattern in `file` is compared with the path of a capture relative to the imported folder. The suffix of the path and the part number
from the capture card may be left out of the pattern. In a pattern, * matches any text within a name, ** also matches folders, and {column}
matches the value of an index column.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from radartwin.errors import InputError, MissingError
from radartwin.radar.captures import few
from radartwin.radar.dca1000 import capture_prefix
from radartwin.radar.description_files import read_yaml

_TOKEN = re.compile(r"(\*\*|\*|\{[A-Za-z_]\w*\})")
_TEXTS = {"**": ".*", "*": "[^/]*"}


@dataclass(frozen=True)
class Entry:
    """One entry of a mapping file: values of index columns, as text, for the captures that match a pattern."""

    file: str
    columns: Mapping[str, str]


@dataclass(frozen=True)
class CaptureMap:
    """The content of a mapping file: values of the data card, and entries."""

    card: Mapping[str, Any] = field(default_factory=dict)
    entries: Sequence[Entry] = ()


def read_mapping(path: str | Path) -> CaptureMap:
    """Read a mapping file with the suffix .yaml, .yml or .csv.

    Raises:
        MissingError: the mapping file does not exist.
        InputError: the mapping file is invalid; the message names the line or the entry.
    """
    path = Path(path)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: unknown suffix; give a mapping file that ends in .yaml")
    keys = "the keys card and captures"
    values = read_yaml(path, keys)
    if not set(values) <= {"card", "captures"}:
        raise InputError(f"{path}: expected a mapping of {keys}, not {', '.join(map(str, values))}")
    card, captures = values.get("card") or {}, values.get("captures") or []
    if not isinstance(card, dict) or not isinstance(captures, list) or not all(isinstance(item, dict) for item in captures):
        raise InputError(f"{path}: card must be a mapping and captures a list of mappings")
    return CaptureMap(card, [_entry(f"{path}: captures[{i}]", item) for i, item in enumerate(captures)])


def columns_of(captures: Sequence[Path], root: Path, entries: Iterable[Entry]) -> list[dict[str, str] | None]:
    """Return for every capture the index columns from the mapping entries that match the capture.

    The result is None for a capture that no entry matches. If there are no entries at all, the result is an empty dictionary for every
    capture.

    Raises:
        MissingError: an entry of the mapping file matches no capture.
        InputError: a pattern names the same column twice.
    """
    entries = list(entries)
    out: list[dict[str, str] | None] = [None if entries else {} for _ in captures]
    for entry in entries:
        pattern, matched = _compiled(entry.file), False
        for i, capture in enumerate(captures):
            if match := next(filter(None, map(pattern.fullmatch, _names(capture, root))), None):
                matched = True
                out[i] = {**(out[i] or {}), **match.groupdict(), **entry.columns}
        if not matched:
            names = few([capture.relative_to(root).as_posix() for capture in captures])
            raise MissingError(f"{root}: no capture matches '{entry.file}' of the mapping; there are {names}")
    return out


def _names(capture: Path, root: Path) -> tuple[str, ...]:
    relative = capture.relative_to(root)
    return tuple(relative.with_name(name).as_posix() for name in (capture_prefix(capture), relative.stem, relative.name))


def _compiled(pattern: str) -> re.Pattern[str]:
    expression = ""
    for text in _TOKEN.split(pattern):
        expression += _TEXTS.get(text) or (f"(?P<{text[1:-1]}>[^/]+?)" if _TOKEN.fullmatch(text) else re.escape(text))
    try:
        return re.compile(expression)
    except re.error as error:
        raise InputError(f"pattern '{pattern}': {error}") from None


def _entry(where: str, values: Mapping[Any, Any]) -> Entry:
    columns = {str(key): "" if value is None else str(value).strip() for key, value in values.items()}
    if not (file := columns.pop("file", "")):
        raise InputError(f"{where}: the key 'file' is missing; give a path or a pattern")
    return Entry(file, {key: value for key, value in columns.items() if value})
