"""Write the page docs/findings.md from its template and the committed tables in docs/results."""

from pathlib import Path

from analysis.pages.template import RESULTS, ROOT, Row, committed, filled, has, verdicts
from experiments.gaps.headline import HEADLINES

PAGE = ROOT / "docs" / "findings.md"
TEMPLATE = Path(__file__).with_name("findings_template.md")


def text() -> str:
    """Return the page as Markdown."""
    content = {"counts": verdicts("registered/headline"), "again": claimed("draws_0_to_9")}
    return filled(TEMPLATE.read_text(encoding="utf-8"), **content)


def claimed(folder: str) -> dict[str, Row]:
    """Return the rows of the paper's main claims, by their words, in those of their tables that a folder of docs/results has."""
    made = {}
    for headline in HEADLINES:
        table, where = f"{folder}/{headline.table}", {"metric": headline.metric, **headline.where}
        listed = committed(table).to_dict("records") if (RESULTS / f"{table}.csv").is_file() else []
        for row in listed:
            if row["claim"] and all(has(row, *cell, table) for cell in where.items()):
                made[headline.text] = row
    return made
