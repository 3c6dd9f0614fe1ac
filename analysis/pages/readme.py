"""Write the table of main claims in README.md from the committed table `headline`."""

from __future__ import annotations

import re
from pathlib import Path

from analysis.pages.filled import RESULTS, ROOT, filled, rows_of
from radartwin.io import files

PAGE = ROOT / "README.md"
TABLE = re.compile(r"(\| claim of the paper \|[^\n]*\n\|[-|]*\n)((?:\|[^\n]*\n)*)")
COLUMNS = "claim of the paper, metric, paper, value, draws, verdict, over all strengths"
CLAIMS = (
    "the simulated order of objects by harmonic ratio is the measured order",
    "metal is brighter than plastic (1 m)",
    "the room brings the profile closer to the measured one (2 m, amplitude)",
    "most energy arrives from beyond the target (2 m)",
    "features order objects alike along drives (squash court)",
    "training on simulation beats raw features (other recordings)",
    "training on simulation beats raw features (other revolutions)",
    "geometry transfers without labels",
    "identity does not transfer without labels",
    "labelled materials beat one material",
)


def text(folder: Path = RESULTS) -> str:
    """Return README.md with a line for each of CLAIMS that is in the table `headline` of the folder. The table of the quick profile lacks
    the claims that this profile cannot test.
    """
    known = {row["claim of the paper"] for row in rows_of("headline", folder)}
    lines = [filled(f"{{{{rows headline: {COLUMNS} | claim of the paper={claim}}}}}", folder) for claim in CLAIMS if claim in known]
    rows = "".join(f"{line}\n" for line in lines)
    page, number = TABLE.subn(lambda found: found[1] + rows, PAGE.read_text(encoding="utf-8"))
    if number != 1:
        raise ValueError(f"{PAGE}: {number} tables begin with 'claim of the paper', not one")
    return page


def write() -> None:
    """Write the page."""
    files.write_atomically(PAGE, text())
