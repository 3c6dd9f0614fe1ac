"""Collect the content of the report for each table: the table's rows and files, or the reason why the table is absent."""

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from analysis.tables import FORMATS, caption, to_html
from radartwin.errors import MissingError
from radartwin.plotting.style import SUFFIXES
from radartwin.runs.experiment import LIMITS, SCORE_COLUMNS, VERDICTS, Table

MISSING, STALE, FAILED, LEFT_OUT = "not run", "stale", "failed", "left out"
ABSENT = {
    FAILED: "The run ended with an error:",
    STALE: "The run belongs to an earlier source or configuration, so its results are not shown.",
    MISSING: "This table has not been run.",
    LEFT_OUT: "The profile of this report makes this table on request.",
}
LINKED = tuple(suffix for suffix in FORMATS if suffix != "html")  # without HTML, because the page itself contains it
SCALE = 0.72  # CSS pixels of the page per pixel of a figure, so that a figure of the page's width fits
_SENTENCE = re.compile(r"(?<=[.!?])\s+")


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

    def css_pixels(self, name: str) -> tuple[int, int]:
        """Return width and height of a figure on the page. Raises MissingError if the file is not a picture."""
        from PIL import Image

        path = self.figure(name)
        try:
            with Image.open(path) as picture:
                return round(SCALE * picture.width), round(SCALE * picture.height)
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
    def caption(self) -> tuple[str, str]:
        """Return the first two sentences of the caption, and the rest."""
        sentences = _SENTENCE.split(caption(self.table, self.rows))
        return " ".join(sentences[:2]), " ".join(sentences[2:])

    @property
    def html(self) -> str:
        """Return the results table as an HTML element without its caption, because the page shows the caption above the figures."""
        text = to_html(self.table, self.rows, captioned=False)
        return text.replace("<table>", f'<table data-tools aria-labelledby="{self.table.name}-title">', 1)

    @cached_property
    def rows(self) -> list[dict[str, str]]:
        """Read the rows of the CSV file, none if the table is absent. Raises MissingError if it is missing or damaged."""
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

    @property
    def verdicts(self) -> Counter[str]:
        return Counter(row["verdict"] for row in self.rows if row["verdict"])

    def _there(self, path: Path) -> Path:
        if not path.is_file():
            raise self._damaged(path)
        return path

    def _damaged(self, path: Path) -> MissingError:
        return MissingError(f"{path} is missing or damaged; run {self.command} again")
