"""Write a table in four formats: CSV for programs, Markdown for the repository, LaTeX booktabs for the paper, HTML for the report.

The columns that describe the case (object, room, motion and so on) come first, then the run keys, then the score columns in a fixed order.
The CSV has full precision and every run key. The Markdown, LaTeX and HTML files round to three significant digits and have no run keys.
"""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from analysis.registry import TESTBED_NOTE
from radartwin.io import files
from radartwin.runs.experiment import SCORE_COLUMNS, Table, check_rows

Row = dict[str, Any]
FORMATS = ("csv", "md", "tex", "html")
_NUMBER = int | float | None
_UNITS = {"m": "m", "db": "dB", "deg": "deg", "hz": "Hz", "s": "s", "mps": "m/s"}
_WIDE = 6  # largest number of columns that fits into one column of a page
# Non-ASCII characters that captions, claims and metrics may contain, with their LaTeX commands. pdflatex cannot typeset others.
_SYMBOLS = {
    "–": "--", "−": "$-$", "±": r"$\pm$", "×": r"$\times$", "≤": r"$\leq$", "≥": r"$\geq$", "→": r"$\rightarrow$", "°": r"$^\circ$",
    "²": "$^2$", "³": "$^3$", "µ": r"$\mu$", "ρ": r"$\rho$", "λ": r"$\lambda$", "σ": r"$\sigma$", "ε": r"$\epsilon$", "·": r"$\cdot$",
}  # fmt: skip
_LATEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"} | {c: f"\\{c}" for c in "&%$#_{}"} | _SYMBOLS


def write(table: Table, rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write the table files NAME.csv, .md, .tex and .html, each atomically, and return their paths.

    Raises:
        InputError: a row lacks a score column, has an unknown verdict, or has a value outside its confidence interval.
    """
    check_rows(table.name, list(rows))
    texts = {"csv": to_csv(rows), "md": to_markdown(table, rows), "tex": to_latex(table, rows), "html": to_html(table, rows)}
    return [files.write_atomically(folder / f"{table.name}.{suffix}", texts[suffix]) for suffix in FORMATS]


def columns(rows: Sequence[Row]) -> list[str]:
    """Return the column names in order: columns that describe the case (in order of first appearance), run_keys, score columns."""
    cases = dict.fromkeys(c for row in rows for c in row if c not in SCORE_COLUMNS and c != "run_keys")
    return [*cases, "run_keys", *SCORE_COLUMNS]


def caption(table: Table, rows: Sequence[Row]) -> str:
    """Return the declared caption of a table, with notes on draws and on the testbed (virtual measurements) if it is used."""
    draws = max((int(row.get("draws") or 1) for row in rows), default=1)  # `draws` is a text if the rows come from a written CSV file
    notes = [f"Values are means over {draws} draws of the virtual measurements. Figures show the first draw."] if draws > 1 else []
    notes += [TESTBED_NOTE] if any("testbed" in str(row["domain"]) for row in rows) else []
    return " ".join([table.caption, *notes])


def to_csv(rows: Sequence[Row]) -> str:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns(rows), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({c: "" if v is None else v for c, v in row.items()} for row in rows)
    return stream.getvalue()


def to_markdown(table: Table, rows: Sequence[Row]) -> str:
    names, cells = _cells(rows)
    lines = [f"| {' | '.join(heading(c) for c in names)} |", f"|{'---|' * len(names)}"]
    lines += [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in cells]
    return f"**{table.title}.** {caption(table, rows)}\n\n" + "\n".join(lines) + "\n"


def to_latex(table: Table, rows: Sequence[Row]) -> str:
    """Format a table as LaTeX for pdflatex with booktabs and graphicx. A wide table is shrunk to the width of both page columns."""
    names, cells = _cells(rows)
    align = "".join("r" if all(isinstance(row.get(c), _NUMBER) for row in rows) else "l" for c in names)
    body = "\n".join(f"    {' & '.join(_latex(cell) for cell in row)} \\\\" for row in cells)
    head = " & ".join(_latex(heading(c)) for c in names)
    shape, width = ("table*", r"\textwidth") if len(names) > _WIDE else ("table", r"\columnwidth")
    return rf"""\begin{{{shape}}}[t]
  \centering
  \caption{{\textbf{{{_latex(table.title)}.}} {_latex(caption(table, rows))}}}
  \label{{tab:{table.name}}}
  \resizebox{{{width}}}{{!}}{{%
  \begin{{tabular}}{{{align}}}
    \toprule
    {head} \\
    \midrule
{body}
    \bottomrule
  \end{{tabular}}}}
\end{{{shape}}}
"""


def to_html(table: Table, rows: Sequence[Row]) -> str:
    """Format a table as an HTML table element. The text is ASCII, so that a page of any encoding can include the element."""
    names, cells = _cells(rows)
    kinds = [' class="number"' if all(isinstance(row.get(c), _NUMBER) for row in rows) else "" for c in names]
    head = "".join(f'<th scope="col"{kind}>{html.escape(heading(c))}</th>' for c, kind in zip(names, kinds, strict=True))
    body = "\n".join(
        f'<tr id="{table.name}-{number}" class="{html.escape(slug(row["verdict"]))}">'
        + "".join(f"<td{kind}>{html.escape(cell)}</td>" for cell, kind in zip(texts, kinds, strict=True))
        + "</tr>"
        for number, (row, texts) in enumerate(zip(rows, cells, strict=True), 1)
    )
    text = f"<strong>{html.escape(table.title)}.</strong> {html.escape(caption(table, rows))}"
    table_text = f"<table>\n<caption>{text}</caption>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>\n"
    return table_text.encode("ascii", "xmlcharrefreplace").decode()


def _cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    names = [c for c in columns(rows) if c != "run_keys"]
    return names, [[text_of(row.get(c)) for c in names] for row in rows]


def text_of(value: Any) -> str:
    """Format the value of a cell as text: three significant digits for a number, or a dash for a value that could not be computed."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.3g}".replace("-", "−")
    return str(value)


def slug(verdict: str) -> str:
    """Return the name of a verdict as a class of the page."""
    return verdict.replace(" ", "-")


def heading(column: str) -> str:
    """Return the heading of a table column with its unit in parentheses; for example, distance_m becomes "distance (m)"."""
    name, _, unit = column.rpartition("_")
    return f"{name} ({_UNITS[unit]})".replace("_", " ") if name and unit in _UNITS else column.replace("_", " ")


def _latex(text: str) -> str:
    return "".join(_LATEX.get(c, c) for c in text)
