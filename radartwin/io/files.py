"""Write files atomically, read arrays from files, and lock files against other processes.

A file is written under a temporary name in the same folder, forced to the disk and renamed, so that it is complete or absent.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from filelock import BaseFileLock, FileLock, Timeout

from radartwin.errors import InputError, OutputError, UserError
from radartwin.io.git_lfs import refuse_pointer

if TYPE_CHECKING:
    import numpy as np

# suffix of every unfinished file or folder; a later process removes the unfinished files and folders of killed processes
TEMPORARY = ".tmp"
_UNFINISHED = re.compile(rf"\..+\.radartwin-(?:(.+)-)?(\d{{1,9}}){re.escape(TEMPORARY)}")  # .NAME.radartwin-HOST-PID.tmp


def check_folder(folder: Path) -> Path:
    """Check that a folder can be created or written, without creating it, before long work starts. Raises OutputError if it cannot."""
    existing = Path(folder).absolute()
    while not existing.exists():
        existing = existing.parent
    if not existing.is_dir():
        raise OutputError(f"{folder}: {existing} is not a folder; choose another place for the output")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: {existing} cannot be written; choose another place for the output")
    return folder


def make_folder(folder: Path) -> Path:
    """Create the folder if it does not exist. Raises OutputError if the folder cannot be created or written."""
    check_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); choose another place for the output") from error
    return folder


def unfinished(path: Path) -> Path:
    """Return the temporary path in the same folder as `path` under which this process writes a file or folder until it is complete."""
    return path.with_name(f".{path.name}.radartwin-{socket.gethostname()}-{os.getpid()}{TEMPORARY}")


def write_atomically(path: Path, content: bytes | str) -> Path:
    """Write a file so that after any failure it has either its old or its complete new content. Raises OutputError, see `replacing`."""
    with replacing(path) as stream:
        stream.write(content.encode() if isinstance(content, str) else content)
    return path


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """Yield a stream whose content replaces the file when the `with` block ends without an exception. Raises OutputError."""
    with replacing_together([path]) as temporary, temporary[path].open("xb") as stream:
        yield stream


@contextlib.contextmanager
def replacing_together(paths: Sequence[Path]) -> Iterator[dict[Path, Path]]:
    """Yield a temporary path for each of the files of one folder, by final path. The caller writes all files under their temporary paths.

    When the `with` block ends without an exception, the function forces the files to the disk and renames them in the given order, while
    other processes that replace the same files wait. Of several files, the last describes the others, so the function first deletes an
    existing last file. Therefore, after a kill at any moment, an existing last file belongs to the other files.

    Raises:
        OutputError: the folder cannot be created or written. No temporary file remains.
    """
    make_folder(paths[0].parent)
    temporary = {path: unfinished(path) for path in paths}
    together = len(paths) > 1
    try:
        for written in temporary.values():
            remove(written)  # a killed process with the same number may have left it
        yield temporary
        for written in temporary.values():
            sync(written)
        with lock(paths[0].with_name(f".{paths[0].name}.lock")) if together else contextlib.nullcontext():
            if together:
                paths[-1].unlink(missing_ok=True)
            for path, written in temporary.items():
                written.replace(path)
    except UserError:
        raise
    except OSError as error:
        where = paths[0].parent if together else paths[0]
        raise OutputError(f"{where}: cannot write ({error.strerror or error}); free some space or choose another folder") from error
    finally:
        for written in temporary.values():
            with contextlib.suppress(OSError):
                written.unlink(missing_ok=True)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file by name, without Python objects. Raises InputError for a damaged or inflated archive, and OSError."""
    import numpy as np

    with _reading(path, ".npz archive") as stream:
        _check_archive(stream, path)
        with np.load(stream, allow_pickle=False) as stored:
            return dict(stored)


def read_array(path: Path) -> np.ndarray:
    """Map the array of a .npy file into memory, without Python objects. Raises InputError for a damaged or too short file, and OSError."""
    import numpy as np

    with _reading(path, ".npy array") as stream:
        _check_header(stream, path.stat().st_size, str(path))
        return np.load(path, mmap_mode="r", allow_pickle=False)


