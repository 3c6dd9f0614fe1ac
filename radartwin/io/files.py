"""Files that survive a kill: whole or absent. Temporary name beside the target, fsync, rename; and a lock between
processes.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import math
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING

from radartwin.errors import InputError, OutputError

if TYPE_CHECKING:
    import numpy as np

TEMPORARY = ".tmp"  # suffix of everything unfinished, so that a start can sweep what a killed one left
_UNFINISHED = re.compile(rf"\..+\.radartwin-(\d{{1,9}}){re.escape(TEMPORARY)}")  # .NAME.radartwin-PID.tmp
LOCK = "lock"  # inside an unfinished folder, held while somebody fills it


def check_folder(folder: Path) -> Path:
    """Refuse a folder that cannot be written or made, without making it: before long work, not after.

    Raises:
        OutputError: naming what is in the way.
    """
    existing = Path(folder).absolute()
    while not existing.exists():
        existing = existing.parent
    if not existing.is_dir():
        raise OutputError(f"{folder}: {existing} is not a folder; choose another place for the output")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: {existing} cannot be written; choose another place for the output")
    return folder


def make_folder(folder: Path) -> Path:
    """Create the folder. Raises OutputError where it cannot be made or written."""
    check_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); choose another place for the output") from error
    return folder


def unfinished(path: Path) -> Path:
    """The name beside `path` under which this process writes it until it is whole."""
    return path.with_name(f".{path.name}.radartwin-{os.getpid()}{TEMPORARY}")


def write_atomically(path: Path, content: bytes | str) -> Path:
    """Write the file whole or not at all.

    Raises:
        OutputError: the folder cannot be made or written; nothing is left behind.
    """
    make_folder(path.parent)
    temporary = unfinished(path)
    try:
        temporary.unlink(missing_ok=True)
        with temporary.open("xb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot write ({error.strerror}); free some space or choose another folder") from error
    finally:
        temporary.unlink(missing_ok=True)
    return path


def read_arrays(source: Path | bytes) -> dict[str, np.ndarray]:
    """The arrays of an .npz by name, none of them unpickled.

    Raises:
        InputError: no such archive; arrays of Python objects, or larger than what is stored of them; one that unpacks to far more than
            it is (ours are stored as they are). OSError: it cannot be read.
    """
    import zipfile
    import zlib

    import numpy as np

    label = "the archive" if isinstance(source, bytes) else str(source)
    try:
        with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as stream:
            _check_archive(stream, label)
            with np.load(stream, allow_pickle=False) as stored:
                return dict(stored)
    except InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, RuntimeError) as error:  # the last for what zipfile cannot unpack
        raise InputError(f"{label} is no archive of arrays ({str(error).splitlines()[0] if str(error) else 'it ends early'})") from error


def read_array(path: Path) -> np.ndarray:
    """The array of a .npy, not unpickled.

    Raises:
        InputError: no such array, one of Python objects, or one that says it is larger than the file. OSError: it cannot be read.
    """
    import numpy as np

    try:
        with path.open("rb") as stream:
            _check_head(stream, path.stat().st_size, str(path))
            stream.seek(0)
            return np.load(stream, allow_pickle=False)
    except InputError:
        raise
    except (ValueError, EOFError) as error:
        raise InputError(f"{path} is not a readable .npy array ({' '.join(str(error).split())})") from error


def _check_archive(stream: IO[bytes], label: str) -> None:
    """Judge an archive by its heads, before memory is taken for what they ask. The stream ends at its beginning."""
    import zipfile

    with zipfile.ZipFile(stream) as archive:
        unpacked, size = sum(member.file_size for member in archive.infolist()), stream.seek(0, os.SEEK_END)
        if unpacked > 16 * size + (64 << 20):
            raise InputError(f"{label} is {size:,} bytes and would unpack to {unpacked:,}; that is no file of arrays that radartwin wrote")
        for member in archive.infolist():
            with archive.open(member) as content:
                _check_head(content, member.file_size, f"{label}, {member.filename},")
    stream.seek(0)


def _check_head(stream: IO[bytes], size: int, label: str) -> None:
    """Refuse an array in the .npy format that is of Python objects, or that `size` bytes do not hold. Raises InputError, ValueError."""
    from numpy.lib import format as npy

    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(npy.read_magic(stream))
    if read is None:
        raise InputError(f"{label} is in a form of .npy that is not read here")
    shape, _, kind = read(stream)
    if kind.hasobject or math.prod(shape) * kind.itemsize > size:
        raise InputError(f"{label} says {shape} of {kind} and is {size:,} bytes")


def inside(folder: Path, name: str) -> Path:
    """FOLDER/NAME of a file that an index in the folder names.

    Raises:
        InputError: it leads out of the folder, by "..", from the root or through a link.
    """
    path = folder / name
    if "\0" in name or not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{folder} names the file {name!r}, which is not in it; copy the file into the folder and name it there")
    return path


def sync(path: Path, deep: bool = True) -> None:
    """Force a file, or a folder (with all it holds, if deep), to the disk."""
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
    """Hold the file `path` as a lock between processes; it exists only while somebody holds it or waits for it.

    The kernel releases the lock of a process that dies. A waiter may wake up holding a file that its last owner
    deleted, so it checks that the name still leads to what it locked.

    Args:
        waiting: called once if somebody else holds the lock.
    Raises:
        OutputError: the file cannot be made or opened.
    """
    while True:
        make_folder(path.parent)
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        except FileNotFoundError:  # the folder went away between the two lines above
            continue
        except OSError as error:
            raise _cannot_lock(path, error) from error
        try:
            if waiting and not _try_lock(descriptor):
                waiting()
                waiting = None
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            if not _leads_to(path, descriptor):
                continue
            try:
                yield
            finally:
                path.unlink(missing_ok=True)
            return
        finally:
            os.close(descriptor)


def drop_stale(path: Path) -> None:
    """Remove a lock file that a killed process left; one that is held, or waited for, stays.

    Raises:
        OutputError: what has its name cannot be opened or removed.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
        try:
            if _try_lock(descriptor) and _leads_to(path, descriptor):
                path.unlink(missing_ok=True)
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        return
    except OSError as error:
        raise _cannot_lock(path, error) from error


