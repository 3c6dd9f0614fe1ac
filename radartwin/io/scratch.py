"""Keep an array that may be larger than memory in an unnamed file, which the system removes even if the process is killed."""

from __future__ import annotations

import math
import mmap
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import OutputError


class ScratchArray:
    """Write an array row by row to an unnamed file in a folder, and map the file into memory at the end.

    Args:
        shape: shape of the array; the first axis counts the rows.
        later_bytes: size of the files that the caller writes to the folder while the array exists.
    Raises:
        OutputError: the folder cannot be written, or its disk lacks the space for the array and the later files.

    >>> scratch = ScratchArray(Path(tempfile.gettempdir()), (2, 3), np.float32)
    >>> scratch.write(np.ones((2, 3), np.float32))
    >>> scratch.array().sum(axis=1).tolist()
    [3.0, 3.0]
    """

    def __init__(self, folder: Path, shape: tuple[int, ...], dtype: Any, later_bytes: int = 0) -> None:
        self._folder, self._shape, self._dtype = folder, shape, np.dtype(dtype)
        self._bytes = math.prod(shape) * self._dtype.itemsize + later_bytes
        try:
            free = shutil.disk_usage(folder).free
            self._stream: Any = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115, `array` closes it
        except OSError as error:
            raise self._failed(error.strerror or error) from error
        if self._bytes > free:
            self.close()
            raise self._failed(f"{free / 1e9:.3g} GB are free")

    def write(self, rows: np.ndarray) -> None:
        """Append rows. Raises OutputError if the disk is full."""
        try:
            self._stream.write(np.ascontiguousarray(rows, self._dtype).data)
            self._stream.flush()
        except OSError as error:
            raise self._failed(error.strerror or error) from error

    def array(self) -> np.ndarray:
        """Return the written array, mapped into memory. The caller may change its elements."""
        with self._stream:
            return np.memmap(self._stream, self._dtype, "r+", shape=self._shape)

    def close(self) -> None:
        """Close the file. The system then removes it, but an array that is mapped to it stays valid."""
        self._stream.close()

    def _failed(self, reason: object) -> OutputError:
        held = f"cannot hold {self._bytes / 1e9:.3g} GB of samples ({reason})"
        return OutputError(f"{self._folder}: {held}; free some space or choose another folder")


def release(array: np.ndarray) -> None:
    """Remove the pages of a memory-mapped array from memory. Arrays in memory and copy-on-write mappings stay as they are."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        if isinstance(owner, np.memmap) and owner.mode == "c":
            return
        owner = owner.base
    if isinstance(owner, mmap.mmap) and hasattr(owner, "madvise"):
        owner.madvise(mmap.MADV_DONTNEED)


def folder_for(path: Path) -> Path:
    """Return the folder of a file if this process may write there, or else the system's folder of temporary files."""
    return path.parent if os.access(path.parent, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())
