"""Keep the most recently used values of a computation in the memory of this process, up to a limit on the sum of their sizes."""

import contextlib
import operator
import threading
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from cachetools import LRUCache

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
        self._values = LRUCache(limit, getsizeof=operator.itemgetter(1))
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._values)

    def get(self, key: Hashable, size: float, make: Callable[[], T]) -> T:
        """Return the value of `key`. If no value is stored, call `make`, and keep the new value unless `size` exceeds the limit."""
        with self._lock:
            if key in self._values:
                return self._values[key][0]
        self.put(key, size, value := make())
        return value

    def put(self, key: Hashable, size: float, value: T) -> None:
        """Keep `value` in place of an earlier value of `key`, unless `size` exceeds the limit."""
        with self._lock, contextlib.suppress(ValueError):
            self._values[key] = value, size

    def clear(self) -> None:
        """Drop all values."""
        with self._lock:
            self._values.clear()
