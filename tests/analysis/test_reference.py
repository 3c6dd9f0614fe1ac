"""The API reference is built from the docstrings without a warning and contains every public name."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

import radartwin

ROOT = Path(__file__).resolve().parents[2]
reference = runpy.run_path(str(ROOT / "docs" / "reference.py"))


def test_reference_has_every_public_name(tmp_path: Path) -> None:
    reference["build"](tmp_path, ("radartwin",))
    page = (tmp_path / "radartwin.html").read_text()
    for name in radartwin.__all__:
        assert f'<section id="{name}">' in page, name
    for function in (radartwin.rcs, radartwin.simulate):
        assert (function.__doc__ or "").splitlines()[0] in page


@pytest.mark.slow
def test_whole_reference_builds_without_warning(tmp_path: Path) -> None:
    assert reference["build"](tmp_path).is_file()
    pages = {path.relative_to(tmp_path).with_suffix("").as_posix().replace("/", ".") for path in tmp_path.rglob("*.html")}
    assert {name for name in reference["MODULES"] if not name.startswith("!")} <= pages
    assert "radartwin.simulation.curved.tubes" in pages
