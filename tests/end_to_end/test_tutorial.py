"""The cells of the tutorial notebook run in their order, and their results agree with its text. The site executes it in a kernel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import nbformat
import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "tutorial.ipynb"


def test_the_tutorial_shows_what_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    shown: dict[str, Any] = {}
    for cell in nbformat.read(NOTEBOOK, as_version=4).cells:
        if cell.cell_type == "code":
            exec(compile(cell.source, NOTEBOOK.name, "exec"), shown)
    assert len(shown["axes"].lines) == 2, "the range profiles are drawn"
    plt.close(shown["figure"])
    assert capsys.readouterr().err == ""
    assert shown["peak_m"] == {"void": pytest.approx(2.0, abs=0.03), "room": pytest.approx(2.0, abs=0.03)}
    decibels = {name: 10 * shown["np"].log10(shown[name]) for name in ("near", "far", "level")}
    assert -1.5 < decibels["near"] - decibels["far"] < -0.2
    strongest = 10 * shown["np"].log10(shown["profiles"]["void"].power[0].max())
    assert abs(strongest - decibels["level"] - shown["gain_db"]) < 1.0, "the strongest bin reads the level of the near-field cross-section"
    # mean of six pairs of noise seeds: 0.305, from 0.29 to 0.32
    assert shown["agreement"]["room"][1] > shown["agreement"]["void"][1] + 0.25
    assert shown["errors"]["wall_front"] < 0.1
    assert list(tmp_path.iterdir()) == []
