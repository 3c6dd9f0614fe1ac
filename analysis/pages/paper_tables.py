"""Write docs/paper-tables.md: the paper's tables, figures and numbers in its order, beside the rows of docs/results that answer them.

A row of a section in `paper_tables.yaml` has `quantity`, `paper` (the paper's figure), `same` (whether the protocol is the same) and the
columns that select one row of a results table; a list gives a row for each entry. `cells` are texts, and mappings with a `paper` of their
own. `column` shows another column, `here` is a text, and `setting` names a constant (module:NAME) or an attribute of radar or profile.
A primary claim has the interval and the verdict of the table `headline`, which include Holm's correction.
"""

import functools
import pkgutil
import re
from collections.abc import Callable, Iterator, Mapping
from html import escape
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd

from analysis.pages.template import ROOT, committed, number
from analysis.tables import slug
from experiments.verdicts import PRIMARY
from radartwin.io import untrusted_yaml
from radartwin.runs.experiment import VERDICTS

PAGE = ROOT / "docs" / "paper-tables.md"
_LINK = re.compile(r"\[([^]]*)\]\((#[\w-]+)\)")
CONTENT = Path(__file__).with_suffix(".yaml")
LISTED = ("quantity", "paper", "here", "verdict", "n", "same protocol?")
VARIANTS = ("twin", "truth", "layout")  # columns of further rows, which are empty in the rows of the study itself
KEYS = ("quantity", "paper", "here", "setting", "times", "column", "same", "cells")
INTRODUCTION = """# The paper's tables

This page gives every table, figure and number of the paper in its order, beside ours: our value with its 95 % confidence interval, the
number n of recordings, and the [verdict](concepts.md#draws-and-verdicts) on the claim. The intervals of main claims include Holm's
correction and state their level. A number without a verdict belongs to no claim. "Made again in 1.1" marks a number whose quantity or test
has changed since it was computed. Our measurements come from the [testbed](concepts.md#the-testbed); the last column says what else differs
from the protocol of the paper. `python -m analysis.pages` writes this page from [docs/results](results/README.md).
"""


@functools.cache
def content() -> list[dict[str, Any]]:
    """Return the sections of the page."""
    return untrusted_yaml.load(CONTENT.read_text(encoding="utf-8"))


def tables(read: Callable[[str], pd.DataFrame] = committed, absent: str = "") -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Yield title, note and table of each section, from a function that returns the rows of a results table as texts, none of a missing
    one. `absent` is the text of a cell whose row is missing; if it is empty, such a cell raises ValueError.
    """
    read = functools.cache(read)
    for section in content():
        columns = section.get("columns", LISTED)
        if "every" in section:
            table = read(section["every"]).reindex(columns=columns, fill_value="")
            table = pd.DataFrame(table[table["target"] != ""])
        else:
            lines = [_line(read, absent, row) for row in _expanded(section.get("where", {}), section["rows"])]
            table = pd.DataFrame([[str(cell) for cell in line] for line in lines], columns=columns)
        yield section["title"], section.get("note", ""), table


def text() -> str:
    """Return the page as Markdown."""
    parts = [INTRODUCTION]
    for title, note, table in tables(_of_versions):
        parts += [f"## {title}\n", *([f"{note}\n"] if note else []), markdown(table), ""]
    return "\n".join(parts)


def _of_versions(table: str) -> pd.DataFrame:
    """Return the rows of a committed table, and those of both versions for the headline, because some tables are of version 1.0."""
    return pd.concat([committed(table), *([committed("version_1.0/judged_anew")] if table == "headline" else [])], ignore_index=True)


def markdown(table: pd.DataFrame) -> str:
    """Return a table as Markdown."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (table.columns, ["---"] * len(table.columns), *table.to_numpy()))


def html(read: Callable[[str], pd.DataFrame]) -> Iterator[tuple[str, str, str]]:
    """Yield title, note and HTML table of each section, with the values of the tables of a report and links to their rows."""
    for title, note, table in tables(read, absent="not made"):
        yield title, note, table.map(_marked).to_html(index=False, border=0, escape=False)


