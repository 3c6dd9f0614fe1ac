"""Every planted fault finds its expression in the source; `make mutants` shows that the tests catch each fault."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "mutants"))

from fault import Change, Fault  # noqa: E402
from faults import FAULTS  # noqa: E402


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.change.meaning)
def test_fault_changes_the_source_and_names_existing_tests(fault: Fault) -> None:
    source = (ROOT / fault.path).read_text(encoding="utf-8")
    assert compile(fault.plant(source), fault.path, "exec")
    assert fault.change.right != fault.change.wrong
    assert all((ROOT / tests).is_file() for tests in fault.tests.split())


SOURCE = '''
class Wave:
    def phase(self, x):
        """Phase of 2 * x."""
        return (2*x  # in rad
                + 1) - (x + 1)
'''


def test_fault_ignores_comments_and_formatting() -> None:
    planted = Fault("wave.py", "", Change("Wave.phase", "2 * x + 1", "x + 2", "")).plant(SOURCE)
    assert "return x + 2 - (x + 1)" in planted


@pytest.mark.parametrize(
    ("function", "right", "message"), [("Wave.speed", "x", "no function"), ("Wave.phase", "x", "2 times"), ("Wave.phase", "y", "0 times")]
)
def test_fault_without_a_unique_place_is_refused(function: str, right: str, message: str) -> None:
    with pytest.raises(LookupError, match=message):
        Fault("wave.py", "", Change(function, right, "0", "")).plant(SOURCE)
