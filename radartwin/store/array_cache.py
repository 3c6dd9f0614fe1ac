"""A cache of named arrays: the most recently used are in memory, further ones in a folder that several processes may share."""

from __future__ import annotations

import contextlib
import io
import os
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from cachetools import LRUCache

from radartwin.errors import OutputError
from radartwin.io import files

T = TypeVar("T")
Arrays = Mapping[str, np.ndarray]
IN_MEMORY_BYTES = 500_000_000  # largest size of the entries held in memory together
MAX_BYTES = 100_000_000  # size limit of a cache folder; larger entries are not written
_SUFFIX = ".npz"


class ArrayCache:
    """Store named arrays by key, in memory and optionally in a folder.

    Args:
        folder: folder in which entries remain after this process ends; None keeps entries in memory only.
        in_memory_bytes: size limit of the entries in memory, in bytes.
        max_bytes: size limit of the folder in bytes.
    Raises:
        OutputError: the folder cannot be created or written.

    >>> cache = ArrayCache()
    >>> cache.put("key", {"length_m": np.ones(3)})
    >>> cache.get("key", lambda arrays: float(arrays["length_m"].sum()))
    3.0
    """

    def __init__(self, folder: str | Path | None = None, *, in_memory_bytes: int = IN_MEMORY_BYTES, max_bytes: int = MAX_BYTES) -> None:
        self.folder = None if folder is None else files.make_folder(Path(folder).absolute())
        self._max_bytes = max_bytes
        self._recent = LRUCache(in_memory_bytes, getsizeof=_bytes)
        self._lock = threading.RLock()
        if self.folder is not None:
            files.sweep(self.folder)

    def get(self, key: str, read: Callable[[Arrays], T]) -> T | None:
        """Return `read(arrays)` for the stored arrays, which it must not change, or None if the cache has no such entry.

        If `read` raises ValueError, LookupError or TypeError, the entry is damaged.
        """
        with self._lock:
            if key in self._recent:
                return read(self._recent[key])
            if self.folder is None:
                return None
            path = self.folder / f"{key}{_SUFFIX}"
            try:
                arrays = files.read_arrays(path)
                result = read(arrays)
                os.utime(path)  # mark the entry as used now, because the least recently used entry is removed first
            except FileNotFoundError:
                return None
            except (OSError, ValueError, LookupError, TypeError) as error:
                warnings.warn(f"{path}: the cached arrays are damaged ({type(error).__name__}) and are computed again", stacklevel=2)
                with contextlib.suppress(OSError):
                    path.unlink()
                return None
            self._remember(key, arrays)
            return result

    def put(self, key: str, arrays: Arrays, on_disk: bool = True) -> None:
        """Store the arrays under the key. If `on_disk` is False or the disk is full, keep the arrays in memory only."""
        with self._lock:
            self._remember(key, arrays)
            if self.folder is None or not on_disk:
                return
            stream = io.BytesIO()
            values: dict[str, Any] = dict(arrays)
            # compression would hardly reduce the size of floating-point data; the zip format stores a checksum of each array
            np.savez(stream, **values)
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
        with contextlib.suppress(ValueError):  # the arrays alone are larger than the limit
            self._recent[key] = arrays

    def _evict(self, newest: Path) -> None:
        """Remove the least recently used entries until the folder is within its limit. Several processes may do so at the same time."""
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


def _bytes(arrays: Any) -> int:
    return sum(array.nbytes for array in arrays.values())


_shared = ArrayCache()


def shared() -> ArrayCache:
    """Return the array cache of this process, which is in memory only within no `in_folder` block."""
    return _shared


@contextlib.contextmanager
def in_folder(folder: str | Path, max_bytes: int = MAX_BYTES) -> Iterator[ArrayCache]:
    """Within the `with` block, let the array cache of this process also use this folder, up to `max_bytes`. Raises OutputError."""
    global _shared
    before, _shared = _shared, ArrayCache(folder, max_bytes=max_bytes)
    try:
        yield _shared
    finally:
        _shared = before
