"""Set-ups that several recordings share, such as a track: the last few are cached, and the built ones are counted.

>>> with counted() as counts:
...     count(SETUPS)
>>> counts == {SETUPS: 1}
True
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

SETUPS = "setups"  # tracks with their scouted paths, and rooms that creep
_counts: Counter[str] = Counter()
Setup = TypeVar("Setup")


def count(name: str) -> None:
    """Count one event."""
    _counts[name] += 1


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """The counts of the events inside the block, filled at its end."""
    before, found = _counts.copy(), Counter[str]()
    yield found
    found.update(_counts - before)


def cached(cache: OrderedDict[str, Setup], key: str, build: Callable[[], Setup], size: int) -> Setup:
    """The set-up of a key, built and counted if it is missing; the cache holds the `size` set-ups that were used last."""
    if key not in cache:
        count(SETUPS)
        cache[key] = build()
        while len(cache) > size:
            cache.popitem(last=False)
    cache.move_to_end(key)
    return cache[key]
