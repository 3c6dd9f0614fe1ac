"""The report page loads fast in a real browser and works offline, on a phone, in print and without JavaScript."""

from __future__ import annotations

import base64
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
import reported

WIDTH = 1280


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the path of a report page that was moved away from the folders from which it was made."""
    output = tmp_path_factory.mktemp("out")
    reported.write(output)
    return Path(shutil.move(output / "report", tmp_path_factory.mktemp("moved") / "a report")) / "index.html"


@pytest.fixture
def opened(chromium: Callable[[], browser.Page], index: Path) -> Iterator[browser.Page]:
    page = chromium()
    page.open(index, WIDTH)
    yield page
    assert page.messages == []


def shown(page: browser.Page, table: str) -> list[str]:
    return page.run(f"[...document.querySelectorAll('{table} tbody tr')].filter(r => r.checkVisibility()).map(r => r.cells[1].textContent)")


def until_seen(page: browser.Page, there: Callable[[np.ndarray], bool]) -> None:
    """Wait until the picture of the window (height, width, 3) fulfils the condition, because a test cannot query pages inside iframes."""
    end = time.monotonic() + 30
    while not there(page.screenshot().astype(int)):
        assert time.monotonic() < end, "nothing is drawn in the frame"
        time.sleep(0.1)


def loaded(page: browser.Page) -> list[str]:
    """Return the names of the files that the page has loaded."""
    return page.run("performance.getEntriesByType('resource').map(one => one.name.split('/').pop())")


@pytest.mark.parametrize("width", [WIDTH, 320])
def test_page_fits_the_window_and_loads_frames_only_when_visible(opened: browser.Page, index: Path, width: int) -> None:
    opened.open(index, width)
    opened.screenshot(f"report_{width}")
    assert opened.run("document.documentElement.scrollWidth") <= width
    assert opened.run("document.title") == "RadarTwin report"
    assert not [name for name in loaded(opened) if name.endswith(".html")]


def test_rows_are_filtered_by_verdict_and_words_and_sorted_by_a_column(opened: browser.Page) -> None:
    every = shown(opened, "#environment")
    assert {"supported", "contradicted", "not testable here", ""} == set(every)
    opened.run("document.querySelector('.counts a[href=\"#environment\"].contradicted').click()")
    assert opened.run("location.hash") == "#environment"
    assert set(shown(opened, "#environment")) == {"contradicted"}
    count = opened.run("document.querySelector('#environment .tools output').textContent")
    assert count == f"{every.count('contradicted')} of {len(every)} rows"
    opened.run("document.querySelector('#environment select').value = ''")
    opened.run("document.querySelector('#environment .tools input').focus()")
    opened.call("Input.insertText", text="strength 17")
    assert len(shown(opened, "#environment")) == 1
    opened.run("document.querySelector('#environment .tools input').value = ''")
    opened.run("document.querySelector('#environment .tools input').dispatchEvent(new Event('input'))")
    assert shown(opened, "#environment") == every
    value = "#environment th:nth-child(3)"
    opened.run(f"document.querySelector('{value} button').focus()")
    opened.press(" ", 32)
    opened.until(f"document.querySelector('{value}').getAttribute('aria-sort') === 'ascending'")
    values = opened.run("[...document.querySelectorAll('#environment tbody tr')].map(r => parseFloat(r.cells[2].textContent))")
    figures = [value for value in values if value is not None]
    assert figures == sorted(figures)
    assert values[-1] is None, "what has no figure comes last"


def test_link_to_a_row_scrolls_to_it_highlights_it_and_shows_all_its_columns(opened: browser.Page) -> None:
    row = "document.getElementById('environment-20')"
    inside = f"(b => b.top >= 0 && b.bottom <= innerHeight)({row}.getBoundingClientRect())"
    assert not opened.run(f"{row}.querySelector('.more').checkVisibility()")
    opened.run("document.querySelector('#environment .tools input').value = 'nothing'")
    opened.run("document.querySelector('#environment .tools input').dispatchEvent(new Event('input'))")
    assert not opened.run(f"{row}.checkVisibility()")
    opened.run("location.hash = '#environment-20'")
    opened.until(f"{row}.checkVisibility() && {row}.querySelector('.more').checkVisibility() && {inside}")
    assert opened.run(
        f"getComputedStyle({row}.cells[1]).backgroundColor !== getComputedStyle({row}.previousElementSibling).backgroundColor"
    )


def room_drawn(picture: np.ndarray) -> bool:
    """Return whether the room covers at least a fifth of the picture, where pixels have neither the page's nor the background's grey."""
    return float((np.ptp(picture[:600, 400:900], axis=2) > 12).mean()) > 0.2


def star_drawn(picture: np.ndarray) -> bool:
    """Return whether the picture contains the colour of the star that marks the default simulator."""
    return bool((np.abs(picture - (0, 114, 178)).max(axis=2) < 8).any())


@pytest.mark.parametrize(("part", "drawn"), [(".room", room_drawn), ("#speed_accuracy .chart", star_drawn)])
def test_room_and_chart_open_in_place(opened: browser.Page, part: str, drawn: Callable[[np.ndarray], bool]) -> None:
    seen = f"document.querySelector('{part} iframe').checkVisibility()"
    to_button = f"document.querySelector('{part} .here summary').scrollIntoView({{block: 'center'}})"
    opened.run(to_button)
    assert not opened.run(seen)
    opened.click(f"{part} .here summary")
    opened.until(seen)
    opened.run(f"document.querySelector('{part} iframe').scrollIntoView({{block: 'start'}})")
    until_seen(opened, drawn)
    opened.run(to_button)
    opened.click(f"{part} .here summary")
    assert not opened.run(seen)


def test_print_unfolds_everything(opened: browser.Page) -> None:
    opened.run("document.querySelector('.counts a.contradicted').click()")
    opened.run(
        """addEventListener("beforeprint", () => { window.atPrint = {
          folded: document.querySelectorAll("details:not([open])").length,
          hidden: [...document.querySelectorAll("tbody tr")].filter(row => getComputedStyle(row).display === "none").length,
          cut: [...document.querySelectorAll(".scroll")].filter(one => one.scrollHeight > one.clientHeight + 2).length }; })"""
    )
    opened.until("[...document.images].every(picture => picture.complete && picture.naturalWidth)")
    opened.call("Emulation.setEmulatedMedia", media="print")
    pdf = base64.b64decode(opened.call("Page.printToPDF", preferCSSPageSize=True)["data"])
    assert opened.run("window.atPrint") == {"folded": 0, "hidden": 0, "cut": 0}
    assert pdf.count(b"/Subtype /Image") >= 5, "three rooms and two figures are on it"
    opened.call("Emulation.setEmulatedMedia", media="")
    assert opened.run("document.querySelectorAll('#environment details[open]').length") == 0, "folded again afterwards"


def test_page_works_without_script(chromium: Callable[[], browser.Page], index: Path) -> None:
    page = chromium()
    page.call("Emulation.setScriptExecutionDisabled", value=True)
    page.call("Page.navigate", url=index.resolve().as_uri())
    page.until("document.readyState === 'complete' && document.querySelectorAll('#environment tbody tr').length > 0")
    assert page.run("document.body.dataset.ready === undefined")
    assert len(shown(page, "#environment")) == len(reported.rows())
    page.run("document.querySelector('#environment .columns input').click()")
    assert page.run("document.querySelector('#environment td.more').checkVisibility()"), "all columns unfold without a script"
    assert page.run("document.querySelectorAll('button, .tools').length") == 0
    assert page.run("[...document.querySelectorAll('iframe')].every(one => !one.checkVisibility())")
    assert page.run("[...document.querySelectorAll('#gallery figure img')].every(one => one.checkVisibility())")
    assert page.messages == []
