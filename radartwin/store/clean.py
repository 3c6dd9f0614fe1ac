"""The command `radartwin clean` lists the stored results of an output folder with their sizes, and deletes them on request."""

from __future__ import annotations

import shutil
from pathlib import Path

from radartwin.errors import OutputError
from radartwin.io import files

CACHE = "cache"  # in the output folder; everything in it can be computed again


def cache_bytes(output: Path) -> dict[str, int]:
    """Return {kind of stored result: size in bytes} for the folder OUTPUT/cache, largest size first."""
    folder = Path(output) / CACHE
    kinds = [path for path in sorted(folder.iterdir()) if path.is_dir() and not path.is_symlink()] if folder.is_dir() else []
    sizes = {kind.name: files.folder_bytes(kind) for kind in kinds}
    return dict(sorted(sizes.items(), key=lambda entry: -entry[1]))


def clean(output: Path, cache: bool) -> int:
    """Print the size of each kind of stored result. If `cache` is True, also delete all stored results. Returns the exit status.

    Raises:
        OutputError: a stored result cannot be deleted.
    """
    sizes = cache_bytes(output)
    folder = Path(output) / CACHE
    for kind, size in sizes.items():
        print(f"{kind:20s}{size / 1e6:10.1f} MB")
    total = f"{sum(sizes.values()) / 1e6:.1f} MB"
    if not cache:
        print(f"clean: {total} in {folder}; radartwin clean --cache deletes them, and the next run computes them again")
        return 0
    for kind in sizes:
        try:
            shutil.rmtree(folder / kind)
        except OSError as error:
            raise OutputError(
                f"{error.filename}: cannot be deleted ({error.strerror}); end the runs that use it, then try again"
            ) from error
    print(f"clean: deleted {total} in {folder}")
    return 0
