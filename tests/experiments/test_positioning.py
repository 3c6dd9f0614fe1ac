"""The paper's comparison table is transcribed with its quotations, and the row about RadarTwin shows the results of the checks."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from experiments.positioning import capabilities, positioning
from experiments.positioning.positioning import AXES, CELLS, OURS, SAID, source

PAPER = Path(__file__).resolve().parents[3] / "shared" / "paper" / "000_31ddca36523a097c.txt"
needs_paper = pytest.mark.skipif(not PAPER.is_file(), reason=f"{PAPER} is not here: the paper's text is not part of the repository")


def plain(cell: str) -> str:
    """Convert a cell of the LaTeX table to the words that the function `cells` uses."""
    cell = re.sub(r"~\\cite\{[^}]*\}|\\textbf|\{|\}", "", cell)
    for mark, word in (
        (r"\cmark", "yes"), (r"\xmark", "no"), (r"\pmark", "partly"), (r"\projectname", OURS), (r"$\rightarrow$", " -> "), (r"\,", " "),
        (r"\&", "&"), ("~", " "), (r"\ ", " "),
    ):  # fmt: skip
        cell = cell.replace(mark, word)
    return re.sub(r"\s+", " ", cell).strip()


@needs_paper
def test_cells_equal_the_papers_table() -> None:
    table = PAPER.read_text().split(r"\label{tab:positioning}")[1].split(r"\end{tabular}")[0]
    lines = [line for line in table.splitlines() if line.count("&") - line.count(r"\&") == len(AXES) and "Mechanism" not in line]
    read = {}
    for line in lines:
        name, *cells = (plain(cell) for cell in re.split(r"(?<!\\)&", line.replace(r"\\", "")))
        read[name.replace(" (Ours)", "")] = tuple(cells)
    assert read == {name: tuple(cells) for name, cells in CELLS.items()}


@needs_paper
def test_quotations_occur_in_the_paper() -> None:
    text = re.sub(r"\s+", " ", re.sub(r"~\\cite\{[^}]*\}", "", PAPER.read_text()))
    for where, said in SAID.items():
        assert said in text, where
        assert where[0] in CELLS
        assert where[1] in AXES
        assert said in source(*where)


@pytest.mark.parametrize("axis", AXES)
def test_our_capabilities_agree_with_the_papers_table(axis: str) -> None:
    capability, right = capabilities.CHECKS[OURS][axis]()
    assert right, capability
    assert capability.startswith(CELLS[OURS][AXES.index(axis)])


def test_cell_of_a_failed_check_is_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    for axis in AXES:
        monkeypatch.setitem(capabilities.CHECKS[OURS], axis, lambda: ("as ever", True))
    monkeypatch.setitem(capabilities.CHECKS[OURS], "multipath", lambda: ("no (1-bounce)", False))
    line = positioning.row(OURS)
    assert (line["multipath"], line["real scene"], line["verdict"]) == ("", "as ever", "misses")
    assert line["value"] == pytest.approx(6 / 7)


def test_rfgenesis_has_one_bounce_and_one_material() -> None:
    """The paper of RF-Genesis claims multipath propagation, but the released program traces one bounce and one material."""
    line = positioning.row("RF-Genesis")
    assert (line["verdict"], line["value"], line["n"]) == ("misses", 0.5, 2)
    assert "multipath: no (1-bounce), not yes" in line["checked here"]
