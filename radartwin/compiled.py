"""Compile functions with Numba, and run them on all cores.

The machine code is cached beside the source. If that folder is read-only, it is cached in the user's cache folder, or else in memory only.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function to machine code that releases the interpreter's lock.

    Multiplications and additions are not fused. With fusing, the results of newly compiled and cached code differed in the last bits, and
    the code was not faster.
    """
    return _built(function, {})


def innermost(function: Callable[..., Any]) -> Any:
    """Compile a function that compiled loops call millions of times. It must not create or return arrays.

    The compiled function does not count references to its arrays. Counting would take as long as ten divisions per call, because it is
    atomic, and longer if several threads use the same array.
    """
    return _built(function, {"_nrt": False})


def _built(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    try:
        return njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:  # no folder for the cache can be written
        return njit(nogil=True, **options)(function)


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def shared_out(function: Callable[..., Any], count: int, *arguments: Any, pieces: int = 4) -> None:
    """Split the range 0..count into parts and call function(first, last, *arguments) for each part, on all cores.

    The threads are Python threads, because Numba's own thread pools do not survive a fork and cannot be nested. No two parts may write to
    the same memory, so that the result does not depend on the number of cores.
    """
    workers = min(cores(), count)
    if workers <= 1:
        function(0, count, *arguments)
        return
    parts = min(count, pieces * workers)
    bounds = [count * i // parts for i in range(parts + 1)]
    with ThreadPoolExecutor(workers) as pool:
        results: Iterator[Any] = pool.map(lambda i: function(bounds[i], bounds[i + 1], *arguments), range(parts))
        for _ in results:
            pass
