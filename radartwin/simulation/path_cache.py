"""Traced paths kept for later, a list of parts a key: the last few in memory, more in a folder that several processes may share.

An entry is one file under its key, whole or absent. The key is a digest of what decides the paths (geometry, reflection, poses, settings)
and of the source of the modules that trace them, so nothing has to be told when code changes. An entry that cannot be read is removed
with a warning and traced again. When the folder grows beyond its bound, the entries not used for longest go first.
"""

import contextlib
import dataclasses
import functools
import hashlib
import io
import os
import threading
import warnings
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import OutputError
from radartwin.io import files
from radartwin.simulation.paths import Paths

IN_MEMORY = 4  # path sets, some tens of megabytes each
MAX_BYTES = 4_000_000_000  # of a folder
_SUFFIX = ".npz"
_SOURCES = ("materials", "radar", "scene", "simulation")  # packages whose code decides paths


class PathCache:
    """Paths by key.

    Args:
        folder: where to keep them beyond this process; None keeps them in memory alone.
        in_memory: how many to hold in memory.
        max_bytes: bound of the folder.
    Raises:
        OutputError: the folder cannot be made or written.

    >>> cache = PathCache()
    >>> cache.get(cache.key("a scene", np.eye(4))) is None
    True
    """

    def __init__(self, folder: str | Path | None = None, *, in_memory: int = IN_MEMORY, max_bytes: int = MAX_BYTES) -> None:
        self.folder = None if folder is None else files.make_folder(Path(folder).absolute())
        self._max_bytes = max_bytes
        self._in_memory = in_memory
        self._recent: OrderedDict[str, list[Paths]] = OrderedDict()
        self._lock = threading.RLock()
        if self.folder is not None:
            files.sweep(self.folder)

    @staticmethod
    def key(*parts: Any) -> str:
        """Digest of numbers, texts, arrays, dataclasses, and sequences and mappings of them, and of the code.

        Raises:
            TypeError: a part of another kind, whose content is unknown.
        """
        total = hashlib.sha256(_source_digest())
        _feed(total, parts)
        return total.hexdigest()

    def get(self, key: str) -> list[Paths] | None:
        """The parts under this key, or None. They are shared: not to be written to."""
        with self._lock:
            if key in self._recent:
                self._recent.move_to_end(key)
                return list(self._recent[key])
            parts = None if self.folder is None else self._read(self.folder / f"{key}{_SUFFIX}")
            if parts is not None:
                self._remember(key, parts)
            return parts

    def put(self, key: str, parts: Sequence[Paths]) -> None:
        """Keep the parts; a folder that is full costs a warning, not the run."""
        with self._lock:
            self._remember(key, parts)
            if self.folder is None:
                return
            content = _packed(parts)
            if len(content) > self._max_bytes:
                return
            target = self.folder / f"{key}{_SUFFIX}"
            try:
                files.write_atomically(target, content)
            except OutputError as error:
                warnings.warn(f"traced paths are not kept: {error}", stacklevel=2)
                return
            self._evict(target)

    def _remember(self, key: str, parts: Sequence[Paths]) -> None:
        self._recent[key] = list(parts)
        self._recent.move_to_end(key)
        while len(self._recent) > self._in_memory:
            self._recent.popitem(last=False)

    @staticmethod
    def _read(path: Path) -> list[Paths] | None:
        try:
            content = path.read_bytes()
            parts = _unpacked(content)
            os.utime(path)  # used now: the last to go
        except FileNotFoundError:
            return None
        except (OSError, ValueError, LookupError, TypeError) as error:
            warnings.warn(f"{path}: kept paths are damaged ({type(error).__name__}) and are traced again", stacklevel=3)
            with contextlib.suppress(OSError):
                path.unlink()
            return None
        return parts

    def _evict(self, newest: Path) -> None:
        """Remove what was not used for longest until the folder is within its bound; others may do so at the same time."""
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


_shared = PathCache()


def shared() -> PathCache:
    """The cache this process traces through: in memory, unless `kept_in` names a folder."""
    return _shared


@contextlib.contextmanager
def kept_in(folder: str | Path) -> Iterator[PathCache]:
    """Keep traced paths in a folder meanwhile, then as before. Raises OutputError as PathCache does."""
    global _shared
    before, _shared = _shared, PathCache(folder)
    try:
        yield _shared
    finally:
        _shared = before


def _packed(parts: Sequence[Paths]) -> bytes:
    """Stored, not deflated: the mantissas of paths hardly shrink. The archive has a checksum per array."""
    arrays: dict[str, Any] = {"parts": np.array(len(parts))}
    for i, part in enumerate(parts):
        values = {f.name: getattr(part, f.name) for f in dataclasses.fields(Paths)}
        arrays |= {f"{i}.{name}": np.asarray(value) for name, value in values.items() if value is not None}
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _unpacked(content: bytes) -> list[Paths]:
    arrays = files.read_arrays(content)
    parts = []
    for i in range(int(arrays["parts"])):
        values: dict[str, Any] = {f.name: arrays[f"{i}.{f.name}"] for f in dataclasses.fields(Paths) if f"{i}.{f.name}" in arrays}
        for name, value in values.items():
            if name not in ("poses", "frequencies_hz") and len(value) != len(values["pose"]):
                raise ValueError(f"{name} has {len(value)} entries, not {len(values['pose'])}")
        values["poses"] = int(values["poses"])
        parts.append(Paths(**values))
    return parts


def _feed(total: Any, part: Any) -> None:
    """Add a part to a digest so that no two different parts add the same bytes."""
    if isinstance(part, np.ndarray | np.generic):
        array = np.ascontiguousarray(part)
        if array.dtype.hasobject:
            raise TypeError("a key cannot be made of an array of objects")
        total.update(f"array {array.dtype.str} {np.shape(part)}:".encode())
        total.update(array.tobytes())
    elif part is None or isinstance(part, bool | int | float | complex | str | bytes):
        text = repr(part).encode()
        total.update(f"{type(part).__name__} {len(text)}:".encode() + text)
    elif dataclasses.is_dataclass(part) and not isinstance(part, type):
        _feed(total, (type(part).__qualname__, [(f.name, getattr(part, f.name)) for f in dataclasses.fields(part)]))
    elif isinstance(part, Mapping):
        _feed(total, ("mapping", list(part.items())))
    elif isinstance(part, list | tuple):
        total.update(f"list {len(part)}:".encode())
        for item in part:
            _feed(total, item)
    else:
        raise TypeError(f"a key cannot be made of {type(part).__name__}: {part!r}")


@functools.cache
def _source_digest() -> bytes:
    total = hashlib.sha256()
    package = Path(__file__).resolve().parents[1]
    for name in _SOURCES:
        for path in sorted((package / name).rglob("*.py")):
            _feed(total, (path.relative_to(package).as_posix(), path.read_bytes()))
    return total.digest()
