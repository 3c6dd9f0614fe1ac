"""Memory that the C library keeps after it is freed, and memory of processes.

The arrays of a frame's paths hold tens of megabytes and live for milliseconds. The GNU C library maps each anew and returns it to the
system, and clearing the pages again takes half the time of tracing an object that turns (radartwin/simulation/aspects.py).
"""

import contextlib
import ctypes
import functools
import gc
import os
import sys

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_MAX = -1, -2, -4  # parameters of mallopt, malloc.h
_PAD_BYTES = 1 << 28


@functools.cache
def keep_freed() -> bool:
    """Have this process keep the memory it frees; False where the C library is not GNU's or refuses.

    The process stays at its largest size until `give_back`. Dr.Jit manages its own memory.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library
        return False
    return all([mallopt(_MMAP_MAX, 0), mallopt(_TRIM_THRESHOLD, -1), mallopt(_TOP_PAD, _PAD_BYTES)])


def give_back() -> None:
    """Return freed memory to the system, also that of Dr.Jit, so that other processes can use it."""
    gc.collect()
    if "drjit" in sys.modules:
        sys.modules["drjit"].flush_malloc_cache()
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


def resident_bytes(pid: int) -> float:
    """Memory of a process in bytes; 0 where the system does not say."""
    try:
        with open(f"/proc/{pid}/statm", encoding="ascii") as status:
            return float(status.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0.0


def free_bytes(otherwise: float) -> float:
    """Memory in bytes that is free or can be freed; where the system does not say, half of all memory, else `otherwise`."""
    try:
        with open("/proc/meminfo", encoding="ascii") as status:
            return next(1024.0 * int(line.split()[1]) for line in status if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        pass
    try:
        return 0.5 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return otherwise
