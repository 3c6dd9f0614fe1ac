"""Write the report page as HTML from the template `page/page.html`, which escapes all text of tables, runs and scenes."""

from __future__ import annotations

import base64
import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import jinja2
import pandas as pd

from analysis.pages import paper_tables
from analysis.registry import TESTBED_NOTE
from analysis.report.content import ABSENT, LINKED, Section, figure
from analysis.report.origin import Origin
from analysis.report.room_pages import RoomPage
from analysis.tables import slug
from radartwin.io.one_line import plural
from radartwin.runs.experiment import LIMITS, VERDICTS
from radartwin.store.products import SHORT

FOLDER = Path(__file__).with_name("page")
FIRST = ("reality", "speed_accuracy", "stability", "gallery")  # tables that are shown above the others
OPEN_ROWS = 12  # a table with more rows starts folded, and unfolds in print


def page(sections: Sequence[Section], rooms: Sequence[RoomPage], origin: Origin, parts: str) -> str:
    """Return the HTML of the whole report page. `parts` is the name of the folder that the links of the page point to."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    helpers = {"plural": plural, "slug": slug, "figure": figure, "seconds": _seconds}
    environment.filters |= helpers
    by_name = {section.table.name: section for section in sections}
    first = [by_name[name] for name in FIRST if name in by_name]
    claims = [claim for section in sections for claim in section.claims]
    script = (FOLDER / "page.js").read_text(encoding="utf-8")
    return environment.get_template("page.html").render(
        **helpers,
        script=script,
        script_digest=base64.b64encode(hashlib.sha256(f"\n{script}".encode()).digest()).decode(),
        style=(FOLDER / "page.css").read_text(encoding="utf-8"),
        parts=parts,
        sections=sections,
        present=[section for section in sections if not section.absent],
        first=first,
        rest=[section for section in sections if section not in first],
        count=sum(len(section.rows) for section in sections),
        claims=sorted(claims, key=lambda claim: claim.verdict not in ("contradicted", "misses")),
        verdicts=Counter(claim.verdict for claim in claims),
        order=(*VERDICTS, *LIMITS),
        reasons=ABSENT,
        linked=LINKED,
        open_rows=OPEN_ROWS,
        short=SHORT,
        note=TESTBED_NOTE if any("testbed" in row["domain"] for section in sections for row in section.rows) else "",
        paper=paper_tables.html(lambda name: pd.DataFrame(by_name[name].rows) if name in by_name else pd.DataFrame()),
        rooms=rooms,
        origin=origin,
    )


def _seconds(seconds: float) -> str:
    return f"{seconds:,.0f} core-seconds" if seconds >= 10 else f"{seconds:.1f} core-seconds"