def _cannot_lock(path: Path, error: OSError) -> OutputError:
    return OutputError(f"{path}: cannot serve as a lock ({error.strerror}); remove it or choose another place for the output")


def sweep(folder: Path) -> None:
    """Remove from the folder the `unfinished` files of processes that are gone; nothing else is ours."""
    for path in sorted(folder.glob(f".*{TEMPORARY}")):
        if (ours := _UNFINISHED.fullmatch(path.name)) and path.is_file() and not alive(int(ours.group(1))):
            path.unlink(missing_ok=True)


def drop_abandoned(folder: Path) -> None:
    """Remove a folder that is filled under its lock, FOLDER/lock, unless a living process holds or awaits that lock.

    The lock is held while the folder is emptied and goes last: whoever comes in between waits, then starts afresh.
    """
    with contextlib.suppress(OSError):
        folder.rmdir()  # killed before it held its lock
    with contextlib.suppress(OSError):
        descriptor = os.open(folder / LOCK, os.O_RDWR)
        try:
            if not _try_lock(descriptor) or not _leads_to(folder / LOCK, descriptor):
                return
            for child in folder.iterdir():
                if child.is_dir() and not child.is_symlink():
                    shutil.rmtree(child)
                elif child.name != LOCK:
                    child.unlink()
            (folder / LOCK).unlink()
            folder.rmdir()  # fails if somebody has taken the lock anew
        finally:
            os.close(descriptor)


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _leads_to(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def alive(process: int) -> bool:
    """Whether a process of this number runs on this machine."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # somebody else's
        return True
    return True
