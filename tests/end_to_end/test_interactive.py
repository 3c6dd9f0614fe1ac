"""In a real browser, the HTML page of a figure shows values under the pointer, zooms and pans by pointer and keys, and logs no errors."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from radartwin.plotting import style

WIDTH, HEIGHT = 1000, 700


def drawn():
    figure, axes = style.figure(1, 3, height_in=2.5)
    axes[0].plot([0, 1, 2, 3], [1.0, 10.0, 100.0, 1000.0], "o-", label="rising")
    axes[0].set(yscale="log", xlabel="distance (m)", ylabel="level")
    axes[1].imshow(np.arange(12.0).reshape(3, 4) / 100, aspect="auto")  # the first row on top
    axes[2].bar([-0.2, 0.8], [0.4, 0.8], width=0.4, yerr=[0.1, 0.1], label="ours")
    axes[2].bar([0.2, 1.2], [0.3, 0.6], width=0.4, label="theirs")
    axes[2].set_xticks([0, 1], ["mug", "can"])
    return figure


def others():
    """Draw figures with unusual data. A page must display them without errors, and each value that it shows must be correct."""
    figure, axes = style.figure(2, 3, height_in=4)
    axes[0, 0].plot(["mug", "can"], [1, 2])
    axes[0, 1].pcolormesh([1, 10, 100], [0, 1], [[1.0, 2.0]])
    axes[0, 2].pcolormesh(np.arange(3), np.arange(3), np.ones((3, 3)), shading="gouraud")
    axes[1, 0].plot([0, 1, 4, 16], [0, 1, 2, 3])
    axes[1, 0].set_xscale("symlog", linthresh=1)
    axes[1, 1].imshow([[1.0, 2.0], [3.0, 4.0]], origin="lower", extent=(0, 2, 5, 3), aspect="auto")
    axes[1, 2].errorbar([1, 2], np.ma.masked_array([0.5, 99.0], [False, True]), [0.1, 0.1], capsize=2, label="room")
    return figure


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return style.save(drawn, tmp_path_factory.mktemp("figure") / "three_panels")[-1]


@pytest.fixture
def opened(chromium, path: Path):
    page = chromium()
    page.open(path, WIDTH, HEIGHT)
    return page


def data_of(path: Path) -> dict:
    found = re.search(r"const data = (.*);\n", path.read_text(encoding="utf-8"))
    assert found
    return json.loads(found[1])


def test_page_contains_the_drawn_data_and_has_equal_bytes_twice(path: Path, tmp_path: Path) -> None:
    left, middle, right = data_of(path)["axes"]
    assert left["series"] == [{"name": "rising", "points": [[0, 1], [1, 10], [2, 100], [3, 1000]]}]
    assert left["y"]["log"]
    (picture,) = middle["pictures"]
    assert picture["extent"] == [-0.5, 3.5, 2.5, -0.5]
    # rows in the order of the vertical axis, which runs from 2.5 to -0.5
    assert picture["values"] == [[0.08, 0.09, 0.1, 0.11], [0.04, 0.05, 0.06, 0.07], [0, 0.01, 0.02, 0.03]]
    assert right["series"] == [
        {"name": "ours", "points": [[-0.2, 0.4, 0.4], [0.8, 0.8, 0.8]]}, {"name": "theirs", "points": [[0.2, 0.3, 0.3], [1.2, 0.6, 0.6]]},
    ]  # fmt: skip
    assert right["x"]["names"] == [[0, "mug"], [1, "can"]]
    again = style.save(drawn, tmp_path / "three_panels")[-1]
    assert again.read_bytes() == path.read_bytes()


def test_unsupported_data_has_no_values(tmp_path: Path) -> None:
    names, uneven, shaded, other, low, bars = data_of(style.save(others, tmp_path / "others")[-1])["axes"]
    assert names["series"][0]["points"] == [[0, 1], [1, 2]]
    assert uneven["pictures"] == shaded["pictures"] == []
    assert len(other["x"]["steps"]) == 257
    assert low["pictures"] == [{"extent": [0, 2, 5, 3], "values": [[1, 2], [3, 4]]}]
    assert bars["series"] == [{"name": "room", "points": [[1, 0.5]]}]


def over(opened, axes: dict, x: float, y: float) -> str:
    """Return the value that the page shows when the pointer is at the fractions x and y of a panel's width and height."""
    x0, y0, x1, y1 = axes["box"]
    opened.run(
        f"""(() => {{ const b = svg.getBoundingClientRect(), X = {x0 + x * (x1 - x0)}, Y = {y1 - y * (y1 - y0)};
        holder.dispatchEvent(new PointerEvent("pointermove", {{bubbles: true,
          clientX: b.left + (X - view[0]) / view[2] * b.width, clientY: b.top + (Y - view[1]) / view[3] * b.height}})); }})()"""
    )
    return opened.run("readout.textContent")


def test_pointer_and_keys_read_the_drawn_values(opened, path: Path) -> None:
    left, middle, right = data_of(path)["axes"]

    def share(scale: dict, value: float) -> float:
        low, high, at = np.log([scale["low"], scale["high"], value]) if scale["log"] else (scale["low"], scale["high"], value)
        return (at - low) / (high - low)

    assert over(opened, left, share(left["x"], 2) + 0.01, share(left["y"], 100)) == "rising · distance (m) 2 · level 100"
    assert over(opened, middle, 0.6, 0.9).endswith("value 0.02")  # third column, upper row
    assert over(opened, middle, 0.1, 0.1).endswith("value 0.08")
    said = over(opened, right, share(right["x"], 1.2), share(right["y"], 0.6))
    assert said == "theirs · across can · up 0.6 · bar 0.6"
    assert over(opened, right, share(right["x"], -0.2), share(right["y"], 0.4)).startswith("ours · across mug")
    for key in ("+", "+"):  # after zooming, the same data points have the same readout
        opened.run(f'holder.dispatchEvent(new KeyboardEvent("keydown", {{key: "{key}"}}))')
    assert opened.run("view[2] < data.size[0] / 1.4")
    assert over(opened, middle, 0.6, 0.9).endswith("value 0.02")
    before = opened.run("view.join()")
    opened.run('holder.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowRight"}))')
    assert opened.run("view.join()") != before
    # Ctrl and + is the zoom of the browser itself
    opened.run('holder.dispatchEvent(new KeyboardEvent("keydown", {key: "+", ctrlKey: true}))')
    wheel = 'holder.dispatchEvent(new WheelEvent("wheel", {deltaY: -100, clientX: 300, clientY: 300, cancelable: true}))'
    before = opened.run("view[2]")
    opened.run(wheel)
    assert opened.run("view[2]") == before  # the page scrolls until the figure has been chosen
    opened.run("holder.focus()")
    opened.run(wheel)
    assert opened.run("view[2]") < before
    opened.run('holder.dispatchEvent(new KeyboardEvent("keydown", {key: "0"}))')
    assert opened.run("view[2] === data.size[0]")
    opened.run('holder.dispatchEvent(new KeyboardEvent("keydown", {key: "n"}))')
    assert opened.run("readout.textContent") == "rising · distance (m) 0 · level 1"
    assert opened.messages == []
