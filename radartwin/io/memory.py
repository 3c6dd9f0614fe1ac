"""What the C library does with memory that is freed.

A frame's paths are arrays of tens of megabytes that live for milliseconds. The GNU C library maps each from the system afresh and gives
it back, so that every page is cleared and mapped again: half the time of tracing what turns (radartwin/simulation/aspects.py).
"""

import contextlib
import ctypes
import functools
import gc
import sys

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_MAX = -1, -2, -4  # of mallopt, malloc.h
_PAD_BYTES = 1 << 28


@functools.cache
def keep_freed() -> bool:
    """Have this process keep what it frees, for what it needs next; whether that could be asked for, as it can of the GNU C library.

    The process stays as large as it has been, until `give_back`. Memory that Dr.Jit keeps is not affected.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library
        return False
    return all([mallopt(_MMAP_MAX, 0), mallopt(_TRIM_THRESHOLD, -1), mallopt(_TOP_PAD, _PAD_BYTES)])


def give_back() -> None:
    """Give what is freed back to the system, Dr.Jit's too: between one piece of work and another that may be other processes'."""
    gc.collect()
    if "drjit" in sys.modules:
        sys.modules["drjit"].flush_malloc_cache()
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)