def _marked(cell: str) -> str:
    """Return a cell as HTML: links, line breaks, and verdicts in their colours."""
    lines = [_LINK.sub(r'<a href="\2">\1</a>', escape(line.replace("+-", "±"))) for line in cell.split("<br>")]
    return "<br>".join(f'<span class="{slug(line)}">{line}</span>' if line in VERDICTS else line for line in lines)


def answer(read: Callable[[str], pd.DataFrame], absent: str, row: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return our figure with its interval, the verdict, and the number of recordings. For a page of HTML, the figure is a link."""
    if "here" in row or "setting" in row:
        value = row["here"] if "here" in row else _setting(row["setting"])
        return ", ".join(map(str, value)) if isinstance(value, list) else _short(value, row.get("times", 1)), "", ""
    result = _row(read, absent, row)
    if result is None or "column" in row or not result["value"]:
        return absent if result is None else _short(result[row["column"]]) if "column" in row else "–", "", ""
    low, high = result["low"], result["high"]
    level = f" at {100 * float(result['level']):.1f} %" if result.get("family") == PRIMARY else ""
    interval = f" ({number(float(low))} to {number(float(high))}{level})" if low and high and low != high else ""
    here = number(float(result["value"])) + interval
    if absent:
        here = f"[{here}](#{'headline' if 'claim of the paper' in result else row['table']}-{result.name + 1})"
    return here, result["verdict"] or result.get("reason", ""), result["n"]


def _row(read: Callable[[str], pd.DataFrame], absent: str, row: Mapping[str, Any]) -> Any:
    """Return the row of a results table that the columns of `row` select, or that of the headline for a primary claim."""
    wanted = {column: str(value) for column, value in row.items() if column not in (*KEYS, "table") and value is not None}
    rows: Any = read(row["table"])
    for column, value in ({name: "" for name in VARIANTS if name in rows} | wanted).items():
        rows = rows[rows[column] == value] if column in rows else rows[:0]
    if len(rows) != 1:
        if absent:
            return None
        raise ValueError(f"{row['table']}.csv: {len(rows)} rows have {wanted}, not one; change {CONTENT.name}")
    known, primary = rows.iloc[0], read("headline")
    if len(primary) and "column" not in row:
        same = primary["table"] == row["table"]
        for column in ("metric", "value", "run_keys"):
            same &= primary[column] == known[column]
        return primary[same].iloc[0] if same.any() else known
    return known


def _expanded(shared: Mapping[str, Any], rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the rows with the columns of their section, and a row for each value of a list."""
    for row in rows:
        row = {**shared, **row}
        several = [column for column, value in row.items() if isinstance(value, list) and column != "cells"]
        yield from ({**row, several[0]: value} for value in row[several[0]]) if several else (row,)


def _line(read: Callable[[str], pd.DataFrame], absent: str, row: Mapping[str, Any]) -> list[Any]:
    """Return the cells of a row. One of its `cells` shows the paper's figure, our figure, n and the verdict on lines of their own."""
    if "cells" not in row:
        return [row["quantity"].format_map(row).replace("_", " "), row["paper"], *answer(read, absent, row), row["same"]]
    line = []
    for cell in row["cells"]:
        if isinstance(cell, dict):
            here, verdict, n = answer(read, absent, {**row, **cell})
            parts = [f"paper {cell['paper']}" if cell["paper"] != "" else "", f"here {here}", f"n {n}" if n else "", verdict]
            line.append("<br>".join(filter(None, parts)))
        else:
            line.append(str(cell).format_map(row).replace("_", " "))
    return [*line, row["same"]]


def _short(value: Any, times: float = 1) -> str:
    try:
        scaled = float(value) * times
    except ValueError:
        return str(value)
    return f"{scaled:.3g}"


def _setting(name: str) -> Any:
    return pkgutil.resolve_name(name) if ":" in name else attrgetter(name)(_paper_profile())


@functools.cache
def _paper_profile() -> SimpleNamespace:
    from radartwin.config.compose import compose
    from radartwin.radar.chirp import Radar

    return SimpleNamespace(config=compose(["experiment=turntable_shape", "profile=paper"]), radar=Radar.iwr1843())
