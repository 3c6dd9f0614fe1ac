"""Write a table in four formats: CSV for programs, Markdown for the repository, LaTeX booktabs for the paper, HTML for the report.

The columns that describe the case (object, room, motion and so on) come first, then the run keys, then the score columns in a fixed order.
The CSV has full precision and every run key. The Markdown, LaTeX and HTML files round to three significant digits and have no run keys.
The HTML table begins with what a reader needs: claim, verdict, value with interval, the paper's figure, and why the verdict follows.
"""

import html
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from analysis.registry import TESTBED_NOTE
from radartwin.io import files
from radartwin.runs.experiment import JUDGED, SCORE_COLUMNS, Table, check_rows

Row = Mapping[str, Any]
FORMATS = ("csv", "md", "tex", "html")
FRONT = ("claim", "verdict", "value", "paper", "why")  # the first columns of an HTML table
_UNITS = {"m": "m", "m2": "m²", "mm": "mm", "db": "dB", "deg": "deg", "hz": "Hz", "s": "s", "mps": "m/s", "mib": "MiB"}
_WIDE = 6  # largest number of columns that fits into one column of a page
_FLOAT = re.compile(r"-?\d+\.\d+(e[+-]?\d+)?|-?\d+e[+-]?\d+")
_NUMBER = re.compile(rf"-?\d+|{_FLOAT.pattern}|")
CASES, LEVELS = 6, 24  # largest number of columns that describe a case, and of different numbers in one of them
_NO_CASE = {
    "claim", "claim of the paper", "why", "reason", *JUDGED, "limit", "draws", "items", "seed", "answers", "chance", "seed_sd", "run_keys",
    "strength 0.5", "strength 1", "strength 2", "over all strengths", "table", "title", "note", "machine", "source", "sources", "values",
    "recordings", "scans", "frames timed", "rays", "first_only", "second_only", *SCORE_COLUMNS,
}  # fmt: skip
# Non-ASCII characters that captions, claims and metrics may contain, with their LaTeX commands. pdflatex cannot typeset others.
_SYMBOLS = {
    "–": "--", "−": "$-$", "±": r"$\pm$", "×": r"$\times$", "≤": r"$\leq$", "≥": r"$\geq$", "→": r"$\rightarrow$", "°": r"$^\circ$",
    "²": "$^2$", "³": "$^3$", "µ": r"$\mu$", "ρ": r"$\rho$", "λ": r"$\lambda$", "σ": r"$\sigma$", "ε": r"$\epsilon$", "·": r"$\cdot$",
}  # fmt: skip
_LATEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"} | {c: f"\\{c}" for c in "&%$#_{}"} | _SYMBOLS


