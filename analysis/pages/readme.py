"""Write Table 3 of the paper and the number of each verdict on its main claims in README.md, from the committed tables."""

from __future__ import annotations

import re

from analysis.pages import paper_tables
from analysis.pages.template import ROOT, wrapped
from radartwin.runs.experiment import VERDICTS

PAGE = ROOT / "README.md"
PART = re.compile(r"Of the \d+ main claims.*?(?=\n\n[^|\n])", re.DOTALL)


def text() -> str:
    """Return README.md with the verdicts of the table `headline` and Table 3."""
    verdicts = paper_tables.committed("headline")["verdict"]
    counts = ", ".join(f"{(verdicts == verdict).sum()} {verdict}" for verdict in VERDICTS)
    table = next(table for title, _, table in paper_tables.tables() if title.startswith("Table 3"))
    again = f"{(verdicts == '').sum()} are made again in version 1.1"
    counted = wrapped(f"Of the {len(verdicts)} main claims (`headline`), the verdicts are: {counts}; {again}.")
    part = f"{counted}\n\n{paper_tables.markdown(table)}"
    page, number = PART.subn(lambda _: part, PAGE.read_text(encoding="utf-8"))
    if number != 1:
        raise ValueError(f"{PAGE}: {number} paragraphs begin with 'Of the N main claims', not one")
    return page
