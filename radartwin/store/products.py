"""The cache of everything computed: a product is a folder under its key, whole or absent.

    output/cache/KIND/KEY/          the product, with meta.json beside what `build` wrote
    output/cache/KIND/KEY.tmp/      while it is being built, under a lock; left by a killed process, swept at a start

The key of a product is the digest of three things (radartwin/store/digest.py): the specification, the source of the modules
that compute it, and the content of its input files. A finished key is not computed again while its files are
what meta.json recorded (size and SHA-256); a failed, killed or damaged one is.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin import __version__
from radartwin.errors import OutputError, UserError
from radartwin.io import files, untrusted_json
from radartwin.store.digest import canonical, source_digest, spec_digest

if TYPE_CHECKING:
    import numpy as np

KEY_LENGTH = 32  # 128 bits of the digest name the folder
SHORT = 8
META = "meta.json"
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
RUN = "run"  # the kind of a scored experiment


@dataclass(frozen=True)
class Product:
    """A finished folder of the cache. `reused` says that this process did not compute it."""

    path: Path
    key: str
    reused: bool

    def arrays(self, name: str = "arrays") -> dict[str, np.ndarray]:
        """What `save_arrays` wrote."""
        return files.read_arrays(self.path / f"{name}.npz")

    def read_json(self, name: str) -> Any:
        return untrusted_json.read(self.path / f"{name}.json")


@dataclass
class Counts:
    """What one process did: products simulated, products found in the cache, experiments scored."""

    simulated: int = 0
    reused: int = 0
    scored: int = 0
    by_kind: Counter[str] = field(default_factory=Counter)

    def add(self, kind: str, reused: bool) -> None:
        self.by_kind[f"{kind} {'reused' if reused else 'built'}"] += 1
        if reused:
            self.reused += 1
        elif kind == RUN:
            self.scored += 1
        else:
            self.simulated += 1

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.simulated + other.simulated,
            self.reused + other.reused,
            self.scored + other.scored,
            self.by_kind + other.by_kind,
        )


class Store:
    """The cache below one output folder; any number of processes may share it.

    Args:
        root: usually output/cache; created, and swept of what killed processes left.
        say: receives a line when another process is computing what this one needs, and when a product is damaged.
    Raises:
        OutputError: the folder cannot be written.
    """

    def __init__(self, root: Path, say: Callable[[str], None] = lambda line: None) -> None:
        self.root = files.make_folder(Path(root).absolute())
        self.counts = Counts()
        self._say = say
        self._sound: set[Path] = set()
        for work in sorted(self.root.glob(f"*/*{files.TEMPORARY}")):
            if re.fullmatch(rf"[0-9a-f]{{{KEY_LENGTH}}}", work.name.removesuffix(files.TEMPORARY)) and work.is_dir():
                files.drop_abandoned(work)

    def key(self, kind: str, spec: Mapping[str, Any], roots: Iterable[str], inputs: Mapping[str, str] | None = None) -> str:
        """Key of a product; `roots` name the modules that compute it, `inputs` are digests of files it reads."""
        parts = {"kind": kind, "spec": spec, "source": source_digest(roots), "inputs": dict(inputs or {})}
        return spec_digest(parts)[:KEY_LENGTH]

    def fetch(
        self,
        kind: str,
        spec: Mapping[str, Any],
        roots: Iterable[str],
        build: Callable[[Path], object],
        inputs: Mapping[str, str] | None = None,
    ) -> Product:
        """The product of this specification, from the cache or built now.

        Args:
            kind: folder of the cache, e.g. "recording"; "run" counts as scored, all else as simulated.
            spec: everything that decides the content: plain values, arrays and dataclasses (radartwin/store/digest.py).
            roots: modules whose source, with all they import, decides the content.
            build: fills the empty folder it is given; a mapping that it returns is kept as `told` in meta.json, beside the time it took. If
                it raises, nothing is kept and the next fetch tries again.
        """
        roots = list(roots)
        key = self.key(kind, spec, roots, inputs)
        with _room_told(self.root):
            return self._fetch(kind, key, spec, roots, build)

    def holds(self, kind: str, spec: Mapping[str, Any], roots: Iterable[str], inputs: Mapping[str, str] | None = None) -> bool:
        """Whether the product is in the cache, whole. Computes nothing."""
        return self._whole(self.root / kind / self.key(kind, spec, list(roots), inputs))

    def _fetch(self, kind: str, key: str, spec: Mapping[str, Any], roots: list[str], build: Callable[[Path], object]) -> Product:
        final, work = self.root / kind / key, self.root / kind / f"{key}{files.TEMPORARY}"
        if self._whole(final):
            return self._count(kind, Product(final, key, reused=True))
        try:
            with files.lock(work / files.LOCK, lambda: self._say(f"waiting for another process to finish {kind} {key[:SHORT]}")):
                if self._whole(final):
                    return self._count(kind, Product(final, key, reused=True))
                if os.path.lexists(final):
                    self._say(f"{kind} {key[:SHORT]} in the cache is damaged (its files are not as they were written); building it again")
                    shutil.rmtree(final) if final.is_dir() and not final.is_symlink() else final.unlink()
                self._build(kind, key, spec, roots, build, work / "product", final)
        finally:
            with contextlib.suppress(OSError):  # somebody may be waiting in it; the last one out removes it
                work.rmdir()
        return self._count(kind, Product(final, key, reused=False))

    @staticmethod
    def _build(
        kind: str,
        key: str,
        spec: Mapping[str, Any],
        roots: list[str],
        build: Callable[[Path], object],
        folder: Path,
        final: Path,
    ) -> None:
        shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed here
        folder.mkdir()
        try:
            started, worked = time.monotonic(), time.process_time()
            told = build(folder)
            meta = {
                "kind": kind,
                "key": key,
                "spec": json.loads(canonical(spec)),
                "modules": roots,
                "radartwin": __version__,
                "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                "seconds": round(time.monotonic() - started, 3),
                "core_seconds": round(time.process_time() - worked, 3),
                "told": dict(told) if isinstance(told, Mapping) else {},
                "bytes": _sizes(folder),
                "sha256": {name: _digest(folder / name) for name in _sizes(folder)},
            }
            save_json(folder, META.removesuffix(".json"), meta)
            files.sync(folder)
            folder.rename(final)
            files.sync(final.parent, deep=False)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _whole(self, product: Path) -> bool:
        """Whether a finished product is as it was written: its content is read once, then its sizes are compared."""
        verified = _verified(product, content=product not in self._sound)
        if verified:
            self._sound.add(product)
        return verified

    def _count(self, kind: str, product: Product) -> Product:
        self.counts.add(kind, product.reused)
        return product


def _sizes(folder: Path) -> dict[str, int]:
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in sorted(folder.rglob("*")) if path.is_file()}


def _verified(product: Path, content: bool) -> bool:
    """Whether every file has the size, and the content, that meta.json recorded; others may lie beside them, but no link to elsewhere."""
    try:
        meta = untrusted_json.read(product / META)
        if not meta["bytes"].items() <= _sizes(product).items() or any(path.is_symlink() for path in product.rglob("*")):
            return False
        return not content or all(_digest(product / name) == digest for name, digest in meta.get("sha256", {}).items())
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return False


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextlib.contextmanager
def _room_told(root: Path) -> Iterator[None]:
    """A disk that is full, or can only be read, is the user's to mend: one line instead of a traceback."""
    try:
        yield
    except UserError:
        raise
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        where = error.filename or root
        raise OutputError(
            f"{where}: {error.strerror}; free some space or choose another output, then run the same command again"
        ) from error


def save_arrays(folder: Path, arrays: Mapping[str, np.ndarray], name: str = "arrays") -> None:
    """Write NAME.npz into a folder under construction; `Product.arrays` reads it."""
    import numpy as np

    np.savez(folder / f"{name}.npz", **dict(arrays))  # pyright: ignore[reportArgumentType]


def save_json(folder: Path, name: str, content: Any) -> None:
    """Write NAME.json into a folder under construction; `Product.read_json` reads it."""
    (folder / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
