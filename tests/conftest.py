"""Fixtures shared by all tests."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# Processes that a test starts inherit ignored signals. A suite that runs under `nohup` tests the end by SIGHUP too.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Two test processes share the cores, and threads of BLAS would wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No telemetry and no look-up leaves a test, whichever module imports mlflow first.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder beside the checkout with real scans, meshes and captures, which are too large for the repository."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here: the real captures and scans are not part of the repository")
    return folder


@pytest.fixture
def inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Callable[..., subprocess.CompletedProcess[str]]]:
    """Return a function that runs the command line in this process, in an empty folder: inside("run", "experiment=..."). A command in the
    test's process starts fast, because the process has already imported all modules.
    """
    from radartwin.cli import main

    monkeypatch.chdir(tmp_path)
    handler = signal.getsignal(signal.SIGINT)  # an interrupted command changes it

    def call(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        words = [str(word) for word in arguments]
        capsys.readouterr()
        try:
            status = main(words)
        except SystemExit as stopped:  # argparse
            status = int(stopped.code or 0)
        said = capsys.readouterr()
        return subprocess.CompletedProcess(words, status, said.out, said.err)

    yield call
    signal.signal(signal.SIGINT, handler)
