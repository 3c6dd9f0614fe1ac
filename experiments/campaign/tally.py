"""What was done once for many recordings, counted where it is done.

>>> with counted() as told:
...     count(SETUPS)
>>> told == {SETUPS: 1}
True
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

SETUPS = "setups"  # of tracks, with what is scouted along them, and of rooms that creep
_now: Counter[str] = Counter()


def count(what: str, number: int = 1) -> None:
    _now[what] += number


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """What is counted within, filled at the end."""
    before, told = _now.copy(), Counter[str]()
    yield told
    told.update(_now - before)
