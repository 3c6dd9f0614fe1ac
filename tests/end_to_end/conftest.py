"""Fixtures of the tests that open pages in a browser or run a user's experiment."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import browser
import pytest


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], browser.Page]]:
    """Start a browser without a window; each call of the result opens a tab."""
    executable = browser.find()
    if executable is None:
        pytest.skip("no Chromium here to open pages in; on Debian or Ubuntu: apt-get install chromium")
    with browser.browser(executable, tmp_path_factory.mktemp("profile")) as new:
        yield new


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return an empty working folder for a user's modules. After the test, Python forgets these modules, because many tests write
    my_experiment.py.
    """
    elsewhere = {name: sys.modules.pop(name) for name in ("echoes", "my_experiment") if name in sys.modules}
    before, path = set(sys.modules), list(sys.path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", ""))
    yield tmp_path
    sys.path[:] = path
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[name]
    sys.modules.update(elsewhere)
