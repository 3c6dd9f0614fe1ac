"""Cache the set-ups that several recordings share (such as the traced room along a track), and count how many set-ups were built."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

SETUPS = "setups"  # tracks with their traced paths, and rooms whose parts drift
_counts: Counter[str] = Counter()
Setup = TypeVar("Setup")


def count(name: str) -> None:
    """Add one to the number of events that are counted under the name `name`."""
    _counts[name] += 1


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """Yield a counter. At the end of the `with` block the counter holds the number of events inside the block, by name."""
    before, found = _counts.copy(), Counter[str]()
    yield found
    found.update(_counts - before)


def cached(cache: OrderedDict[str, Setup], key: str, build: Callable[[], Setup], size: int) -> Setup:
    """Return the cached set-up with this key; a missing set-up is built and counted. The cache keeps the `size` set-ups that were
    used last.
    """
    if key not in cache:
        count(SETUPS)
        cache[key] = build()
        while len(cache) > size:
            cache.popitem(last=False)
    cache.move_to_end(key)
    return cache[key]
