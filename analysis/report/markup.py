"""Write the report page as HTML from the template `page/page.html`, which escapes all text of tables, runs and scenes."""

import base64
import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import jinja2
import pandas as pd

from analysis.pages import paper_tables
from analysis.pages.template import interval, number
from analysis.report.content import ABSENT, LEFT_OUT, LINKED, Section
from analysis.report.origin import Origin
from analysis.report.room_pages import RoomPage
from analysis.tables import slug
from radartwin.io.one_line import plural
from radartwin.runs.experiment import LIMITS, VERDICTS
from radartwin.store.products import SHORT

FOLDER = Path(__file__).with_name("page")
HEADLINE, FIRST = "headline", ("speed_accuracy", "stability")  # tables that are shown before the list of tables
NO_VERDICT = "without a verdict"
SHOWN = "Table 3"  # start of the title of the section of the paper that is shown unfolded


def page(sections: Sequence[Section], rooms: Sequence[RoomPage], origin: Origin) -> str:
    """Return the HTML of the whole report page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    helpers = {"plural": plural, "slug": slug, "seconds": lambda seconds: f"{seconds:,.{0 if seconds >= 10 else 1}f} core-seconds"}
    environment.filters |= helpers
    by_name = {section.table.name: section for section in sections}
    script = (FOLDER / "page.js").read_text(encoding="utf-8")
    present = [section for section in sections if not section.absent]

    def read(name: str) -> pd.DataFrame:
        return pd.DataFrame(by_name[name].rows if name in by_name else [])

    return environment.get_template("page.html").render(
        **helpers,
        script=script,
        script_digest=base64.b64encode(hashlib.sha256(f"\n{script}".encode()).digest()).decode(),
        style=(FOLDER / "page.css").read_text(encoding="utf-8"),
        answer=answer(by_name[HEADLINE].rows),
        headline=by_name[HEADLINE],
        first=[by_name[name] for name in FIRST],
        rest=[section for section in sections if section.table.name not in (HEADLINE, *FIRST) and section.absent != LEFT_OUT],
        left_out=[section for section in sections if section.absent == LEFT_OUT],
        sections=sections,
        present=present,
        count=sum(len(section.rows) for section in sections),
        verdicts=sum((section.verdicts for section in sections), Counter[str]()),
        order=(*VERDICTS, *LIMITS),
        reasons={state: text for state, text in ABSENT.items() if state != LEFT_OUT},
        linked=LINKED,
        short=SHORT,
        testbed=any("testbed" in row["domain"] for section in sections for row in section.rows),
        paper=[(*section, section[0].startswith(SHOWN)) for section in paper_tables.html(read)],
        rooms=rooms,
        origin=origin,
    )


def answer(headline: Sequence[Mapping[str, str]]) -> str:
    """Return the answer to the question of the report in two sentences, from the rows of the table `headline`; "" without this table."""

    def row(table: str, start: str = "") -> Mapping[str, str] | None:
        return next((row for row in headline if row["table"] == table and row["claim of the paper"].startswith(start)), None)

    known, labels, room = row("rover_recognition"), row("reconstruction_ablation", "labelled"), row("reconstruction_ablation", "the")
    if not (known and labels and room):
        return ""
    counts = Counter(row["verdict"] or NO_VERDICT for row in headline)
    told = [f"{counts[word]} {word}" for word in (*VERDICTS, NO_VERDICT) if counts[word]]
    told[0] = told[0].replace(" ", " are ", 1)
    helps = {words: row["verdict"] or NO_VERDICT for words, row in (("the labelled materials help", labels), ("the room helps", room))}
    doubts = [f"that {' and '.join(w for w in helps if helps[w] == word)} is {word}" for word in dict.fromkeys(helps.values())]
    return (
        f"Without real labels, the model recognises objects on drives with an accuracy of {interval(known)}, where chance is "
        f"{number(known['null'])} and the paper has {known['paper'].replace('+-', '±')}; that it knows more than chance is "
        f"{known['verdict'] or NO_VERDICT}. Of the {len(headline)} main claims of the paper, {', '.join(told[:-1])} and {told[-1]}; "
        f"{', and '.join(doubts)}."
    )
