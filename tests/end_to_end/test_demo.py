"""The command `radartwin demo` replaces unfinished files of an earlier run, and its page shows the room, the peaks and their surfaces."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from radartwin.commands import demo
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.reconstruct.build import FACE_SURFACES_FILE
from radartwin.scene.scene import Scene


@pytest.mark.slow
def test_the_demonstration_ends_with_a_page_that_names_the_surfaces(inside, chromium, tmp_path: Path) -> None:
    folder = tmp_path / "mine" / "demo"
    (folder / "scene").mkdir(parents=True)
    (folder / "chair.obj").write_text("v 0 0")  # as if an earlier run had been killed
    (folder / "scene" / FACE_SURFACES_FILE).write_bytes(b"")  # the file that a reconstruction writes first
    done = inside("demo", "--output", "mine")
    assert done.returncode == 0, done.stderr
    *steps, last = done.stdout.splitlines()
    assert [line[:5] for line in steps] == [f"[{n}/6]" for n in range(1, 7)]
    page = tmp_path / last
    assert page == folder / "index.html"
    assert not list(folder.rglob("*.tmp"))
    assert (folder / demo.STRIP).read_bytes().startswith(b"\x89PNG")

    tab = chromium()
    tab.call("Page.navigate", url=page.as_uri())
    tab.until("document.readyState === 'complete' && document.querySelector('#room').contentDocument.body.dataset.ready === 'yes'")
    rows = tab.run("[...document.querySelectorAll('#peaks tbody tr')].map(r => [...r.children].map(c => c.textContent))")
    assert tab.messages == [], "the page loads nothing from a network and reports no error"
    tab.screenshot("demo")
    names = {surface.name for surface in Scene.load(folder / "scene")}
    assert {row[4] for row in rows} <= names
    # The radar is 0.6 m above the level floor, whose mirror image is the only echo at this range. A range bin is c/2B.
    bin_m = SPEED_OF_LIGHT / (2 * 70e12 * 256 / 5.21e6)
    floor = [row for row in rows if abs(float(row[1]) - demo.POSITION_M[2]) < bin_m]
    assert [row[4:6] for row in floor] == [["floor", "stone (45%)"]]
    # The chair's seat and back are the largest object between 1 m and 2 m before the radar.
    assert any(row[4] == "level_2" and 1.0 < float(row[1]) < 2.0 for row in rows)
    labels = json.loads((folder / "scene" / "manifest.json").read_text())
    assert labels
    echoes = tab.run("document.querySelector('#echoes').textContent")
    for number, row in enumerate(rows, 1):
        assert re.search(rf"\b{number} {row[4]}\b", echoes), "the picture marks the peak with its surface"
