"""Fill the Jinja2 template of a page with values of the committed tables in docs/results.

    {{ row("environment", metric="profile correlation", case="void", distance_m=2) | interval }}       0.43 (0.40 to 0.45)
    {{ rows("headline", verdict="holds") | lines("claim of the paper", "value", "verdict") }}          lines of a Markdown table

`rows` returns the rows of a table whose columns have the given values (compared as numbers), and `row` the only such row. An empty
value stands for an empty cell or a column that the table lacks. In a line, the column `value` includes the interval.
"""

import functools
import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from radartwin.runs.experiment import VERDICTS

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "results"
WIDTH = 140  # characters of a line
MARKS = ("|", "#", "!", "```", "-")  # starts of tables, headings, pictures, code and lists, whose lines stay as they are
Row = Mapping[str, str]


def filled(template: str, folder: Path = RESULTS, **content: Any) -> str:
    """Return a template with the values of the tables in `folder` and with `content`, in lines of at most WIDTH characters.

    Raises ValueError if a table or column is missing, or if too few or too many rows fit.
    """
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    environment.filters |= {"number": number, "interval": interval, "lines": lines}
    read = functools.cache(functools.partial(committed, folder=folder))

    def rows(table: str, **where: Any) -> list[Row]:
        return chosen(read(table), table, where)

    def row(table: str, **where: Any) -> Row:
        if len(matches := rows(table, **where)) != 1:
            raise ValueError(f"{len(matches)} rows of {folder / table}.csv have {where}, not one; name more columns")
        return matches[0]

    text = environment.from_string(template).render(rows=rows, row=row, **content)
    return "\n\n".join(part if part.startswith(MARKS) else wrapped(part) for part in text.split("\n\n"))


def committed(table: str, folder: Path = RESULTS) -> pd.DataFrame:
    """Return the rows of a table as texts. Raises ValueError if there is no such table."""
    file = folder / f"{table}.csv"
    if not file.is_file():
        raise ValueError(f"{file} does not exist; run radartwin tables --profile paper --only {table} and copy its table there")
    return pd.read_csv(file, dtype=str, keep_default_na=False)


def verdicts(table: str) -> str:
    """Return how many claims of a committed table have each verdict, such as "9 are supported, 2 undecided"."""
    counts = Counter(committed(table)["verdict"])
    told = [f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict]]
    return ", ".join(told).replace(" ", " are ", 1)


def number(text: str | float) -> str:
    """Return a number with two decimals, with fewer if it is large, and with one significant digit if it is small. Words stay."""
    if isinstance(text, str):
        try:
            return text if text.isdigit() else number(float(text))
        except ValueError:
            return text.replace("|", "/")
    text = text if abs(text) > 1e-9 else 0.0  # the mean of equal differences can be -1e-17
    size = abs(text)
    return f"{text:.1g}" if 0 < size < 0.005 else f"{text:.{2 if size < 10 else 1 if size < 100 else 0}f}"


def interval(row: Row) -> str:
    """Return the value of a row, with its interval if the interval has a width."""
    if row["value"] and row.get("low") and row["low"] != row["high"]:
        return "{} ({} to {})".format(*(number(float(row[column])) for column in ("value", "low", "high")))
    return number(row["value"])


def lines(rows: Iterable[Row], *columns: str) -> str:
    """Return the lines of a Markdown table, one for each row. Raises ValueError if there is no row."""
    text_lines = [f"| {' | '.join(interval(row) if column == 'value' else number(row[column]) for column in columns)} |" for row in rows]
    if not text_lines:
        raise ValueError(f"no row fits the table with the columns {', '.join(columns)}")
    return "\n".join(text_lines)


def wrapped(paragraph: str) -> str:
    """Return a paragraph with lines of at most WIDTH characters."""
    return textwrap.fill(paragraph, WIDTH, break_long_words=False, break_on_hyphens=False)


def chosen(rows: pd.DataFrame, table: str, where: Mapping[str, Any]) -> list[Row]:
    """Return the rows of a table whose columns have the given values. Raises ValueError if it lacks such a column."""
    return [row for row in rows.to_dict("records") if all(_has(row, *condition, table) for condition in where.items())]


def _has(row: Row, column: str, wanted: Any, table: str) -> bool:
    wanted = "" if wanted is None else wanted
    if column not in row and wanted != "":
        raise ValueError(f"{table}.csv has no column {column!r}; its columns are {', '.join(row)}")
    cell = row.get(column, "")
    try:
        return float(cell) == float(wanted)
    except ValueError:
        return cell == wanted
