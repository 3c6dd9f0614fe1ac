"""Define functions with which tests start, interrupt and watch processes."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def started(command: list[str], folder: Path, **environment: str) -> subprocess.Popen[str]:
    """Start a command in the folder, as the leader of a new process group. Python imports radartwin from this checkout."""
    return subprocess.Popen(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT), **environment}, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip


@contextlib.contextmanager
def serving(folder: Path, address: str, *arguments: str | Path, **environment: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run a command of radartwin that serves a page. Yields what the pattern `address` finds in its output, and the process."""
    process = started([sys.executable, "-m", "radartwin", *map(str, arguments)], folder, **environment)
    assert process.stdout
    try:
        found = next((match for line in process.stdout if (match := re.search(address, line))), None)
        assert found, process.stderr.read() if process.stderr else ""
        yield found[1], process
    finally:
        if process.poll() is None:
            process.terminate()
        process.communicate(timeout=60)


def interrupted_twice(process: subprocess.Popen[str]) -> str:
    """Interrupt a command and all processes that it started twice, like a user who presses Ctrl-C two times. Returns what the command
    printed.
    """
    for _ in range(2):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.3)
    said, complained = process.communicate(timeout=60)
    # the status is -SIGINT if the second interrupt arrives while the interpreter is ending
    assert process.returncode in (128 + signal.SIGINT, -signal.SIGINT), complained
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


def listening(port: int) -> set[str]:
    """Return the IPv4 and IPv6 addresses on which this machine listens at the port."""
    found = set()
    for family, table in ((socket.AF_INET, "tcp"), (socket.AF_INET6, "tcp6")):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            address, _, number = local.partition(":")
            if state == "0A" and int(number, 16) == port:
                words = b"".join(bytes.fromhex(address[i : i + 8])[::-1] for i in range(0, len(address), 8))
                found.add(socket.inet_ntop(family, words))
    return found


def descendants(pid: int) -> list[int]:
    """Return the ids of the processes that a process started, directly or indirectly."""
    children = [int(word) for path in Path(f"/proc/{pid}/task").glob("*/children") for word in path.read_text().split()]
    return children + [grandchild for child in children for grandchild in descendants(child)]
