"""Write the page docs/findings.md from its template and the committed tables in docs/results."""

from pathlib import Path

from analysis.pages.template import ROOT, filled, verdicts

PAGE = ROOT / "docs" / "findings.md"
TEMPLATE = Path(__file__).with_name("findings_template.md")


def text() -> str:
    """Return the page as Markdown."""
    return filled(TEMPLATE.read_text(encoding="utf-8"), counts=verdicts("registered/headline"))
