"""Fixtures of the tests that open pages."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import browser
import pytest


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], browser.Page]]:
    """A headless browser; each call opens a page of it."""
    executable = browser.find()
    if executable is None:
        pytest.skip("no Chromium here to open pages in; on Debian or Ubuntu: apt-get install chromium")
    with browser.browser(executable, tmp_path_factory.mktemp("profile")) as new:
        yield new
