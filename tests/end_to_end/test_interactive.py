"""The page of a figure in a real browser: values under the pointer, zoom and pan by pointer and keys, nothing on the console."""

from __future__ import annotations

import json
import re
from pathlib import Path

import browser
import numpy as np
import pytest

from radartwin import plotting

WIDTH, HEIGHT = 1000, 700


def drawn():
    figure, axes = plotting.figure(1, 3, height_in=2.5)
    axes[0].plot([0, 1, 2, 3], [1.0, 10.0, 100.0, 1000.0], "o-", label="rising")
    axes[0].set(yscale="log", xlabel="distance (m)", ylabel="level")
    axes[1].imshow(np.arange(12.0).reshape(3, 4), origin="lower", extent=(0, 4, 0, 3), aspect="auto")
    axes[2].bar([0, 1], [0.4, 0.8], label="share")
    axes[2].set_xticks([0, 1], ["mug", "can"])
    return figure


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plotting.save(drawn, tmp_path_factory.mktemp("figure") / "three_panels")[-1]


@pytest.fixture(scope="module")
def opened(path: Path, tmp_path_factory: pytest.TempPathFactory):
    executable = browser.find()
    if executable is None:
        pytest.skip("no Chromium here to open the page in; on Debian or Ubuntu: apt-get install chromium")
    with browser.browser(executable, tmp_path_factory.mktemp("profile")) as new:
        page = new()
        page.open(path, WIDTH, HEIGHT)
        yield page


def data_of(path: Path) -> dict:
    found = re.search(r"const data = (.*);\n", path.read_text(encoding="utf-8"))
    assert found
    return json.loads(found[1])


def test_the_page_knows_what_was_drawn_and_is_the_same_bytes_twice(path: Path, tmp_path: Path) -> None:
    left, middle, right = data_of(path)["axes"]
    assert left["series"] == [{"name": "rising", "points": [[0, 1], [1, 10], [2, 100], [3, 1000]]}]
    assert left["y"]["log"]
    assert middle["pictures"][0]["values"][2] == [8, 9, 10, 11]
    assert right["series"][0]["points"] == [[0, 0.4], [1, 0.8]]
    assert right["x"]["names"] == [[0, "mug"], [1, "can"]]
    again = plotting.save(drawn, tmp_path / "three_panels")[-1]
    assert again.read_bytes() == path.read_bytes()


def over(opened, axes: dict, x: float, y: float) -> str:
    """What is said with the pointer over shares x, y of a pair of axes."""
    x0, y0, x1, y1 = axes["box"]
    opened.run(
        f"""(() => {{ const b = svg.getBoundingClientRect(), X = {x0 + x * (x1 - x0)}, Y = {y1 - y * (y1 - y0)};
        holder.dispatchEvent(new PointerEvent("pointermove", {{bubbles: true,
          clientX: b.left + (X - view[0]) / view[2] * b.width, clientY: b.top + (Y - view[1]) / view[3] * b.height}})); }})()"""
    )
    return opened.run("told.textContent")


def test_values_under_the_pointer_are_those_of_the_data(opened, path: Path) -> None:
    left, middle, right = data_of(path)["axes"]

    def share(scale: dict, value: float) -> float:
        low, high, at = np.log([scale["low"], scale["high"], value]) if scale["log"] else (scale["low"], scale["high"], value)
        return (at - low) / (high - low)

    assert over(opened, left, share(left["x"], 2) + 0.01, share(left["y"], 100)) == "rising · distance (m) 2 · level 100"
    assert over(opened, middle, 0.6, 0.9).endswith("value 10")
    assert "can" in over(opened, right, share(right["x"], 1), share(right["y"], 0.8))
    for key in ("+", "+"):  # zoomed, the same places say the same
        opened.run(f'holder.dispatchEvent(new KeyboardEvent("keydown", {{key: "{key}"}}))')
    assert opened.run("view[2] < data.size[0] / 1.4")
    assert over(opened, middle, 0.6, 0.9).endswith("value 10")
    opened.run('holder.dispatchEvent(new KeyboardEvent("keydown", {key: "0"}))')
    assert opened.run("view[2] === data.size[0]")
    assert opened.messages == []
