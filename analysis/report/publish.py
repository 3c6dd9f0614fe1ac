"""Publish the report's files so that index.html never links to missing files.

The files are collected in a temporary folder, this folder is named by a hash of its content, and index.html is replaced last.

    report/index.html           links to one folder of parts
    report/parts-DIGEST/        figures, tables, rooms

A user who opens index.html at any moment finds either the complete old report or the complete new report.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from radartwin.io import files

INDEX, LOCK = "index.html", f".report{files.TEMPORARY}"
STAGE = f".parts{files.TEMPORARY}"
_PARTS = re.compile(r"parts-[0-9a-f]{12}")


class Stage:
    """The temporary folder in which the report's files are collected before they are published."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._folder = root / STAGE

    def take(self, source: Path, part: str) -> str:
        """Copy a file into a part (figures, tables or rooms). Returns the link to the copied file, relative to the parts
        folder.
        """
        link = f"{part}/{source.name}"
        shutil.copyfile(source, self.path(link))
        return link

    def path(self, link: str) -> Path:
        """Return the path of a file in the temporary parts folder, given the file's link."""
        path = self._folder / link
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def publish(self, page: Callable[[str], str]) -> Path:
        """Publish the report and return the path of index.html.

        The method names the parts folder by a hash of its content, writes the page that `page` returns for that name, and removes the files
        of earlier reports.
        """
        digest = _digest(self._folder)
        parts = self.root / f"parts-{digest[:12]}"
        text = page(parts.name)
        if parts.exists() and _digest(parts) != digest:  # the user changed the published folder
            shutil.rmtree(parts)
        if not parts.exists():
            files.sync(self._folder)
            self._folder.rename(parts)
            files.sync(self.root, deep=False)
        index = files.write_atomically(self.root / INDEX, text)
        for old in self.root.iterdir():
            if _PARTS.fullmatch(old.name) and old != parts:
                shutil.rmtree(old)
        return index


@contextlib.contextmanager
def staged(root: Path) -> Iterator[Stage]:
    """Yield an empty Stage while holding the lock of the report folder. Raises OutputError if the folder cannot be created or written."""
    files.make_folder(root)
    with files.lock(root / LOCK):
        shutil.rmtree(root / STAGE, ignore_errors=True)  # left by a killed process
        try:
            (root / STAGE).mkdir()
            yield Stage(root)
        finally:
            shutil.rmtree(root / STAGE, ignore_errors=True)


def _digest(folder: Path) -> str:
    """Return one SHA-256 of the names and contents of all files in the folder."""
    total = hashlib.sha256()
    for path in sorted(file for file in folder.rglob("*") if file.is_file()):
        total.update(f"{path.relative_to(folder).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return total.hexdigest()
