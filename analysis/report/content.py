"""Collect the content of the report for each table: the table's rows, claims and files, or the reason why the table is absent."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from analysis.tables import FORMATS, caption, heading, text_of
from radartwin.errors import MissingError
from radartwin.plotting.style import SUFFIXES
from radartwin.runs.experiment import JUDGED, LIMITS, SCORE_COLUMNS, VERDICTS, Table

MISSING, STALE, FAILED = "not run", "stale", "failed"
ABSENT = {
    FAILED: "The run ended with an error:",
    STALE: "The run belongs to an earlier source or configuration, so its results are not shown.",
    MISSING: "This table has not been run.",
}
LINKED = tuple(suffix for suffix in FORMATS if suffix != "html")  # without HTML, because the page itself contains it
_CAPTION = re.compile(r"<caption>.*?</caption>\n?", re.DOTALL)
CASES = 4  # largest number of columns that describe the case of a claim
_NO_CASE = {"claim", *JUDGED, "reason", "draws", "items", "seed", "run_keys", "title", "note", "machine", *SCORE_COLUMNS}


@dataclass(frozen=True)
class Claim:
    """A claim that a row of a results table states. `row` is the number of the row, from 1. `case` holds the cells that distinguish this
    row from the other claims of the table.
    """

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
    """The content of one table in the report, or the reason why the table is absent."""

    table: Table
    output: Path  # root folder of all output
    profile: str
    run_key: str = ""
    figures: Sequence[str] = ()  # names of the table's figures
    absent: str = ""  # why the table is absent, a key of ABSENT; "" if the table is present
    error: str = ""  # error of a failed run, as one line

    @property
    def command(self) -> str:
        """Return the `radartwin tables` command that makes the table of this section."""
        return f"radartwin tables --profile {self.profile} --only {self.table.name}"

    def file(self, suffix: str) -> Path:
        """Return the path of the table's file with the suffix `suffix`, such as ".csv". Raises MissingError if this file does not exist."""
        return self._there(self.output / "tables" / f"{self.table.name}.{suffix}")

    def figure(self, name: str, suffix: str = ".png") -> Path:
        """Return the path of the file of one figure of the report. Raises MissingError if this file does not exist."""
        return self._there(self.output / "figures" / f"{name}{suffix}")

    def pixels(self, name: str) -> tuple[int, int]:
        """Return width and height of a figure's picture in pixels. Raises MissingError if the file is not a picture."""
        from PIL import Image

        path = self.figure(name)
        try:
            with Image.open(path) as picture:
                return picture.size
        except OSError as error:
            raise self._damaged(path) from error

    def files(self) -> Iterator[tuple[str, Path]]:
        """Yield (part, path) for every file that the report page links to; `part` is the subfolder that the file is copied into."""
        if not self.absent:
            yield from (("tables", self.file(suffix)) for suffix in LINKED)
            yield from (("figures", self.figure(name, suffix)) for name in self.figures for suffix in SUFFIXES)
            if self.table.chart:
                yield "figures", self.figure(f"{self.table.name}_page", ".html")

    @property
    def caption(self) -> str:
        return caption(self.table, self.rows)

    @property
    def html(self) -> str:
        """Return the results table as an HTML element without its caption, because the page shows the caption above the figures."""
        path = self.file("html")
        try:
            text = _CAPTION.sub("", path.read_text(encoding="utf-8"), count=1)
        except UnicodeDecodeError as error:
            raise self._damaged(path) from error
        return text.replace("<table>", f'<table data-tools aria-labelledby="{self.table.name}-title">', 1)

    @cached_property
    def rows(self) -> list[dict[str, str]]:
        """Read the table rows from the CSV file; an absent table gives an empty list. Raises MissingError if the CSV is missing or
        damaged.
        """
        if self.absent:
            return []
        path = self.file("csv")
        try:
            with path.open(encoding="utf-8", newline="") as stream:
                rows = list(csv.DictReader(stream))
        except (UnicodeDecodeError, csv.Error) as error:
            raise self._damaged(path) from error
        if not all(
            set(SCORE_COLUMNS) <= row.keys() and row["verdict"] in (*VERDICTS, *LIMITS, "") and None not in row.values() for row in rows
        ):
            raise self._damaged(path)
        return rows

    @cached_property
    def claims(self) -> list[Claim]:
        """Return a Claim for each table row with a verdict."""
        claimed = [(n, row) for n, row in enumerate(self.rows, 1) if row["verdict"]]
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
    """Format the text of a CSV cell in the same way as the written tables, for instance with three significant digits."""
    try:
        return text_of(float(cell)) if cell else text_of(None)
    except ValueError:
        return cell


def _case(column: str, cell: str) -> str:
    """Format a cell that describes a claim's case: a word stays as it is, a number follows its column's name ("strength 0.5")."""
    told = figure(cell)
    return cell if told == cell and not cell[:1].isdigit() else f"{heading(column)} {told}"
