"""Describe the machine on which run times are measured, and the memory of its processes."""

import functools
import importlib.metadata
import os
import platform
from pathlib import Path


@functools.cache
def machine() -> dict[str, str]:
    """Return processor, memory, operating system and package versions of this machine, as {name: text}."""
    from radartwin.benchmark.leaderboard import processor

    versions = {name: importlib.metadata.version(name) for name in ("numpy", "mitsuba", "drjit")}
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30 if hasattr(os, "sysconf") else 0.0
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": processor(), "cores": f"{cores} cores", "memory": f"{memory:.0f} GiB",
        "system": f"{platform.system()} {platform.machine()}", "python": f"Python {platform.python_version()}",
        "packages": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }  # fmt: skip


def memory_kib(field: str, pid: str = "self") -> int | None:
    """Return a field of /proc/PID/status, such as VmRSS, in KiB; None if there is no such file, as on systems other than Linux."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) for line in lines if line.startswith(f"{field}:")), None)


def peak_gib() -> float:
    """Return the largest resident memory of this program in GiB. `resource.getrusage` would include that of the parent process."""
    peak = memory_kib("VmHWM")
    assert peak is not None, "the peak memory of a process is known on Linux only"
    return peak / 2**20
