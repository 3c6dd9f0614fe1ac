"""Measure the peak memory of a process, for the benchmarks and for the tests of memory limits."""

from __future__ import annotations

from pathlib import Path


def peak_gib() -> float:
    """Return the largest resident memory that this process had since its program started, in GiB.

    `resource.getrusage` is not used, because Linux keeps its maximum when a process starts another program. In a child process, the maximum
    would therefore include the memory that the parent process had at the start of the child.
    """
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (line,) = [line for line in status.splitlines() if line.startswith("VmHWM:")]
    return int(line.split()[1]) / 2**20
