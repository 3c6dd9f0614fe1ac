"""Small file systems for tests of full and read-only disks. Without root, which mounting needs, these tests are skipped."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest


class Disk:
    """A small file system in memory, mounted at `folder`."""

    def __init__(self, folder: Path, megabytes: int) -> None:
        self.folder = folder
        self._mount("-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs")

    def _mount(self, *options: str) -> None:
        subprocess.run(["mount", *options, str(self.folder)], capture_output=True, check=True)

    def fill(self, leave: int = 0) -> None:
        """Fill the disk until only `leave` bytes are free, rounded to a memory page."""
        with (self.folder / "filler").open("wb", buffering=0) as stream:
            try:
                while stream.write(bytes(4096)):
                    pass
            except OSError:
                stream.truncate(max(0, stream.tell() - leave))

    def empty(self) -> None:
        """Remove the file that `fill` wrote, so that its space is free again."""
        (self.folder / "filler").unlink()

    @contextlib.contextmanager
    def read_only(self) -> Iterator[Path]:
        """Return a second path to the disk through which the disk can only be read. Files that are already open for
        writing stay writable.
        """
        view = self.folder.with_name("read_only")
        view.mkdir()
        subprocess.run(["mount", "--bind", str(self.folder), str(view)], check=True)
        try:
            subprocess.run(["mount", "-o", "remount,bind,ro", str(view)], check=True)
            yield view
        finally:
            subprocess.run(["umount", "--lazy", str(view)], check=True)
            view.rmdir()

    def unmount(self) -> None:
        subprocess.run(["umount", "--lazy", str(self.folder)], check=True)

    def content(self) -> dict[str, bytes]:
        """Return the content of every file on the disk, except the file that `fill` wrote."""
        found = (path for path in sorted(self.folder.rglob("*")) if path.is_file() and path.name != "filler")
        return {path.relative_to(self.folder).as_posix(): path.read_bytes() for path in found}


def mounted(folder: Path, megabytes: int) -> Iterator[Disk]:
    folder.mkdir()
    try:
        disk = Disk(folder, megabytes)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no file system can be mounted here: run as root to test a disk that is full or can only be read")
    yield disk
    disk.unmount()
