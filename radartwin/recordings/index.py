"""Read, check and write index.csv, which lists the recordings of a recording set. Define the allowed values of its columns."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from radartwin.errors import InputError, RecordingError
from radartwin.radar.description_files import read_csv

INDEX, RECORDINGS, TRAJECTORIES = "index.csv", "recordings", "trajectories"  # index file and folders within a recording set
COLUMNS = ("recording", "object", "distance_m", "room", "motion", "repetition", "trajectory", "split")
REQUIRED = COLUMNS[:5]
MOTIONS = ("static", "turntable", "radial", "diagonal", "depth", "lateral", "other")
RANGED = MOTIONS[1:-1]  # motions whose distance the index must state, because the experimenter chooses this distance
SPLITS = ("", "train", "validation", "test", "calibration")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


@dataclass(frozen=True)
class Row:
    """One row of the index: the conditions of one recording.

    Attributes:
        recording: name of the recording, which is stored in recordings/NAME.bin and recordings/NAME.json.
        object: target in front of the radar; "none" for an empty room.
        distance_m: distance in metres from the radar to the vertical axis of the target: the smallest distance for depth and lateral,
            otherwise the distance at the start; None if not measured.
        motion: static, turntable, radial and diagonal (target on a rail), depth and lateral (radar on a rover), or other.
        trajectory: name of a file in trajectories/ with the poses of the radar; "" for none.
        split: use of the recording: train, validation, test, calibration or "" for none.
        extra: further columns as text. The column `start_s` is the time of the first frame on the clock of the trajectory file.
    """

    recording: str
    object: str
    distance_m: float | None
    room: str
    motion: str
    repetition: int = 0
    trajectory: str = ""
    split: str = ""
    extra: Mapping[str, str] = field(default_factory=dict)

    @property
    def condition(self) -> tuple[Any, ...]:
        """The values of the index columns that identify a recording.

        Any two recordings of a set differ in at least one value of `condition`.
        """
        return self.object, self.distance_m, self.room, self.motion, self.repetition

    def value(self, column: str) -> Any:
        """Return the row's value in a column; "" if the column is one of the `extra` columns and empty for this row."""
        return getattr(self, column) if column in COLUMNS else self.extra.get(column, "")

    def problems(self) -> list[str]:
        """Return one line of text for each invalid value of the row."""
        problems = []
        if not _NAME.fullmatch(self.recording) or self.recording.endswith((".bin", ".json")):
            problems.append(f"recording {self.recording!r} must be a file name without suffix, of letters, digits, '.', '_' and '-'")
        for column in ("object", "room"):
            if not _LABEL.fullmatch(self.value(column)):
                problems.append(f"{column} {self.value(column)!r} must be a word of letters, digits, '_' and '-'")
        if self.distance_m is None and self.motion in RANGED:
            problems.append(f"distance_m is empty, but motion {self.motion} has a distance; fill it in")
        if self.distance_m is not None and not 0 < self.distance_m < math.inf:
            problems.append(f"distance_m {self.distance_m} must be above zero and finite")
        for column, known in (("motion", MOTIONS), ("split", SPLITS)):
            if self.value(column) not in known:
                problems.append(f"{column} {self.value(column)!r} is unknown; choose {', '.join(filter(None, known))}")
        if self.repetition < 0:
            problems.append(f"repetition {self.repetition} must be zero or above")
        if self.trajectory and (self.trajectory in (".", "..") or re.search(r"[/\\]", self.trajectory)):
            problems.append(f"trajectory {self.trajectory!r} must be a file inside trajectories/")
        if clash := set(self.extra) & set(COLUMNS):
            problems.append(f"extra holds the column {min(clash)}, which has its own field")
        try:
            if not math.isfinite(self.start_s):
                raise ValueError
        except ValueError:
            problems.append(f"start_s {self.extra['start_s']!r} must be a finite number of seconds")
        return problems

    @property
    def start_s(self) -> float:
        """Time of the first frame in seconds, on the clock of the trajectory file. Raises ValueError if the column is not a number."""
        return float(self.extra.get("start_s", "") or 0.0)


def row_of(values: Mapping[str, Any]) -> Row:
    """Make an index row from a mapping of column names to texts. Raise InputError with one line of text that names the problems."""
    text = {str(key): "" if value is None else str(value).strip() for key, value in values.items()}
    problems = [f"column {column} is missing" for column in REQUIRED if column not in text]
    numbers: dict[str, Any] = {}
    for column, kind, empty, what in (("distance_m", float, None, "a number of metres"), ("repetition", int, 0, "a whole number")):
        try:
            numbers[column] = kind(text[column]) if text.get(column) else empty
        except ValueError:
            problems.append(f"{column} {text[column]!r} is not {what}")
    if not problems:
        words = {column: text.get(column, "") for column in COLUMNS if column not in numbers}
        row = Row(**words, **numbers, extra={key: value for key, value in text.items() if key not in COLUMNS and value})
        if not (problems := row.problems()):
            return row
    raise InputError("; ".join(problems))


def read_index(path: Path) -> tuple[list[Row], list[str]]:
    """Read an index file. Return its valid rows in order, and one line of text for each problem of the file or of an invalid row."""
    if not path.exists():
        return [], []
    try:
        header, lines = read_csv(path)
    except RecordingError as error:
        return [], [str(error).removeprefix(f"{path}: ")]
    if not header:
        return [], [f"it is empty; the first line names the columns {','.join(COLUMNS)}"]
    if missing := [name for name in REQUIRED if name not in header]:
        separated = "; separate the columns by commas" if len(header) == 1 else ""
        return [], [f"line 1: it has no column {', '.join(missing)}{separated}"]
    rows: list[Row] = []
    problems: list[str] = []
    names: dict[str, int] = {}
    conditions: dict[tuple[Any, ...], int] = {}
    for number, values in lines:
        if len(values) != len(header):
            problems.append(f"line {number}: it has {len(values)} values for {len(header)} columns")
            continue
        try:
            row = row_of(dict(zip(header, values, strict=True)))
        except InputError as error:
            problems.append(f"line {number}: {error}")
            continue
        if (first := names.setdefault(row.recording.casefold(), number)) != number:
            problems.append(f"line {number}: recording {row.recording} is already in line {first}")
            continue
        if (first := conditions.setdefault(row.condition, number)) != number:
            problems.append(f"line {number}: it repeats line {first} ({describe(row)}); give each row its own repetition number")
        rows.append(row)
    return rows, problems


def index_text(rows: Iterable[Row]) -> str:
    """Return the text of an index.csv with the given rows. `read_index` reads equal rows from this text."""
    rows = list(rows)
    header = [*COLUMNS, *dict.fromkeys(key for row in rows for key in row.extra)]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(["" if (value := row.value(name)) is None else value for name in header] for row in rows)
    return out.getvalue()


def describe(row: Row) -> str:
    """Describe the recording conditions of an index row as text.

    >>> describe(Row("a", "mug", 1.5, "lab", "turntable", 2))
    'mug, 1.5 m, lab, turntable, repetition 2'
    """
    distance = "distance unknown" if row.distance_m is None else f"{row.distance_m:g} m"
    return f"{row.object}, {distance}, {row.room}, {row.motion}, repetition {row.repetition}"
