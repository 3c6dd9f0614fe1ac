"""Compile functions with Numba, and run them on all cores.

The machine code is cached beside the source; if that folder is read-only, in the user's cache; else only in memory.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Any:
    """The function as machine code that releases the interpreter's lock.

    Multiplications and additions are not fused. With fusing, newly compiled code and cached code differed in the last bits, and it was not
    faster.
    """
    return _built(function, {})


def innermost(function: Callable[..., Any]) -> Any:
    """As `compiled`, for functions that compiled loops call millions of times. They must not create or return arrays.

    Such a function does not count references to its arrays. Counting is atomic and takes as long as ten divisions per call, and longer
    if several threads use the same array.
    """
    return _built(function, {"_nrt": False})


def _built(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    try:
        return njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:  # no folder for the cache can be written
        return njit(nogil=True, **options)(function)


def cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def shared_out(function: Callable[..., Any], count: int, *arguments: Any, pieces: int = 4) -> None:
    """Run function(first, last, *arguments) for parts of the range 0..count, on all cores.

    The threads are Python's, because Numba's own pools do not survive a fork and cannot be nested. Each part must write to memory of its
    own, so that the result does not depend on the number of cores.
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
