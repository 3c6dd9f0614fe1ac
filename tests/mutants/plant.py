"""Faults planted in the physics, one at a time in a copy of the tree: the quick physics tests must catch each.

    make mutants                              all of them
    python tests/mutants/plant.py layers rcs  those in files whose path holds one of the words

Prints a line per fault and ends with status 1 if one was not caught, or no longer finds its place.
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

from faults import FAULTS, Fault

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 900


def ended(tests: Sequence[str], tree: Path) -> int | None:
    """Exit status of pytest on these files of the tree; None if it did not come to an end."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / "numba")}
    try:
        return subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=LIMIT_S, check=False).returncode
    except subprocess.TimeoutExpired:
        return None


def caught(fault: Fault, tree: Path) -> tuple[str, float]:
    """What became of the fault in the copied tree: caught, NOT CAUGHT, or NO PLACE where its line has changed."""
    path, started = tree / fault.path, time.monotonic()
    sound = path.read_text(encoding="utf-8")
    if sound.count(fault.right) != 1:
        return "NO PLACE", 0.0
    path.write_text(sound.replace(fault.right, fault.wrong), encoding="utf-8")
    try:
        status = ended(fault.tests.split(), tree)
    finally:
        path.write_text(sound, encoding="utf-8")
    said = {0: "NOT CAUGHT", 1: "caught", None: "caught"}.get(status, f"pytest {status}")  # a test that hangs has noticed
    return said, time.monotonic() - started


def main(words: Sequence[str]) -> int:
    chosen = [fault for fault in FAULTS if not words or any(word in fault.path for word in words)]
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        ignored = shutil.ignore_patterns(".git", ".venv", "outputs", "__pycache__", "results")
        shutil.copytree(ROOT, tree, ignore=ignored)
        tests = sorted({test for fault in chosen for test in fault.tests.split()})
        if ended(tests, tree) != 0:
            print(f"mutants: without a fault these do not pass: {' '.join(tests)}")
            return 1
        for fault in chosen:
            status, seconds = caught(fault, tree)
            missed += status != "caught"
            print(f"{status:10s} {seconds:6.1f} s  {fault.path}: {fault.meaning}", flush=True)
    print(f"mutants: {len(chosen) - missed} of {len(chosen)} caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