def write(table: Table, rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write the files NAME.csv, .md, .tex and .html atomically, and return their paths. Raises InputError for a wrong row."""
    check_rows(table.name, [dict(row) for row in rows])
    texts = {"csv": to_csv(rows), "md": to_markdown(table, rows), "tex": to_latex(table, rows), "html": to_html(table, rows)}
    return [files.write_atomically(folder / f"{table.name}.{suffix}", texts[suffix]) for suffix in FORMATS]


def columns(rows: Sequence[Row]) -> list[str]:
    """Return the column names in order: columns that describe the case (in order of first appearance), run_keys, score columns."""
    cases = dict.fromkeys(c for row in rows for c in row if c not in SCORE_COLUMNS and c != "run_keys")
    return [*cases, "run_keys", *SCORE_COLUMNS]


def caption(table: Table, rows: Sequence[Row]) -> str:
    """Return the declared caption of a table, and for several draws what the values are."""
    draws = max((int(float(row.get("draws") or 1)) for row in rows), default=1)  # a text if the rows come from a CSV file
    drawn = f" Values are means over {draws} draws of the virtual measurements. Figures show the first draw." if draws > 1 else ""
    return table.caption + drawn


def full_caption(table: Table, rows: Sequence[Row]) -> str:
    """Return the caption of a table that stands alone, which says what the testbed is if the table is scored against it."""
    return " ".join([caption(table, rows), *([TESTBED_NOTE] if any("testbed" in str(row["domain"]) for row in rows) else [])])


def to_csv(rows: Sequence[Row]) -> str:
    return files.csv_text(rows, columns(rows))


def to_markdown(table: Table, rows: Sequence[Row]) -> str:
    names, cells = _cells(rows)
    lines = [[heading(c) for c in names], ["---"] * len(names), *([cell.replace("|", "\\|") for cell in row] for row in cells)]
    return f"**{table.title}.** {full_caption(table, rows)}\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)


def to_latex(table: Table, rows: Sequence[Row]) -> str:
    """Format a table as LaTeX for pdflatex with booktabs and graphicx. A wide table is shrunk to the width of both page columns."""
    names, cells = _cells(rows)
    align = "".join("r" if _numeric(rows, c) else "l" for c in names)
    head, *body = (" & ".join(map(_latex, line)) + r" \\" for line in ([heading(c) for c in names], *cells))
    shape, width = ("table*", r"\textwidth") if len(names) > _WIDE else ("table", r"\columnwidth")
    lines = "\n".join(f"    {line}" for line in body)
    return rf"""\begin{{{shape}}}[t]
  \centering
  \caption{{\textbf{{{_latex(table.title)}.}} {_latex(full_caption(table, rows))}}}
  \label{{tab:{table.name}}}
  \resizebox{{{width}}}{{!}}{{%
  \begin{{tabular}}{{{align}}}
    \toprule
    {head}
    \midrule
{lines}
    \bottomrule
  \end{{tabular}}}}
\end{{{shape}}}
"""


def to_html(table: Table, rows: Sequence[Row], captioned: bool = True) -> str:
    """Format a table as an HTML table element. The text is ASCII, so that a page of any encoding can include the element.

    The columns FRONT come first. The further columns have the class "more"; a last line has the cells that are equal in all rows. Rows with
    a verdict come first; the id of a row has its number in the CSV.
    """
    names, cells = _cells(rows)
    told = case_columns(rows)
    equal = {c for k, c in enumerate(names) if len(cells) > 1 and len({line[k] for line in cells}) == 1}
    front = {*FRONT, "claim of the paper", "low", "high"}
    more = [(k, c) for k, c in enumerate(names) if c not in front | equal]
    kinds = {c: ' class="more number"' if _numeric(rows, c) else ' class="more"' for _, c in more}
    head = [*(f"<th scope=col>{c}</th>" for c in FRONT), *(f"<th scope=col{kinds[c]}>{html.escape(heading(c))}</th>" for _, c in more)]
    body = []
    numbered = list(enumerate(zip(rows, cells, strict=True), 1))
    for number, (row, line) in sorted(numbered, key=lambda item: not item[1][0]["verdict"]):
        first, rest = label(row, told)
        tone, paper = html.escape(slug(row["verdict"])), html.escape(_text(row["paper"]).replace(" +- ", " ± "))
        shown = [
            f"<th scope=row>{html.escape(first)}<small>{html.escape(rest)}</small></th>", f"<td>{html.escape(row['verdict'])}</td>",
            f"<td>{value(row)}</td>", f"<td>{paper}</td>", f"<td>{html.escape(why(row))}</td>",
        ]  # fmt: skip
        others = [f"<td{kinds[c]}>{html.escape(line[k])}</td>" for k, c in more]
        body.append(f'<tr id="{table.name}-{number}" class="{tone}">{"".join([*shown, *others])}</tr>')
    same = "; ".join(f"{heading(c)}: {cells[0][names.index(c)]}" for c in names if c in equal - front and cells[0])
    foot = f"<tfoot class=more><tr><td colspan={len(head)}>In every row: {html.escape(same)}</td></tr></tfoot>\n" if same else ""
    said = f"<strong>{html.escape(table.title)}.</strong> {html.escape(full_caption(table, rows))}"
    text = f"<caption>{said}</caption>\n" if captioned else ""
    lines = "\n".join(body)
    whole = f"<table>\n{text}<thead><tr>{''.join(head)}</tr></thead>\n<tbody>\n{lines}\n</tbody>\n{foot}</table>\n"
    return whole.encode("ascii", "xmlcharrefreplace").decode()


def case_columns(rows: Sequence[Row]) -> list[str]:
    """Return the columns that distinguish the cases of a table: words, or few different numbers, but no measured values."""

    def distinguishes(column: str) -> bool:
        cells = {_text(row.get(column)) for row in rows} - {""}
        words = cells - {"True", "False"}
        numeric = all(_NUMBER.fullmatch(cell) for cell in cells)
        several = len(cells) > 1 or (bool(cells) and any(not _text(row.get(column)) for row in rows))
        return bool(words) and several and (len(cells) <= LEVELS if numeric else len(cells) < max(len(rows), 3))

    return [c for c in columns(rows) if c not in _NO_CASE and distinguishes(c)][:CASES]


def label(row: Row, cases: Sequence[str]) -> tuple[str, str]:
    """Return the claim of a row, or its metric if it states none, and the case that it belongs to."""
    claim, metric = _text(row.get("claim of the paper") or row.get("claim")), _text(row["metric"])
    case = [_case(c, text) for c in cases if (text := _text(row.get(c)))]
    return claim or metric, ", ".join([*([metric] if claim else []), *case])


def _case(column: str, text: str) -> str:
    """Return a cell that describes a case: words as they are, a number with its unit ("0.5 m") or its column's name ("strength 0.5")."""
    if not _NUMBER.fullmatch(text):
        return text.replace("_", " ")
    unit = _UNITS.get(column.rpartition("_")[2]) if "_" in column else None
    return f"{_figure(text)} {unit}" if unit else f"{heading(column)} {_figure(text)}"


def value(row: Row) -> str:
    """Return the value of a row as HTML, with its interval if this has a width."""
    low, middle, high = (text_of(row[c]) for c in ("low", "value", "high"))
    if not middle:
        return "&#8211;"
    return middle if low == high or not (low or high) else f"{middle}<small>{low or 'below'} to {high or 'above'}</small>"


def why(row: Row) -> str:
    """Return why the verdict of a row follows from its interval, or why it has none."""
    if row.get("claim of the paper") and row.get("why"):
        return str(row["why"])
    if reason := row.get("reason"):
        return f"{reason[0].upper()}{reason[1:].rstrip('.')}."
    word, direction = row["verdict"], row.get("direction")
    if not word or not direction:
        limit = f"The limit is {text_of(row['limit'])}." if row.get("limit") not in (None, "") else ""
        return (limit if word else "") or _text(row.get("why")) or ("The claim states the limit." if word else "")
    if _text(row["value"]) == "":
        return "There is no value."
    if not _text(row["low"]) and not _text(row["high"]):
        return "There are too few samples for an interval."
    bound, null = text_of(row["bound"]), text_of(row["null"])
    if direction == "none":
        low, high = (text_of(float(row["null"] or 0) + sign * float(row["margin"] or 0)) for sign in (-1, 1))
        whole = dict.fromkeys(("supported", "holds"), "The whole interval is") | {"contradicted": "No part of the interval is"}
        return f"{whole.get(word, 'Only a part of the interval is')} within {low} to {high}."
    beyond, short = direction, "above" if direction == "below" else "below"
    first, last = (bound, null) if direction == "below" else (null, bound)
    ends = f"The interval reaches from {first} or less to {last} or more."
    return {
        "supported": f"The whole interval is {beyond} {bound}.",
        "holds": f"It is {beyond} the limit {bound}.",
        "misses": f"It is not wholly {beyond} the limit {bound}.",
        "direction shown": f"The whole interval is {beyond} {null}, but not {beyond} {bound}.",
        "contradicted": f"The whole interval is {short} {bound}.",
    }.get(word, f"The interval contains {bound}." if bound == null else ends)


def _cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    names = [c for c in columns(rows) if c != "run_keys"]
    return names, [[text_of(row.get(c), c) or ("–" if c == "value" else "") for c in names] for row in rows]


def _numeric(rows: Sequence[Row], column: str) -> bool:
    return column != "paper" and all(_NUMBER.fullmatch(_text(row.get(column))) for row in rows)


def _text(cell: Any) -> str:
    return "" if cell is None else str(cell)


def text_of(cell: Any, column: str = "") -> str:
    """Format a cell, also one of a written CSV file, as text: a number that is not whole has three significant digits."""
    text = _text(cell)
    return text if column == "paper" or not _FLOAT.fullmatch(text) else _figure(text)


def _figure(text: str) -> str:
    number = float(text)
    return (f"{number:,.0f}" if 1000 <= abs(number) < 1e7 else f"{number:.3g}").replace("-", "−")


def slug(verdict: str) -> str:
    """Return the name of a verdict as a class of the page."""
    return verdict.replace(" ", "-")


def heading(column: str) -> str:
    """Return the heading of a table column with its unit in parentheses; for example, distance_m becomes "distance (m)"."""
    name, _, unit = column.rpartition("_")
    return f"{name} ({_UNITS[unit]})".replace("_", " ") if name and unit in _UNITS else column.replace("_", " ")


def _latex(text: str) -> str:
    return "".join(_LATEX.get(c, c) for c in text)
