"""Read the pictures of a camera that stood beside the radar: a folder of picture files that are named by their times.

The name of a picture without its suffix is its time in seconds on the clock of the recording, for example 1709294400.250.jpg, as in the
TUM RGB-D data sets. The function `read_pictures` reads only the names; the bytes are read one picture at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

from radartwin.errors import InputError, MissingError
from radartwin.io.git_lfs import refuse_pointer

KINDS = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png", ".webp": "webp"}
_STARTS = {"jpeg": b"\xff\xd8\xff", "png": b"\x89PNG\r\n\x1a\n", "webp": b"RIFF"}


@dataclass(frozen=True)
class Picture:
    """Hold the file of a picture, its time in nanoseconds and its kind ("jpeg", "png" or "webp")."""

    path: Path
    time_ns: int
    kind: str

    def read(self) -> bytes:
        """Read the bytes of the picture file. Raise InputError if the file cannot be read or its content is no picture of this kind."""
        refuse_pointer(self.path, InputError)
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise InputError(f"{self.path}: cannot read this picture ({error.strerror or error}); make it readable or remove it") from error
        if not data.startswith(_STARTS[self.kind]):
            raise InputError(f"{self.path}: not a {self.kind} picture; correct its suffix or remove the file")
        return data


def read_pictures(folder: Path) -> list[Picture]:
    """Find the pictures of a folder and return them in ascending order of time.

    Raises:
        MissingError: the folder does not exist or has no picture.
        InputError: the name of a picture is not a time.
    """
    if not folder.is_dir():
        raise MissingError(f"{folder}: no such folder of pictures; give a folder with files such as 0.100.jpg")
    pictures = [
        Picture(path, nanoseconds(path.stem, str(path)), kind)
        for path in folder.iterdir()
        if (kind := KINDS.get(path.suffix.lower())) and path.is_file()
    ]
    if not pictures:
        raise MissingError(f"{folder}: no picture in this folder; give files named by their time in seconds, such as 0.100.jpg")
    return sorted(pictures, key=lambda picture: (picture.time_ns, picture.path.name))


def nanoseconds(text: str, what: str) -> int:
    """Convert a time in seconds, written as a decimal number, to nanoseconds. Raise InputError if the text is no time from 0 to 4e9 s.

    The messages of a timeline hold the seconds in 32 bits.

    >>> nanoseconds("1709294400.25", "start")
    1709294400250000000
    """
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        raise InputError(f"{what}: {text!r} is no time; give seconds such as 1709294400.250") from None
    if not seconds.is_finite() or not 0 <= seconds <= 4_000_000_000:
        raise InputError(f"{what}: the time {text} is not from 0 to 4e9 seconds")
    return int((seconds * 1_000_000_000).to_integral_value())