@contextlib.contextmanager
def _reading(path: Path, kind: str) -> Iterator[IO[bytes]]:
    """Open a file, and raise the errors of zipfile, zlib and NumPy within the `with` block as an InputError of one line."""
    import zipfile
    import zlib

    refuse_pointer(path, InputError)
    try:
        with path.open("rb") as stream:
            yield stream
    except InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, RuntimeError) as error:  # RuntimeError: an unknown compression
        raise InputError(f"{path} is not a readable {kind} ({' '.join(str(error).split()) or 'it ends early'})") from error


def _check_archive(stream: IO[bytes], path: Path) -> None:
    """Check the headers of an .npz archive before memory is allocated for its arrays, then set the stream back to its start."""
    import zipfile

    with zipfile.ZipFile(stream) as archive:
        unpacked, size = sum(member.file_size for member in archive.infolist()), stream.seek(0, os.SEEK_END)
        # radartwin writes arrays uncompressed, so that a valid archive is about as large as its arrays
        if unpacked > 16 * size + (64 << 20):
            raise InputError(f"{path} has {size:,} bytes but would unpack to {unpacked:,} bytes; save the arrays without compression")
        for member in archive.infolist():
            with archive.open(member) as content:
                _check_header(content, member.file_size, f"{path}, {member.filename},")
    stream.seek(0)


def _check_header(stream: IO[bytes], size: int, label: str) -> None:
    """Refuse a .npy array that holds Python objects or is larger than `size` bytes. Raises InputError or ValueError."""
    from numpy.lib import format as npy

    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(npy.read_magic(stream))
    if read is None:
        raise InputError(f"{label} has an unsupported .npy format version; save the array again with numpy.save")
    shape, _, kind = read(stream)
    if kind.hasobject or math.prod(shape) * kind.itemsize > size:
        raise InputError(f"{label} declares an array {shape} of {kind} but has {size:,} bytes; save a complete array of numbers")


def csv_text(rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Return the text of a .csv file with a header and these rows."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def inside(folder: Path, name: str) -> Path:
    """Return FOLDER/NAME for a name from an index in the folder. Raises InputError if the name or a link leads out of the folder."""
    path = folder / name
    if "\0" in name or not path.resolve().is_relative_to(folder.resolve()):
        outside = f"{folder}: its index names the file {name!r} outside this folder"
        raise InputError(f"{outside}; copy the file into the folder and correct the index")
    return path


def folder_bytes(folder: Path) -> int:
    """Return the size of all files in a folder, in bytes; 0 if the folder does not exist."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):  # another process may have removed the file
                total += os.lstat(os.path.join(parent, name)).st_size
    return total


def sync(path: Path, deep: bool = True) -> None:
    """Force a file or folder from memory to the disk; with `deep`, also all files and folders inside the folder."""
    if deep and path.is_dir():
        for child in path.iterdir():
            sync(child)
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def lock(path: Path, waiting: Callable[[], None] | None = None) -> Iterator[None]:
    """Hold a lock on the file `path` within the `with` block. The system releases the lock of a process that dies.

    The lock file exists only while a process holds the lock or waits for it. `waiting` is called once if another process holds the lock.

    Raises:
        OutputError: the lock file cannot be created or opened.
    """
    make_folder(path.parent)
    holder = _acquired(path, waiting is None)
    if waiting is not None and holder is None:
        waiting()
        holder = _acquired(path)
    assert holder is not None
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        holder.release()


def drop_stale(path: Path) -> None:
    """Remove a lock file that a killed process left. Raises OutputError if the file cannot be opened or removed."""
    if os.path.lexists(path) and (holder := _acquired(path, blocking=False)):
        path.unlink(missing_ok=True)
        holder.release()


def _acquired(path: Path, blocking: bool = True) -> BaseFileLock | None:
    """Return the held lock of a file. Without `blocking`, return None if another process holds the lock."""
    holder = FileLock(path)
    try:
        holder.acquire(blocking=blocking)
    except Timeout:
        return None
    except OSError as error:
        remedy = "remove the file or choose another place for the output"
        raise OutputError(f"{path}: this lock file cannot be used ({error.strerror}); {remedy}") from error
    return holder


def sweep(folder: Path) -> None:
    """Remove the unfinished files and folders of this machine's dead processes. Processes of other machines cannot be seen."""
    for path in sorted(folder.glob(f".*{TEMPORARY}")):
        if match := _UNFINISHED.fullmatch(path.name):
            host, process = match.groups()
            if host in (None, socket.gethostname()) and not alive(int(process)):
                remove(path)


def remove(path: Path) -> None:
    """Remove a file, a link or a whole folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # a process of another user
        return True
    return True
