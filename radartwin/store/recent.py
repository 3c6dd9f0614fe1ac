"""Keep the most recently used values of a computation in the memory of this process, up to a limit on the sum of their sizes."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

T = TypeVar("T")


class Recent(Generic[T]):
    """Keep values by key. If the sum of their sizes exceeds `limit`, drop the least recently used values.

    >>> recent = Recent[str](limit=3)
    >>> [recent.get(key, len(key), key.upper) for key in ("ab", "c", "ab", "d")]
    ['AB', 'C', 'AB', 'D']
    >>> len(recent)
    2
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._total = 0.0
        self._values: OrderedDict[Hashable, tuple[T, float]] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._values)

    def get(self, key: Hashable, size: float, make: Callable[[], T]) -> T:
        """Return the value of `key`. If no value is stored, call `make`, and keep the new value unless `size` exceeds the limit."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key][0]
        value = make()
        with self._lock:
            if size <= self._limit and key not in self._values:
                self._values[key] = value, size
                self._total += size
            while self._total > self._limit:
                self._total -= self._values.popitem(last=False)[1][1]
        return value

    def clear(self) -> None:
        """Drop all values."""
        with self._lock:
            self._values.clear()
            self._total = 0.0
