"""The planted faults of `make mutants` still find their places; whether each is caught is told by that target."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FAULTS = runpy.run_path(str(ROOT / "tests" / "mutants" / "faults.py"))["FAULTS"]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.meaning)
def test_a_planted_fault_changes_one_line_of_the_sources_it_names(fault) -> None:
    source = (ROOT / fault.path).read_text(encoding="utf-8")
    assert source.count(fault.right) == 1
    assert fault.wrong != fault.right
    assert all((ROOT / tests).is_file() for tests in fault.tests.split())
