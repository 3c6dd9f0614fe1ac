"""Write the page docs/findings.md from its template and the committed tables in docs/results."""

from pathlib import Path

from analysis.pages.template import RESULTS, ROOT, Row, chosen, committed, filled, verdicts
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
        table = f"{folder}/{headline.table}"
        if (RESULTS / f"{table}.csv").is_file():
            for row in chosen(committed(table), table, {"metric": headline.metric, **headline.where}):
                if row["claim"]:
                    made[headline.text] = row
    return made
