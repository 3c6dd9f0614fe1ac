"""Fill the placeholders of a page template with values of the committed tables in docs/results.

    {{environment: metric=profile correlation; case=void; distance_m=2}}            0.43 (0.40 to 0.45)
    {{environment.value: metric=profile correlation; case=void; distance_m=2}}      0.43
    {{rows headline: claim of the paper, paper, value, verdict | verdict=holds}}    lines of a Markdown table
    {{count headline: verdict=holds}}                                               number of rows

A placeholder selects rows of a table by conditions on columns, `column=value` or `column!=value`. Numbers are compared as numbers, and an
empty value stands for an empty cell or a column that the table lacks. The first form gives the value of exactly one row, with its interval
if the interval has a width. The second form gives one column of this row. The third form gives one line for each selected row, and at least
one row must fit. In such a line, the column `value` includes the interval. The fourth form gives the number of selected rows. Whole numbers
stay as the table has them.
"""

from __future__ import annotations

import csv
import re
import textwrap
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "results"
WIDTH = 140  # characters of a line
MARKS = "|#!`-"  # first characters of tables, headings, pictures, code and lists, whose lines stay as they are
PLACE = re.compile(r"\{\{(rows |count )?(\w+)(?:\.([^:}]+))?:([^}]*)\}\}")
Row = Mapping[str, str]


def filled(template: str, folder: Path = RESULTS) -> str:
    """Return the template with values in place of its placeholders. Raises ValueError if a table or column is missing, or if too few or too
    many rows fit.
    """
    known: dict[str, list[dict[str, str]]] = {}

    def fill(place: re.Match[str]) -> str:
        kind, table, column, asked = ((part or "").replace("\n", " ") for part in place.groups())
        if table not in known:
            known[table] = rows_of(table, folder)
        columns, _, conditions = asked.partition("|") if kind == "rows " else ("", "", asked)
        found = [row for row in known[table] if _fits(row, conditions, place.group())]
        if kind == "count ":
            return str(len(found))
        if kind and not found:
            raise ValueError(f"{place.group()}: no row of {folder / table}.csv fits")
        if kind:
            names = [name.strip() for name in columns.split(",")]
            return "\n".join(f"| {' | '.join(_cell(row, name, place.group()) for name in names)} |" for row in found)
        if len(found) != 1:
            raise ValueError(f"{place.group()}: {len(found)} rows of {folder / table}.csv fit, not one; name more columns")
        return _cell(found[0], column or "value", place.group(), interval=not column)

    text = PLACE.sub(fill, template)
    if left := re.search(r".*(\{\{|\}\}).*", text):
        raise ValueError(f"this place of the page has another form than those in analysis/pages/filled.py: {left.group().strip()}")
    return "\n\n".join(part if part[:1] in MARKS else wrapped(part) for part in text.split("\n\n"))


def rows_of(table: str, folder: Path = RESULTS) -> list[dict[str, str]]:
    """Return the rows of a table as texts. Raises ValueError if there is no such table."""
    file = folder / f"{table}.csv"
    if not file.is_file():
        raise ValueError(f"{file} does not exist; run radartwin tables --profile paper --only {table} and copy its table there")
    with file.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def number(value: float) -> str:
    """Return a number with two decimals, or with fewer if it is large and one significant digit if it is small."""
    size = abs(value)
    if 0 < size < 0.005:
        return f"{value:.1g}"
    return f"{value:.{2 if size < 10 else 1 if size < 100 else 0}f}"


def wrapped(paragraph: str) -> str:
    """Return a paragraph with lines of at most WIDTH characters."""
    return textwrap.fill(paragraph, WIDTH, break_long_words=False, break_on_hyphens=False)


def _fits(row: Row, conditions: str, place: str) -> bool:
    for condition in filter(None, (part.strip() for part in conditions.split(";"))):
        column, differs, wanted = re.fullmatch(r"([^=!]*)(!?)=(.*)", condition, re.DOTALL).groups()  # type: ignore[union-attr]
        if column not in row and wanted:
            raise ValueError(f"{place}: no column {column!r}; the columns are {', '.join(row)}")
        if _equal(row.get(column, ""), wanted) == bool(differs):
            return False
    return True


def _equal(cell: str, wanted: str) -> bool:
    try:
        return float(cell) == float(wanted)
    except ValueError:
        return cell == wanted


def _cell(row: Row, column: str, place: str, interval: bool = True) -> str:
    if column not in row:
        raise ValueError(f"{place}: no column {column!r}; the columns are {', '.join(row)}")
    text = row[column]
    if column == "value" and text and interval and row.get("low") and row["low"] != row["high"]:
        return f"{number(float(text))} ({number(float(row['low']))} to {number(float(row['high']))})"
    try:
        return text if text.isdigit() else number(float(text))
    except ValueError:
        return text.replace("|", "/")
