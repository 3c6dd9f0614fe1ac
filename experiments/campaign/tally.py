"""Count by name how many set-ups were built that several recordings share, such as the traced room along a track."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

SETUPS = "setups"  # tracks with their traced paths, and rooms whose parts drift
_counts: Counter[str] = Counter()


def count(name: str) -> None:
    """Add one to the number of events that are counted under the name `name`."""
    _counts[name] += 1


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """Yield a counter. At the end of the `with` block the counter holds the number of events inside the block, by name."""
    before, events = _counts.copy(), Counter[str]()
    yield events
    events.update(_counts - before)
