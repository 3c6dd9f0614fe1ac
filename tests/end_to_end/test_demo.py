"""The command `radartwin demo` replaces unfinished files of an earlier run, and its page names the thing from which each echo comes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from radartwin.commands import demo
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.reconstruct.build import FACE_SURFACES_FILE
from radartwin.scene.scene import Scene
from radartwin.scene.thing_names import things


def test_the_shipped_scan_is_below_one_megabyte() -> None:
    assert sum(path.stat().st_size for path in demo.SCAN.parent.iterdir()) < 1e6


@pytest.mark.slow
def test_the_demonstration_ends_with_a_page_that_names_the_things(inside, chromium, tmp_path: Path) -> None:
    folder = tmp_path / "mine" / "demo"
    (folder / "scene").mkdir(parents=True)
    (folder / "scene" / FACE_SURFACES_FILE).write_bytes(b"")  # the file that a reconstruction writes first, as if a run had been killed
    done = inside("demo", "--output", "mine")
    assert done.returncode == 0, done.stderr
    *steps, last = done.stdout.splitlines()
    assert [line[:5] for line in steps] == [f"[{n}/{demo.STEPS}]" for n in range(1, demo.STEPS + 1)]
    page = tmp_path / last
    assert page == folder / "index.html"
    assert not list(folder.rglob("*.tmp"))
    scene = Scene.load(folder / "scene")
    found = dict(zip(map(str, things(scene)), scene, strict=True))
    named = {"paper wall behind the sofa", "low table beside the bookshelf", "bookshelf beside the sofa", "rug under the low table"}
    assert named <= set(found)
    answered = [surface for surface in scene if surface.provenance["source"] == "vlm"]
    assert sum(s.mesh.area for s in answered) > 0.99 * sum(s.mesh.area for s in scene)

    tab = chromium()
    tab.call("Page.navigate", url=page.as_uri())
    tab.until("document.readyState === 'complete' && document.querySelector('#room').contentDocument.body.dataset.ready === 'yes'")
    rows = tab.run("[...document.querySelectorAll('#peaks tbody tr')].map(r => [...r.children].map(c => c.textContent))")
    assert tab.messages == [], "the page loads nothing from a network and reports no error"
    tab.screenshot("demo")
    bin_m = SPEED_OF_LIGHT / (2 * 70e12 * 256 / 5.21e6)  # range bin c/2B
    # The two strongest echoes: the metal reflector on the table, and the wall that the radar faces, at its distance.
    assert {row[1] for row in rows[:2]} == {"corner reflector on the low table", "paper wall behind the sofa"}
    wall = next(row for row in rows if row[1] == "paper wall behind the sofa")
    distance_m = demo.POSITION_M[1] - found["paper wall behind the sofa"].mesh.bounds[:, 1].mean()
    assert float(wall[2]) == pytest.approx(distance_m, abs=bin_m)
    assert wall[5].startswith("paper (simulated as "), "a substitute is named beside the material"
    echoes = tab.run("document.querySelector('#map').textContent")
    assert sum(bool(re.search(rf"\b{row[0]}\s+{row[1]}", echoes)) for row in rows) >= 5, "the map names the echoes"
    with Image.open(folder / "demo.png") as strip:
        assert strip.width == 1500
        assert np.asarray(strip.convert("RGB")).std() > 30
    assert (folder / "demo.png").stat().st_size < 250_000
