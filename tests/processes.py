"""Define functions with which tests start, interrupt and watch processes."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def started(command: list[str], folder: Path, **environment: str) -> subprocess.Popen[str]:
    """Start a command in the folder, as the leader of a new process group. Python imports radartwin from this checkout."""
    return subprocess.Popen(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT), **environment}, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip


def interrupted_twice(process: subprocess.Popen[str]) -> str:
    """Interrupt a command and all processes that it started twice, like a user who presses Ctrl-C two times. Returns what the command
    printed.
    """
    for _ in range(2):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.3)
    said, complained = process.communicate(timeout=60)
    assert process.returncode in (1, -signal.SIGINT), complained  # -SIGINT if the second interrupt arrives while the interpreter is ending
    assert "radartwin: interrupted; the same command resumes where it stopped" in complained
    assert "Traceback" not in complained
    return said


def runs(pid: int) -> bool:
    """Return whether a process is running; a zombie process does not count."""
    status = Path(f"/proc/{pid}/stat")
    return status.exists() and " Z " not in status.read_text()


def wait_until(condition: Callable[[], object], seconds: float = 200) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s"
        time.sleep(0.05)
