"""A mapping file: which capture shows what, for folders that somebody else has named.

YAML, the card of a new set and entries in order, of which later ones override earlier ones:

    card: {name: court, licence: CC-BY-4.0, sensor: IWR1843BOOST, who: A. Researcher, when: 2026-03-01}
    captures:
      - file: "**"
        room: squash_court
        motion: depth
      - file: "{object}_{distance_m}m/run{repetition}_*"
      - file: mug_1m/run3_adc_data
        split: test

CSV, one column `file` and any columns of the index; the card is then given elsewhere.

A pattern is compared with the path of a capture below the folder, with or without its suffix and the card's numbering: * stands for
anything within a name, ** for any folders too, {column} for the value of a column.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from radartwin.errors import InputError, MissingError
from radartwin.io import untrusted_yaml
from radartwin.recordings.studio_log import capture_prefix

_TOKEN = re.compile(r"(\*\*)|(\*)|\{([A-Za-z_]\w*)\}")


@dataclass(frozen=True)
class Entry:
    """Columns of the index, as text, for the captures that fit a pattern."""

    file: str
    columns: Mapping[str, str]


@dataclass(frozen=True)
class CaptureMap:
    """What a mapping file says: keys of the card, and entries."""

    card: Mapping[str, Any] = field(default_factory=dict)
    entries: Sequence[Entry] = ()


def read_mapping(path: str | Path) -> CaptureMap:
    """Read a .yaml, .yml or .csv mapping.

    Raises:
        MissingError: no such file.
        InputError: it is none, with the line or the entry.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingError(f"{path}: no such mapping file; give a .yaml or .csv")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: it is not a text file; give a .yaml or .csv") from None
    if path.suffix == ".csv":
        return _of_csv(path, text)
    if path.suffix in (".yaml", ".yml"):
        return _of_yaml(path, text)
    raise InputError(f"{path}: a mapping file ends in .yaml or .csv")


def columns_of(captures: Sequence[Path], root: Path, entries: Iterable[Entry]) -> list[dict[str, str] | None]:
    """Columns of every capture by the entries that fit it; None where none does. Without entries, none for all.

    Raises:
        MissingError: an entry fits no capture.
        InputError: a pattern that names a column twice.
    """
    entries = list(entries)
    if not entries:
        return [{} for _ in captures]
    out: list[dict[str, str] | None] = [None] * len(captures)
    for entry in entries:
        pattern, fitted = _compiled(entry.file), False
        for i, capture in enumerate(captures):
            match = next((m for name in _names(capture, root) if (m := pattern.fullmatch(name))), None)
            if match:
                fitted = True
                out[i] = {**(out[i] or {}), **match.groupdict(), **entry.columns}
        if not fitted:
            raise MissingError(f"{root}: no capture fits the mapping's '{entry.file}'; there are {_examples(captures, root)}")
    return out


def _names(capture: Path, root: Path) -> tuple[str, ...]:
    relative = capture.relative_to(root)
    return tuple(relative.with_name(name).as_posix() for name in (capture_prefix(capture), relative.stem, relative.name))


def _examples(captures: Sequence[Path], root: Path) -> str:
    names = [capture.relative_to(root).as_posix() for capture in captures[:3]]
    return ", ".join(names) + (f" and {len(captures) - 3} more" if len(captures) > 3 else "")


def _compiled(pattern: str) -> re.Pattern[str]:
    parts, end = [], 0
    for token in _TOKEN.finditer(pattern):
        anything, within, column = token.groups()
        parts.append(re.escape(pattern[end : token.start()]))
        parts.append(".*" if anything else "[^/]*" if within else f"(?P<{column}>[^/]+?)")
        end = token.end()
    try:
        return re.compile("".join(parts) + re.escape(pattern[end:]))
    except re.error as error:
        raise InputError(f"pattern '{pattern}': {error}") from None


def _of_csv(path: Path, text: str) -> CaptureMap:
    reader = csv.DictReader(text.splitlines(), strict=True)
    try:
        lines = [(reader.line_num, line) for line in reader]
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: {error}") from None
    if "file" not in (reader.fieldnames or ()):
        raise InputError(f"{path}: line 1: it has no column 'file'; name the columns file,object,distance_m,...")
    for number, line in lines:
        if None in line or None in line.values():
            raise InputError(f"{path}: line {number}: it does not have one value per column")
    return CaptureMap(entries=[_entry(f"{path}: line {number}", line) for number, line in lines])


def _of_yaml(path: Path, text: str) -> CaptureMap:
    import yaml

    try:
        values = untrusted_yaml.load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark is not None else ""
        raise InputError(f"{path}: {line}{getattr(error, 'problem', None) or 'malformed YAML'}") from None
    if not isinstance(values, dict) or not set(values) <= {"card", "captures"}:
        raise InputError(f"{path}: a mapping with the keys card and captures is expected")
    card, captures = values.get("card") or {}, values.get("captures") or []
    if not isinstance(card, dict) or not isinstance(captures, list) or not all(isinstance(item, dict) for item in captures):
        raise InputError(f"{path}: card must be a mapping and captures a list of mappings")
    return CaptureMap(card, [_entry(f"{path}: captures[{i}]", item) for i, item in enumerate(captures)])


def _entry(where: str, values: Mapping[Any, Any]) -> Entry:
    columns = {str(key): "" if value is None else str(value).strip() for key, value in values.items()}
    if not (file := columns.pop("file", "")):
        raise InputError(f"{where}: it has no file; give a path or a pattern")
    return Entry(file, {key: value for key, value in columns.items() if value})
