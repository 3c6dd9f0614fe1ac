"""Small disks that fill up or can only be read. Mounting needs root; elsewhere these tests are skipped and say so."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest


class Disk:
    """A file system of its own in memory, at `folder`."""

    def __init__(self, folder: Path, megabytes: int) -> None:
        self.folder = folder
        self._mount("-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs")

    def _mount(self, *options: str) -> None:
        subprocess.run(["mount", *options, str(self.folder)], capture_output=True, check=True)

    def fill(self, leave: int = 0) -> None:
        """Until so many bytes are free, to a page."""
        with (self.folder / "filler").open("wb", buffering=0) as stream:
            try:
                while stream.write(bytes(4096)):
                    pass
            except OSError:
                stream.truncate(max(0, stream.tell() - leave))

    def empty(self) -> None:
        """As before `fill`."""
        (self.folder / "filler").unlink()

    @contextlib.contextmanager
    def read_only(self) -> Iterator[Path]:
        """Another path to it, through which it can only be read; files that are open for writing do not mind."""
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
        """Every file but the filler."""
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
