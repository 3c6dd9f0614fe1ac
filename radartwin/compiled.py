"""Numba functions compiled once: the machine code is kept beside the source, or in the user's cache where the installation is
read-only, or in memory alone where neither can be written.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numba import njit


def compiled(function: Callable[..., Any]) -> Any:
    """The function as machine code that releases the interpreter's lock. Products and sums do not fuse: fused, code just compiled and
    code read from the cache gave other last bits, and fusing saved no time."""
    return _built(function, {})


def innermost(function: Callable[..., Any]) -> Any:
    """As `compiled`, for what compiled loops call millions of times: it makes no array and returns none.

    Such a function does not count references to its arrays. Counting is atomic, costs as much as ten divisions a call, and more where
    threads count on the same array.
    """
    return _built(function, {"_nrt": False})


def _built(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    try:
        return njit(cache=True, nogil=True, **options)(function)
    except RuntimeError:  # no folder for the cache can be written
        return njit(nogil=True, **options)(function)


def cores() -> int:
    """Processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def shared_out(function: Callable[..., Any], count: int, *arguments: Any, pieces: int = 4) -> None:
    """Run function(first, last, *arguments) over the range 0..count, pieces of it on all cores.

    Plain threads, which survive forks and may be nested, unlike the thread pools Numba brings. The pieces must write to places of their
    own; then the result does not depend on the number of cores.
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
