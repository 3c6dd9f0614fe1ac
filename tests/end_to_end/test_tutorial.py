"""The tutorial notebook runs from its first to its last cell in a separate kernel, and its results agree with its text."""

from __future__ import annotations

import json
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "tutorial.ipynb"
# Checks of the claims of the text, run in the kernel after the last cell.
CLAIMS = """
import json
print(json.dumps({"peak_m": peak_m, "agreement": agreement, "near_db": float(10 * np.log10(near / far)),
                  "level_db": float(10 * np.log10(profiles["void"].power[0].max()) - 10 * np.log10(level) - gain_db), "walls_db": errors}))
"""


# The kernel uses its own loopback sockets; zmq and tornado may warn about the event loop.
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::RuntimeWarning", "ignore::ResourceWarning")
def test_the_tutorial_shows_what_it_says(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    notebook.cells.append(nbformat.v4.new_code_cell(CLAIMS))
    NotebookClient(notebook, timeout=240, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in shown), "the range profile is drawn"
    assert not [output.text for output in shown if output.get("name") == "stderr"]
    found = json.loads(shown[-1].text)
    assert found["peak_m"] == {"void": pytest.approx(2.0, abs=0.03), "room": pytest.approx(2.0, abs=0.03)}
    assert -1.5 < found["near_db"] < -0.2
    assert abs(found["level_db"]) < 1.0, "the strongest bin reads the level of the near-field cross-section"
    # mean of six pairs of noise seeds: 0.305, from 0.29 to 0.32
    assert found["agreement"]["room"][1] > found["agreement"]["void"][1] + 0.25
    assert found["walls_db"]["wall_front"] < 0.1
    assert list(tmp_path.iterdir()) == []
