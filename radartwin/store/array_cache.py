"""A cache of named arrays. The most recent entries are in memory; more are in a folder that several processes may share.

Each entry is one .npz file, named by its key and never partly written. A damaged entry is removed with a warning. When the folder exceeds
its size limit, the least recently used entries are removed.
"""

from __future__ import annotations

import contextlib
import io
import os
import threading
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from radartwin.errors import OutputError
from radartwin.io import files

T = TypeVar("T")
Arrays = Mapping[str, np.ndarray]
IN_MEMORY = 4  # entries held in memory, some tens of megabytes each
MAX_BYTES = 4_000_000_000  # size limit of a cache folder
_SUFFIX = ".npz"


class ArrayCache:
    """Stores named arrays by key.

    Args:
        folder: where entries remain after this process ends; None keeps entries in memory only.
        in_memory: number of entries to hold in memory.
        max_bytes: size limit of the folder.
    Raises:
        OutputError: the folder cannot be created or written.

    >>> cache = ArrayCache()
    >>> cache.put("key", {"length_m": np.ones(3)})
    >>> cache.get("key", lambda arrays: float(arrays["length_m"].sum()))
    3.0
    """

    def __init__(self, folder: str | Path | None = None, *, in_memory: int = IN_MEMORY, max_bytes: int = MAX_BYTES) -> None:
        self.folder = None if folder is None else files.make_folder(Path(folder).absolute())
        self._max_bytes = max_bytes
        self._in_memory = in_memory
        self._recent: OrderedDict[str, Arrays] = OrderedDict()
        self._lock = threading.RLock()
        if self.folder is not None:
            files.sweep(self.folder)

    def get(self, key: str, read: Callable[[Arrays], T]) -> T | None:
        """Return `read(arrays)` for the entry of this key; None if there is no entry.

        Args:
            read: converts the arrays of the entry and must not change them. If it raises ValueError, LookupError or TypeError, the entry
                counts as damaged.
        """
        with self._lock:
            if key in self._recent:
                self._recent.move_to_end(key)
                return read(self._recent[key])
            if self.folder is None:
                return None
            path = self.folder / f"{key}{_SUFFIX}"
            try:
                arrays = files.read_arrays(path)
                found = read(arrays)
                os.utime(path)  # the least recently used entry is the first to go
            except FileNotFoundError:
                return None
            except (OSError, ValueError, LookupError, TypeError) as error:
                warnings.warn(f"{path}: the cached arrays are damaged ({type(error).__name__}) and are computed again", stacklevel=2)
                with contextlib.suppress(OSError):
                    path.unlink()
                return None
            self._remember(key, arrays)
            return found

    def put(self, key: str, arrays: Arrays) -> None:
        """Store the arrays. If the disk is full, warn and keep them in memory only."""
        with self._lock:
            self._remember(key, arrays)
            if self.folder is None:
                return
            stream = io.BytesIO()
            values: dict[str, Any] = dict(arrays)
            np.savez(stream, **values)  # not compressed, because the mantissas hardly shrink; each array has a checksum
            if stream.tell() > self._max_bytes:
                return
            target = self.folder / f"{key}{_SUFFIX}"
            try:
                files.write_atomically(target, stream.getvalue())
            except OutputError as error:
                warnings.warn(f"the arrays are not cached on disk: {error}", stacklevel=2)
                return
            self._evict(target)

    def _remember(self, key: str, arrays: Arrays) -> None:
        self._recent[key] = arrays
        self._recent.move_to_end(key)
        while len(self._recent) > self._in_memory:
            self._recent.popitem(last=False)

    def _evict(self, newest: Path) -> None:
        """Remove the least recently used entries until the folder is within its limit. Other processes may do so at the same time."""
        assert self.folder is not None
        entries = []
        for path in self.folder.glob(f"*{_SUFFIX}"):
            with contextlib.suppress(FileNotFoundError):
                status = path.stat()
                entries.append((status.st_mtime_ns, status.st_size, path))
        total = sum(size for _, size, _ in entries)
        for _, size, path in sorted(entries):
            if total <= self._max_bytes:
                return
            if path != newest:
                path.unlink(missing_ok=True)
                total -= size


_shared = ArrayCache()


def shared() -> ArrayCache:
    """Return the cache that this process shares: in memory only, unless `in_folder` names a folder."""
    return _shared


@contextlib.contextmanager
def in_folder(folder: str | Path) -> Iterator[ArrayCache]:
    """Within the `with`, the shared cache also uses this folder. Raises OutputError as ArrayCache does."""
    global _shared
    before, _shared = _shared, ArrayCache(folder)
    try:
        yield _shared
    finally:
        _shared = before
