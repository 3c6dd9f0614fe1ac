"""Plant each fault in a copy of the tree and run the quick physics tests, which must catch it.

    make mutants                              all faults
    python tests/mutants/plant.py layers rcs  the faults of files whose path contains one of these words

Prints one line per fault. The exit status is 1 if a fault is not caught or its expression is not found.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from fault import Fault
from faults import FAULTS

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 900


def test_status(tests: Sequence[str], tree: Path) -> int | None:
    """Exit status of pytest on these files of the tree; None after a timeout."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / "numba")}
    try:
        return subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=LIMIT_S, check=False).returncode
    except subprocess.TimeoutExpired:
        return None


def outcome(fault: Fault, tree: Path) -> str:
    """`caught`, `NOT CAUGHT`, `NO PLACE` or the unexpected status of pytest. A test that does not end catches the fault."""
    path = tree / fault.path
    source = path.read_text(encoding="utf-8")
    try:
        path.write_text(fault.plant(source), encoding="utf-8")
    except LookupError as error:
        return f"NO PLACE ({error})"
    try:
        status = test_status(fault.tests.split(), tree)
    finally:
        path.write_text(source, encoding="utf-8")
    return {0: "NOT CAUGHT", 1: "caught", None: "caught"}.get(status, f"pytest {status}")


def main(words: Sequence[str]) -> int:
    chosen = [fault for fault in FAULTS if not words or any(word in fault.path for word in words)]
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", ".venv", "outputs", "__pycache__", "results"))
        tests = sorted({test for fault in chosen for test in fault.tests.split()})
        if test_status(tests, tree) != 0:
            print(f"mutants: these tests fail without a fault: {' '.join(tests)}")
            return 1
        for fault in chosen:
            started = time.monotonic()
            result = outcome(fault, tree)
            missed += result != "caught"
            print(f"{result:10s} {time.monotonic() - started:6.1f} s  {fault.path}: {fault.change.meaning}", flush=True)
    print(f"mutants: {len(chosen) - missed} of {len(chosen)} caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
