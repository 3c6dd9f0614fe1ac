"""Let the C library keep freed memory for reuse, and report how much memory a process uses.

By default the GNU C library returns the large arrays of each frame to the system, which clears them again: half of the time of tracing.
"""

import contextlib
import ctypes
import functools
import gc
import math
import os
import sys
from pathlib import Path

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_MAX = -1, -2, -4  # parameter numbers of the function mallopt, from malloc.h
_PAD_BYTES = 1 << 28


@functools.cache
def keep_freed() -> None:
    """Make this process keep the memory that it frees (except Dr.Jit's) until `give_back`, if its C library is the GNU C library."""
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library
        mallopt = ctypes.CDLL(None).mallopt
        for parameter, value in ((_MMAP_MAX, 0), (_TRIM_THRESHOLD, -1), (_TOP_PAD, _PAD_BYTES)):
            mallopt(parameter, value)


def give_back() -> None:
    """Return freed memory, including Dr.Jit's, to the system, so that other processes can use it. The first call exempts all objects that
    are left, most of which belong to modules, from later searches for garbage, which then take a millisecond instead of 0.12 s. Those of
    them that form cycles are never freed.
    """
    gc.collect()
    if not gc.get_freeze_count():
        gc.freeze()
    if "drjit" in sys.modules:
        sys.modules["drjit"].flush_malloc_cache()
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


def resident_bytes(pid: int) -> float:
    """Return the memory of a process in bytes; 0 if the system does not report it."""
    try:
        with open(f"/proc/{pid}/statm", encoding="ascii") as status:
            return float(status.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0.0


def free_bytes() -> float:
    """Return the memory in bytes that this process may still use on this machine, in its SLURM job and in its control group (container).

    If the system does not report the available memory, half of the total memory counts as available.
    """
    try:
        with open("/proc/meminfo", encoding="ascii") as status:
            machine = next(1024.0 * int(line.split()[1]) for line in status if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        machine = 0.5 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    megabytes = float(os.environ.get("SLURM_MEM_PER_NODE") or 0) or math.inf  # SLURM gives 0 to a job without a limit
    job = megabytes * 2**20 - resident_bytes(os.getpid())
    return max(0.0, min(machine, job, _group_bytes()))


def _group_bytes(root: Path = Path("/sys/fs/cgroup"), process: Path = Path("/proc/self/cgroup")) -> float:
    """Return the memory in bytes that the memory limits of this process's control groups (version 2) leave; infinity without a limit."""
    free = math.inf
    with contextlib.suppress(OSError, ValueError, StopIteration):
        group = next(line.strip()[4:] for line in process.read_text().splitlines() if line.startswith("0::/"))
        for folder in (root / group, *(root / group).parents):
            if (limit := folder / "memory.max").is_file() and (most := limit.read_text().strip()) != "max":
                cached = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())["inactive_file"]
                free = min(free, int(most) - int((folder / "memory.current").read_text()) + int(cached))
    return free
