"""The documentation site is built without a warning, works from the disk without a network, and draws every formula."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import radartwin

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "docs" / "site"


@pytest.fixture(scope="module")
def builder() -> dict:
    before = list(sys.path)
    try:
        return runpy.run_path(str(SITE / "build_site.py"))
    finally:
        sys.path[:] = before


def test_every_page_of_the_documents_is_placed_and_its_formulas_are_drawn(builder, tmp_path: Path) -> None:
    builder["write_pages"](tmp_path, ("radartwin",), execute=False)
    for page in (ROOT / "docs").rglob("*.md"):
        target = tmp_path / page.relative_to(ROOT / "docs")
        assert (target.with_name("index.md") if page.name == "README.md" else target).is_file()
    assert "$" not in (tmp_path / "concepts.md").read_text(), "each formula is a picture"
    assert len(list((tmp_path / "formulas").glob("*.svg"))) > 100
    assert "decisions/index.md" in (tmp_path / "index.md").read_text(), "a link to a folder leads to its list"


# MkDocs, its plugins and the notebook's kernel warn of their own deprecations.
@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::RuntimeWarning", "ignore::ResourceWarning", "ignore::PendingDeprecationWarning"
)
def test_the_site_works_from_the_disk(builder, chromium, tmp_path: Path) -> None:
    first = builder["build"](tmp_path / "site", tmp_path / "pages")
    site = first.parent
    public = (site / "reference" / "radartwin.html").read_text()
    for name in radartwin.__all__:
        assert f'id="radartwin.{name}"' in public, name
    assert (site / "tutorial_files").is_dir(), "the tutorial has pictures"
    for page in ("index", "concepts", "tutorial", "reference/radartwin", "reference/radartwin.simulation"):
        for width, height, name in ((1280, 900, "desktop"), (390, 844, "phone")):
            tab = chromium()
            tab.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
            tab.call("Page.navigate", url=(site / f"{page}.html").as_uri())
            tab.until("document.readyState === 'complete'")
            assert tab.run("document.documentElement.scrollWidth") <= width, "the page does not scroll sideways"
            shown = tab.screenshot(f"site_{page.replace('/', '_')}_{name}")
            assert np.ptp(shown) > 100
            assert tab.messages == [], "no page loads anything from the network"
    tab.call("Emulation.setDeviceMetricsOverride", width=1280, height=900, deviceScaleFactor=1, mobile=False)
    tab.call("Page.navigate", url=first.as_uri())
    tab.until("document.readyState === 'complete'")
    tab.run("document.querySelector('#__search').click(); document.querySelector('.md-search__input').focus()")
    tab.call("Input.insertText", text="fringe currents")
    tab.until("document.querySelectorAll('.md-search-result__item').length > 0")
    assert "concepts.html" in tab.run("[...document.querySelectorAll('.md-search-result__item a')].map(a => a.href).join()")
    tab.settle()
    tab.screenshot("site_search")


def test_only_an_earlier_site_or_an_empty_folder_is_overwritten(builder, tmp_path: Path) -> None:
    used, site = tmp_path / "used", tmp_path / "site"
    (used / "search").mkdir(parents=True)
    (used / "page.md").write_text("kept")
    (site / "search").mkdir(parents=True)
    (site / "index.html").write_text("")
    with pytest.raises(ValueError, match=r"used holds files and no earlier site"):
        builder["build"](used, tmp_path / "pages", ("radartwin",), execute=False)
    assert (used / "page.md").read_text() == "kept"
    with pytest.raises(ValueError, match=r"page\.md is a file"):
        builder["check_out"](used / "page.md")
    (tmp_path / "empty").mkdir()
    for allowed in (site, tmp_path / "empty", tmp_path / "new"):
        assert builder["check_out"](allowed) == allowed.resolve()
