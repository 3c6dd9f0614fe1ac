"""For each deliberate fault in tests/mutants/faults.py, the code that the fault replaces exists in the source. The command `make mutants`
checks that the physics tests detect each deliberate fault.
"""

from __future__ import annotations

import pytest
from plant import FAULTS, ROOT


@pytest.mark.parametrize("path", sorted({fault.path for fault in FAULTS}))
def test_faults_change_the_source_and_name_existing_tests(path: str) -> None:
    source = (ROOT / path).read_text(encoding="utf-8")
    for fault in FAULTS:
        if fault.path == path:
            assert compile(fault.plant(source), path, "exec")
            assert fault.right != fault.wrong
            assert fault.tests
            assert all((ROOT / tests).is_file() for tests in fault.tests), fault.tests
