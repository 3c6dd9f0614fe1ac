"""What the report tells of each table: its rows, which of them are claims, its files, and why a table is not there."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from analysis.tables import FORMATS, heading, text_of
from radartwin.errors import MissingError
from radartwin.plotting.style import SUFFIXES
from radartwin.runs.experiment import SCORE_COLUMNS, VERDICTS, Table

MISSING, STALE, FAILED = "not run", "stale", "failed"
ABSENT = {
    MISSING: "This table has not been run.",
    STALE: "The run is of an earlier source or configuration, so its figures stay out.",
    FAILED: "The run ended with an error:",
}
LINKED = tuple(suffix for suffix in FORMATS if suffix != "html")  # formats of a table; the page itself shows the other
CASES = 4  # columns that say which case a claim is of; more stand in the table
_NO_CASE = {"claim", "p", "items", "seed", "run_keys", "title", "note", "machine", *SCORE_COLUMNS}


@dataclass(frozen=True)
class Claim:
    """A row that states something: `row` counts from 1, `case` are its telling columns."""

    table: Table
    row: int
    text: str
    case: str
    cells: dict[str, str]

    @property
    def verdict(self) -> str:
        return self.cells["verdict"]


@dataclass(frozen=True)
class Section:
    """One table of the report, or why there is none.

    Attributes:
        output: root of everything written. figures: names of its figures. absent: a key of ABSENT, or "". error: of a failed run, one line.
    """

    table: Table
    output: Path
    profile: str
    run_key: str = ""
    figures: Sequence[str] = ()
    absent: str = ""
    error: str = ""

    @property
    def command(self) -> str:
        """What makes the table, or makes it anew."""
        return f"radartwin tables --profile {self.profile} --only {self.table.name}"

    def file(self, suffix: str) -> Path:
        """A file of the table.

        Raises:
            MissingError: it is not there.
        """
        return self._there(self.output / "tables" / f"{self.table.name}.{suffix}")

    def figure(self, name: str, suffix: str = ".png") -> Path:
        """A file of a figure. Raises MissingError where it is not there."""
        return self._there(self.output / "figures" / f"{name}{suffix}")

    def pixels(self, name: str) -> tuple[int, int]:
        """Width and height of a figure's picture. Raises MissingError where it is no picture."""
        from PIL import Image

        path = self.figure(name)
        try:
            with Image.open(path) as picture:
                return picture.size
        except OSError as error:
            raise self._damaged(path) from error

    def files(self) -> Iterator[tuple[str, Path]]:
        """Every file that the page links to, with the part of the report it belongs to."""
        if not self.absent:
            yield from (("tables", self.file(suffix)) for suffix in LINKED)
            yield from (("figures", self.figure(name, suffix)) for name in self.figures for suffix in SUFFIXES)
            if self.table.chart:
                yield "figures", self.figure(f"{self.table.name}_page", ".html")

    @cached_property
    def text(self) -> str:
        """The table as HTML."""
        path = self.file("html")
        try:
            return path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise self._damaged(path) from error

    @cached_property
    def rows(self) -> list[dict[str, str]]:
        """Its rows as the CSV has them; none of an absent table.

        Raises:
            MissingError: the CSV is missing or damaged.
        """
        if self.absent:
            return []
        path = self.file("csv")
        try:
            with path.open(encoding="utf-8", newline="") as stream:
                rows = list(csv.DictReader(stream))
        except (UnicodeDecodeError, csv.Error) as error:
            raise self._damaged(path) from error
        if not all(set(SCORE_COLUMNS) <= row.keys() and row["verdict"] in VERDICTS and None not in row.values() for row in rows):
            raise self._damaged(path)
        return rows

    @cached_property
    def claims(self) -> list[Claim]:
        """The rows that state something: those with a claim, and those with a verdict of their own."""
        claimed = [(n, row) for n, row in enumerate(self.rows, 1) if row.get("claim") or row["verdict"] != "untestable"]
        columns = [c for c in (self.rows[0] if self.rows else ()) if c not in _NO_CASE]
        telling = [c for c in columns if len({row[c] for _, row in claimed}) > 1][:CASES]
        return [
            Claim(self.table, n, row.get("claim") or row["metric"], ", ".join(_case(c, row[c]) for c in telling if row[c]), row)
            for n, row in claimed
        ]

    @property
    def verdicts(self) -> Counter[str]:
        return Counter(claim.verdict for claim in self.claims)

    def _there(self, path: Path) -> Path:
        if not path.is_file():
            raise self._damaged(path)
        return path

    def _damaged(self, path: Path) -> MissingError:
        return MissingError(f"{path} is missing or damaged; run {self.command} again")


def figure(cell: str) -> str:
    """A cell of the CSV as the tables show it."""
    try:
        return text_of(float(cell)) if cell else text_of(None)
    except ValueError:
        return cell


def _case(column: str, cell: str) -> str:
    """A word speaks for itself, a figure needs its column's name: lab, strength 0.5."""
    told = figure(cell)
    return cell if told == cell and not cell[:1].isdigit() else f"{heading(column)} {told}"
