"""The command `radartwin clean` lists the stored results of an output folder with their sizes, and deletes them on request."""

from __future__ import annotations

import contextlib
import re
import shutil
from pathlib import Path

from radartwin.errors import MissingError, OutputError
from radartwin.io import files
from radartwin.store.products import KEY_LENGTH, META

CACHE = "cache"  # subfolder of the output folder; RadarTwin can compute again everything that it wrote into this subfolder
_PRODUCT = re.compile(rf"[0-9a-f]{{{KEY_LENGTH}}}")
_UNFINISHED = re.compile(rf"\.?[0-9a-f]{{{KEY_LENGTH}}}(\.radartwin-.+)?{re.escape(files.TEMPORARY)}")  # version 1.0 wrote KEY.tmp
_ARRAYS = re.compile(r"[0-9a-f]{64}\.npz")  # file of radartwin/store/array_cache.py, whose key is the whole digest


def cache_bytes(output: Path) -> dict[str, int]:
    """Return {kind of stored result: size in bytes} for the folder OUTPUT/cache, largest size first."""
    sizes = {
        kind: sum(files.folder_bytes(path) if path.is_dir() else path.stat().st_size for path in paths)
        for kind, paths in _stored(output).items()
    }
    return dict(sorted(sizes.items(), key=lambda entry: -entry[1]))


def clean(output: Path, cache: bool) -> int:
    """Print the size of each kind of stored result. If `cache` is True, also delete all stored results. Returns the exit status.

    Raises:
        MissingError: the output folder does not exist.
        OutputError: a running process computes a stored result, or a stored result cannot be deleted.
    """
    if not Path(output).is_dir():
        raise MissingError(f"{output}: no such folder; give the output folder of a run with --output")
    sizes = cache_bytes(output)
    folder = Path(output) / CACHE
    for kind, size in sizes.items():
        print(f"{kind:20s}{size / 1e6:10.1f} MB")
    total = f"{sum(sizes.values()) / 1e6:.1f} MB"
    if not cache:
        print(f"clean: {total} in {folder}; radartwin clean --cache deletes them, and the next run computes them again")
        return 0
    stored = _stored(output)
    for lock in (lock for kind in stored for lock in (folder / kind).glob(f".{'[0-9a-f]' * KEY_LENGTH}.lock")):
        files.drop_stale(lock)
        if lock.exists():
            raise OutputError(f"{lock}: a running process computes this result; end the process, then try again")
    for kind, paths in stored.items():
        try:
            for path in paths:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        except OSError as error:
            raise OutputError(
                f"{error.filename}: cannot be deleted ({error.strerror}); end the runs that use it, then try again"
            ) from error
        with contextlib.suppress(OSError):  # files that RadarTwin did not write remain
            (folder / kind).rmdir()
    print(f"clean: deleted {total} in {folder}")
    return 0


def _stored(output: Path) -> dict[str, list[Path]]:
    """Return the stored results in OUTPUT/cache by kind. Files and folders that RadarTwin did not write do not count."""
    folder = Path(output) / CACHE
    kinds = [path for path in sorted(folder.iterdir()) if path.is_dir() and not path.is_symlink()] if folder.is_dir() else []
    stored = {kind.name: [path for path in sorted(kind.iterdir()) if _is_stored(path)] for kind in kinds}
    return {kind: paths for kind, paths in stored.items() if paths}


def _is_stored(path: Path) -> bool:
    if path.is_symlink():
        return False
    if path.is_dir():
        return _UNFINISHED.fullmatch(path.name) is not None or (_PRODUCT.fullmatch(path.name) is not None and (path / META).is_file())
    return _ARRAYS.fullmatch(path.name) is not None
