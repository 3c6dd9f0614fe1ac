"""For each deliberate fault in tests/mutants/faults.py, the code that the fault replaces exists in the source. The command `make mutants`
checks that the physics tests detect each deliberate fault.
"""

from __future__ import annotations

import pytest
from plant import FAULTS, ROOT, Fault


@pytest.mark.parametrize("path", sorted({fault.path for fault in FAULTS}))
def test_faults_change_the_source_and_name_existing_tests(path: str) -> None:
    source = (ROOT / path).read_text(encoding="utf-8")
    for fault in FAULTS:
        if fault.path == path:
            assert compile(fault.plant(source), path, "exec")
            assert fault.right != fault.wrong
            assert fault.tests
            assert all((ROOT / tests).is_file() for tests in fault.tests), fault.tests


SOURCE = '''
class Wave:
    def phase(self, x):
        """Phase of 2 * x."""
        return (2*x  # in rad
                + 1) - (x + 1)
'''


def test_fault_ignores_comments_and_formatting() -> None:
    planted = Fault("wave.py", [], "Wave.phase", "2 * x + 1", "x + 2", "").plant(SOURCE)
    assert "return x + 2 - (x + 1)" in planted


@pytest.mark.parametrize(
    ("function", "right", "message"), [("Wave.speed", "x", "no function"), ("Wave.phase", "x", "2 times"), ("Wave.phase", "y", "0 times")]
)
def test_fault_without_a_unique_place_is_refused(function: str, right: str, message: str) -> None:
    with pytest.raises(LookupError, match=message):
        Fault("wave.py", [], function, right, "0", "").plant(SOURCE)
