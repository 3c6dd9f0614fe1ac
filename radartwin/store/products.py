"""The store of computed results. A stored result (a product) is a folder that is named by its key and is never incomplete.

    output/cache/KIND/KEY/          the product: the files that `build` wrote, and meta.json
    output/cache/KIND/.KEY.lock     locked by the process that computes the product
    output/cache/KIND/.KEY.*.tmp/   a product under construction; the next `Store` removes folders that killed processes left

The key is a digest of the specification of the result, of the content of its input files, and of the source code of the packages that
compute it (radartwin/store/digest.py). The store computes a product again only if the product's files no longer have the sizes and SHA-256
sums in meta.json.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin.constants import __version__
from radartwin.errors import OutputError, UserError
from radartwin.io import files, untrusted_json
from radartwin.store.digest import canonical, source_digest, spec_digest

if TYPE_CHECKING:
    import numpy as np

KEY_LENGTH = 32  # 128 bits of the digest name the folder
SHORT = 8
META = "meta.json"
CACHE = "cache"  # subfolder of the output folder with the stored results, all of which can be computed again
NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
RUN = "run"  # kind of the stored results of experiments


@dataclass(frozen=True)
class Product:
    """A stored result. `reused` is True if it was already in the store, and False if this call computed it."""

    path: Path
    key: str
    reused: bool

    def arrays(self, name: str = "arrays") -> dict[str, np.ndarray]:
        return files.read_arrays(self.path / f"{name}.npz")

    def read_json(self, name: str) -> Any:
        return untrusted_json.read(self.path / f"{name}.json")


@dataclass
class Counts:
    """Record the pairs (kind, key) of results that were computed (built), and found (stored) without being computed before."""

    built: set[tuple[str, str]] = field(default_factory=set)
    stored: set[tuple[str, str]] = field(default_factory=set)

    @property
    def simulated(self) -> int:
        return len(self.built) - self.scored

    @property
    def reused(self) -> int:
        return len(self.stored - self.built)

    @property
    def scored(self) -> int:
        return sum(kind == RUN for kind, _ in self.built)

    @property
    def by_kind(self) -> Counter[str]:
        """Return the number of stored results of each kind, with keys such as "KIND built" and "KIND reused"."""
        built, reused = (Counter(kind for kind, _ in pairs) for pairs in (self.built, self.stored - self.built))
        return Counter({f"{kind} built": n for kind, n in built.items()} | {f"{kind} reused": n for kind, n in reused.items()})

    def __str__(self) -> str:
        return f"simulated {self.simulated}, reused {self.reused}, scored {self.scored}"

    def __add__(self, other: Counts) -> Counts:
        return Counts(self.built | other.built, self.stored | other.stored)


_open_counts: list[Counts] = []


@contextlib.contextmanager
def counting() -> Iterator[Counts]:
    """Count all stored results that this process and its workers fetch from any store within the `with` block."""
    counts = Counts()
    _open_counts.append(counts)
    try:
        yield counts
    finally:
        _open_counts[:] = [other for other in _open_counts if other is not counts]


def count(more: Counts) -> None:
    """Add the counts of stored results from a worker to all `Counts` that are active in this process."""
    for counts in _open_counts:
        counts.built |= more.built
        counts.stored |= more.stored


class Store:
    """Store computed results in the cache folder of an output folder. Any number of processes may share the folder.

    Args:
        root: folder of the cache, usually output/cache. The store creates the folder and removes the unfinished results of killed
            processes.
        say: function that receives a message when another process is computing a needed result, and when a stored result is damaged.
    Raises:
        OutputError: the cache folder cannot be written.
    """

    def __init__(self, root: Path, say: Callable[[str], None] = lambda line: None) -> None:
        self.root = files.make_folder(Path(root).absolute())
        self._say = say
        self._verified: set[Path] = set()
        for kind in sorted(path for path in self.root.iterdir() if path.is_dir()):
            files.sweep(kind)
            for lock in kind.glob(f".{'[0-9a-f]' * KEY_LENGTH}.lock"):
                files.drop_stale(lock)

    def key(self, kind: str, spec: Mapping[str, Any], entries: Iterable[str]) -> str:
        """Return the key of a stored result; `fetch` describes the arguments."""
        return spec_digest({"kind": kind, "spec": spec, "source": source_digest(entries)})[:KEY_LENGTH]

    def fetch(self, kind: str, spec: Mapping[str, Any], entries: Iterable[str], build: Callable[[Path], object]) -> Product:
        """Return the stored result that belongs to the specification `spec`, computed first if the store does not hold it.

        Args:
            kind: subfolder of the cache, such as "recording".
            spec: plain values, arrays and dataclasses that together determine the content of the result.
            entries: modules or packages where the computation starts; the key depends on the source code of all packages that they import.
            build: function that writes the files of the result into an empty folder; a mapping that it returns becomes `told` of meta.json.
        Raises:
            OutputError: the disk of the store is full or read-only.
        """
        entries = list(entries)
        key = self.key(kind, spec, entries)
        with _disk_errors(self.root):
            product = self._fetch(kind, key, build, {"spec": spec, "modules": entries})
        count(Counts(stored={(kind, key)}) if product.reused else Counts(built={(kind, key)}))
        return product

    def holds(self, kind: str, spec: Mapping[str, Any], entries: Iterable[str]) -> bool:
        """Return whether the store holds the complete result of this specification, without computing it."""
        return self._complete(self.root / kind / self.key(kind, spec, entries))

    def _fetch(self, kind: str, key: str, build: Callable[[Path], object], described: dict[str, Any]) -> Product:
        final = self.root / kind / key
        if self._complete(final):
            return Product(final, key, reused=True)
        with files.lock(lock_file(final), lambda: self._say(f"waiting for another process to finish {kind} {key[:SHORT]}")):
            if self._complete(final):
                return Product(final, key, reused=True)
            if os.path.lexists(final):
                self._say(f"{kind} {key[:SHORT]} in the cache is damaged (a file has changed); computing it again")
            for path in (final, *final.parent.glob(f".{key}.*{files.TEMPORARY}")):  # who left an unfinished folder has lost the lock
                files.remove(path)
            _build(build, files.unfinished(final), final, {"kind": kind, "key": key, **described})
        return Product(final, key, reused=False)

    def _complete(self, product: Path) -> bool:
        """Return whether the files of a stored result are unchanged: at the first check their content, later only their sizes."""
        complete = _as_written(product, read=product not in self._verified)
        if complete:
            self._verified.add(product)
        return complete


def lock_file(product: Path) -> Path:
    """Return the file that the process which computes a stored result locks."""
    return product.with_name(f".{product.name}.lock")


def _build(build: Callable[[Path], object], folder: Path, final: Path, described: dict[str, Any]) -> None:
    folder.mkdir()
    try:
        started, worked = time.monotonic(), time.process_time()
        told = build(folder)
        meta = described | {
            "spec": json.loads(canonical(described["spec"])),
            "radartwin": __version__,
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "seconds": round(time.monotonic() - started, 3),
            "core_seconds": round(time.process_time() - worked, 3),
            "told": dict(told) if isinstance(told, Mapping) else {},
            "bytes": (sizes := _sizes(folder)),
            "sha256": {name: _sha256(folder / name) for name in sizes},
        }
        save_json(folder, META.removesuffix(".json"), meta)
        files.sync(folder)
        folder.rename(final)
        files.sync(final.parent, deep=False)
    finally:
        files.remove(folder)


def _sizes(folder: Path) -> dict[str, int]:
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in sorted(folder.rglob("*")) if path.is_file()}


def _as_written(product: Path, read: bool) -> bool:
    """Return whether every file has the size, and if `read` the content, that meta.json records. Links are refused."""
    try:
        meta = untrusted_json.read(product / META)
        if not meta["bytes"].items() <= _sizes(product).items() or any(path.is_symlink() for path in product.rglob("*")):
            return False
        if meta["sha256"].keys() != meta["bytes"].keys():
            return False
        return not read or all(_sha256(product / name) == digest for name, digest in meta["sha256"].items())
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return False


def _sha256(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextlib.contextmanager
def _disk_errors(root: Path) -> Iterator[None]:
    """Convert the error of a full or read-only disk within the `with` block to an OutputError with a one-line message."""
    try:
        yield
    except UserError:
        raise
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        where = error.filename or root
        raise OutputError(
            f"{where}: {error.strerror}; free some space or choose another output, then run the same command again"
        ) from error


def save_arrays(folder: Path, arrays: Mapping[str, np.ndarray], name: str = "arrays") -> None:
    """Write NAME.npz into the folder of an unfinished result; `Product.arrays` reads this file."""
    import numpy as np

    np.savez(folder / f"{name}.npz", **dict(arrays))  # pyright: ignore[reportArgumentType]


def save_json(folder: Path, name: str, content: Any) -> None:
    """Write NAME.json into the folder of an unfinished result; `Product.read_json` reads this file."""
    (folder / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
