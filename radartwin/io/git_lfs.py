"""Recognise the text files that Git LFS leaves in the place of large files."""

from __future__ import annotations

from pathlib import Path

from radartwin.errors import RecordingError

_BEGIN = b"version https://git-lfs.github.com/spec/"


def refuse_pointer(path: Path, error: type[Exception] = RecordingError) -> None:
    """Raise `error` if a file is a Git LFS pointer, which names a large file that was not downloaded. A file that is absent passes."""
    try:
        with path.open("rb") as stream:
            pointer = stream.read(len(_BEGIN)) == _BEGIN
    except OSError:
        return
    if pointer:
        raise error(f"{path}: it is a Git LFS pointer and not the file itself; run git lfs pull where it came from, and copy the file")
