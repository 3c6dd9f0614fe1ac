"""Write the report page as HTML. This module escapes all text that comes from tables, runs and scenes."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

import pandas as pd

from analysis.pages import paper_tables
from analysis.registry import TESTBED_NOTE
from analysis.report import claims
from analysis.report.content import ABSENT, LINKED, Section
from analysis.report.origin import Origin, Run
from analysis.report.rooms import Shown
from analysis.tables import caption, slug
from radartwin.io.one_line import plural
from radartwin.store.products import SHORT

FOLDER = Path(__file__).with_name("page")
FIRST = ("reality", "speed_accuracy", "stability", "gallery")  # tables that are shown above the others
OPEN_ROWS = 12  # a table with more rows starts folded, and unfolds in print
_CAPTION = re.compile(r"<caption>.*?</caption>\n?", re.DOTALL)  # caption from tables.to_html; this page shows it above the figures instead


def page(sections: Sequence[Section], shown: Sequence[Shown], origin: Origin, parts: str) -> str:
    """Return the HTML of the whole report page. `parts` is the name of the folder that the links of the page point to."""
    by_name = {section.table.name: section for section in sections}
    first = [by_name[name] for name in FIRST if name in by_name]
    rest = [section for section in sections if section not in first]
    script = (FOLDER / "page.js").read_text(encoding="utf-8")
    filled = {
        "script_digest": base64.b64encode(hashlib.sha256(f"\n{script}".encode()).digest()).decode(),
        "style": (FOLDER / "page.css").read_text(encoding="utf-8"),
        "script": script,
        "note": escape(TESTBED_NOTE) if any("testbed" in row["domain"] for section in sections for row in section.rows) else "",
        "contents": _contents(first, rest),
        "paper": paper_tables.html(lambda name: pd.DataFrame(by_name[name].rows) if name in by_name else pd.DataFrame()),
        "summary": claims.summary(sections),
        "first": "\n".join(_section(section, parts, 2) for section in first),
        "rooms": "\n".join(_room(room, parts) for room in shown),
        "tables": "\n".join(_section(section, parts, 3) for section in rest),
        "origin": _origin(origin),
    }
    # One pass, so that no placeholder is replaced inside inserted content.
    return re.sub(r"\{\{(\w+)\}\}", lambda found: filled[found[1]], (FOLDER / "page.html").read_text(encoding="utf-8"))


def _contents(first: Sequence[Section], rest: Sequence[Section]) -> str:
    def links(sections: Sequence[Section]) -> str:
        return "".join(
            f'<li><a href="#{s.table.name}">{escape(s.table.title)}</a>{f" <span class=absent>{s.absent}</span>" if s.absent else ""}</li>'
            for s in sections
        )

    return (
        f'<li><a href="#paper">The paper\'s tables</a></li><li><a href="#summary">Summary</a></li>{links(first)}'
        '<li><a href="#rooms">The rooms</a></li>'
        f'<li><a href="#tables">Tables</a><ul>{links(rest)}</ul></li><li><a href="#origin">Origin of the report</a></li>'
    )


def _section(section: Section, parts: str, level: int) -> str:
    name, title = section.table.name, escape(section.table.title)
    head = f'<section id="{name}" class="table" aria-labelledby="{name}-title">\n<h{level} id="{name}-title">{title}</h{level}>\n'
    if section.absent:
        return f"{head}{absent(section)}\n</section>"
    told = f'<p class="caption" id="{name}-caption">{escape(caption(section.table, section.rows))}</p>\n'
    figures = "\n".join(_figure(section, figure, parts) for figure in section.figures)
    return f"{head}{verdicts(section)}{told}{_chart(section, parts)}{figures}\n{_table(section)}{_files(section, parts)}\n</section>"


def absent(section: Section) -> str:
    """Return the HTML that replaces an absent table: the reason, and the command that makes the table."""
    error = f" <code>{escape(section.error)}</code>" if section.error else ""
    return (
        f'<p class="absent"><strong>{section.absent}</strong>: {ABSENT[section.absent]}{error} '
        f'<span class="command">Make it: <code>{escape(section.command)}</code></span></p>'
    )


def verdicts(section: Section) -> str:
    """Return HTML with the number of claims of a table for each verdict."""
    count = section.verdicts
    if not count:
        return f'<p class="verdicts">{plural(len(section.rows), "row")}, none of them a claim.</p>\n'
    told = ", ".join(f'<span class="{slug(verdict)}">{count[verdict]} {verdict}</span>' for verdict in claims.ORDER if count[verdict])
    return f'<p class="verdicts">{plural(sum(count.values()), "claim")}: {told}; {plural(len(section.rows), "row")}.</p>\n'


def _figure(section: Section, name: str, parts: str) -> str:
    spoken = escape(f"{section.table.title}: {spoken_name(section, name)}")
    stem = _link(parts, f"figures/{name}")
    width, height = section.pixels(name)
    return (
        f'<figure><a href="{stem}.png"><img loading="lazy" decoding="async" src="{stem}.png" alt="{spoken}" '
        f'width="{width}" height="{height}"></a>\n'
        f'<figcaption>{escape(spoken_name(section, name))} · <a href="{stem}.pdf">PDF</a></figcaption></figure>'
    )


def spoken_name(section: Section, figure: str) -> str:
    """Return the name of a figure as shown on the page; for example, the file validation_room_profile becomes "room profile"."""
    return figure.removeprefix(f"{section.table.name}_").replace("_", " ")


def _link(parts: str, part: str) -> str:
    """Return the link from index.html to a file in the parts folder, escaped for use in an HTML attribute."""
    return escape(quote(f"{parts}/{part}"))


def _chart(section: Section, parts: str) -> str:
    if not section.table.chart:
        return ""
    link = _link(parts, f"figures/{section.table.name}_page.html")
    return f'<p class="chart"><a href="{link}" data-here>interactive chart</a>: choose the axes, zoom, read all values of a point.</p>\n'


def _table(section: Section) -> str:
    name, count = section.table.name, len(section.rows)
    unfolded = " open" if count <= OPEN_ROWS else ""
    body = _CAPTION.sub("", section.text, count=1).replace("<table>", f'<table data-tools aria-labelledby="{name}-title">', 1)
    return (
        f"<details{unfolded}><summary>Table, {plural(count, 'row')}</summary>\n"
        f'<div class="scroll" role="region" tabindex="0" aria-labelledby="{name}-title">\n{body}</div>\n</details>\n'
    )


def _files(section: Section, parts: str) -> str:
    name = section.table.name
    links = ", ".join(f'<a href="{_link(parts, f"tables/{name}.{suffix}")}">{suffix}</a>' for suffix in LINKED)
    run = f'<a href="#run-{name}">run <code>{escape(section.run_key[:SHORT])}</code></a>'
    return f'<p class="files">Profile {escape(section.profile)}, {run}. The table as {links}.</p>'


def _room(room: Shown, parts: str) -> str:
    size = " × ".join(f"{length:.1f}" for length in room.size_m)
    page, picture, name = _link(parts, room.page), _link(parts, room.picture), escape(room.name)
    return (
        f'<figure class="room"><a href="{page}"><img loading="lazy" decoding="async" src="{picture}" '
        f'alt="the {name} from one corner" width="{room.pixels}" height="{room.pixels}"></a>\n'
        f'<figcaption>{name}, {size} m, {plural(room.surfaces, "surface")} · <a href="{page}" data-here>turn it</a></figcaption></figure>'
    )


def _origin(origin: Origin) -> str:
    lines = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in origin.written_by)
    seeds = sorted({run.seed for run in origin.runs if run.seed is not None})
    profiles = sorted({run.section.profile for run in origin.runs})
    lines += f"<dt>profile</dt><dd>{escape(', '.join(profiles) or '–')}</dd><dt>seed</dt><dd>{', '.join(map(str, seeds)) or '–'}</dd>"
    products = plural(len(origin.made), "product")
    made = f"; the {products} they use took {_seconds(sum(origin.made.values()))} to make" if origin.made else ""
    lines += f"<dt>cost</dt><dd>{_seconds(origin.core_seconds)} of these runs, with the products that each of them made{made}</dd>"
    heads = ("table", "profile", "seed", "run key", "finished", "took", "computed from", "MLflow run")
    head = "".join(f'<th scope="col">{one}</th>' for one in heads)
    rows = "\n".join(_run(run) for run in origin.runs)
    why = f"<p>{escape(origin.tracking)}</p>" if origin.tracking else ""
    return (
        f'<dl class="origin">{lines}</dl>\n{why}<div class="scroll" role="region" tabindex="0" aria-label="runs">\n'
        f"<table data-tools><thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>"
    )


def _run(run: Run) -> str:
    name = run.section.table.name
    made = f"{plural(len(run.made), 'product')}, {_seconds(sum(run.made.values()))}" if run.made else "–"
    link = f'<a href="{escape(run.mlflow)}"><code>{escape(run.mlflow.rpartition("/")[2][:SHORT])}</code></a>' if run.mlflow else "–"
    cells = (
        f'<a href="#{name}">{escape(run.section.table.title)}</a>', escape(run.section.profile), "–" if run.seed is None else str(run.seed),
        f"<code>{escape(run.section.run_key)}</code>", escape(run.finished) or "–",
        "–" if run.core_seconds is None else _seconds(run.core_seconds), made, link,
    )  # fmt: skip
    return f'<tr id="run-{name}">' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _seconds(seconds: float) -> str:
    return f"{seconds:,.0f} core-seconds" if seconds >= 10 else f"{seconds:.1f} core-seconds"
