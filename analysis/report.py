"""The static report: one page with every table, its figures and where they come from. No network, no script."""

from __future__ import annotations

import html
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.registry import Table
from radartwin import __version__, files
from radartwin.provenance import commit

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 78rem; margin: 2rem auto; padding: 0 1rem; color: #1b1b1b; }
table { border-collapse: collapse; width: 100%; font-size: 13px; margin: 1rem 0; font-variant-numeric: tabular-nums; }
.number { text-align: right; white-space: nowrap; }
caption { text-align: left; padding-bottom: .5rem; }
th, td { padding: .25rem .6rem; text-align: left; border-bottom: 1px solid #ddd; }
thead th { border-bottom: 2px solid #333; border-top: 2px solid #333; }
tr.holds td:last-child { color: #00704f; } tr.fails td:last-child { color: #a83e00; font-weight: 600; }
.absent { color: #a83e00; }
tr.untestable td:last-child { color: #666; }
figure { margin: 1rem 0; } img { max-width: 100%; } figcaption, footer, .files { font-size: 13px; color: #555; }
"""


MISSING, STALE = "not run", "stale"


@dataclass(frozen=True)
class Section:
    """One table of the report: its HTML, the stems of its figures, and the run it was computed by; or why there is none."""

    table: Table
    html: str
    figures: Sequence[Path]
    run_key: str
    profile: str
    absent: str = ""  # MISSING | STALE


def write(sections: Sequence[Section], output: Path) -> Path:
    """Write OUTPUT/report/index.html; its path. Figures and tables are linked relative to it, so the folder can be
    moved whole.
    """
    page = output / "report" / "index.html"
    head, dirty = commit()
    body = "\n".join(_section(section, output, page.parent) for section in sections)
    contents = "".join(
        f'<li><a href="#{s.table.name}">{html.escape(s.table.title)}</a>{f" ({s.absent})" if s.absent else ""}</li>' for s in sections
    )
    made = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())
    code = f"commit {head[:12]}{' with local changes' if dirty else ''}" if head != "none" else "no repository"
    text = (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>RadarTwin report</title><style>{_STYLE}</style></head>\n"
        f"<body>\n<h1>RadarTwin</h1>\n<ul>{contents}</ul>\n{body}\n"
        f"<footer>Written {made} by radartwin {html.escape(__version__)}, {code}.</footer>\n</body></html>\n"
    )
    return files.write_atomically(page, text)


def _section(section: Section, output: Path, start: Path) -> str:
    name = section.table.name
    if section.absent:
        return _absent(section)
    figures = "\n".join(
        f'<figure><img src="{_relative(stem, ".png", start)}" alt="{html.escape(_spoken(stem))}">'
        f"<figcaption>{html.escape(_spoken(stem))} "
        f'(<a href="{_relative(stem, ".html", start)}">zoom and values</a>, <a href="{_relative(stem, ".pdf", start)}">PDF</a>)'
        "</figcaption></figure>"
        for stem in section.figures
    )
    links = " ".join(
        f'<a href="{_relative(output / "tables" / name, suffix, start)}">{suffix[1:]}</a>' for suffix in (".csv", ".md", ".tex")
    )
    if section.table.page:
        links += f' <a href="{_relative(output / "figures" / name, "_page.html", start)}">interactive chart</a>'
    origin = f"Profile {section.profile}, run {section.run_key[:8]}. Files: {links}."
    return (
        f'<section id="{name}">\n<h2>{html.escape(section.table.title)}</h2>\n{figures}\n{section.html}'
        f'<p class="files">{origin}</p>\n</section>'
    )


def _absent(section: Section) -> str:
    """What a reader finds in place of a table, with the command that makes it."""
    why = "The run is of an earlier source or configuration" if section.absent == STALE else "This table has not been run"
    command = f"radartwin tables --profile {section.profile} --only {section.table.name}"
    return (
        f'<section id="{section.table.name}">\n<h2>{html.escape(section.table.title)}</h2>\n'
        f'<p class="absent">{section.absent}: {why}; <code>{html.escape(command)}</code></p>\n</section>'
    )


def _relative(stem: Path, suffix: str, start: Path) -> str:
    return html.escape(Path(os.path.relpath(stem.with_name(stem.name + suffix), start)).as_posix())


def _spoken(stem: Path) -> str:
    return stem.name.replace("_", " ")
