"""Files that survive a kill: whole or absent. Temporary name beside the target, fsync, rename; and a lock between
processes.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from radartwin.errors import OutputError

TEMPORARY = ".tmp"  # suffix of everything unfinished, so that a start can sweep what a killed one left
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


def write_atomically(path: Path, content: bytes | str) -> Path:
    """Write the file whole or not at all.

    Raises:
        OutputError: the folder cannot be made or written; nothing is left behind.
    """
    make_folder(path.parent)
    temporary = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY}")
    try:
        with temporary.open("wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot write ({error.strerror}); free some space or choose another folder") from error
    finally:
        temporary.unlink(missing_ok=True)
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
    """
    while True:
        make_folder(path.parent)
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except FileNotFoundError:  # the folder went away between the two lines above
            continue
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
    """Remove a lock file that a killed process left; one that is held, or waited for, stays."""
    with contextlib.suppress(FileNotFoundError):
        descriptor = os.open(path, os.O_RDWR)
        try:
            if _try_lock(descriptor) and _leads_to(path, descriptor):
                path.unlink(missing_ok=True)
        finally:
            os.close(descriptor)


def held(path: Path) -> bool:
    """Whether a living process holds the lock."""
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        return not _try_lock(descriptor)
    finally:
        os.close(descriptor)


def sweep(root: Path, deep: bool = True) -> None:
    """Remove from `root` (and below, if deep) what killed processes left: NAME.tmp/ nobody holds, .NAME.PID.tmp of no
    process.

    Anything else that ends in .tmp is not ours and stays.
    """
    for path in sorted(root.glob(f"{'**/' if deep else ''}*{TEMPORARY}")):
        if path.is_dir():
            with contextlib.suppress(OSError):
                path.rmdir()  # killed before it held its lock
            if (path / LOCK).exists() and not held(path / LOCK):
                shutil.rmtree(path, ignore_errors=True)
        elif path.name.startswith(".") and _writer_is_gone(path):
            path.unlink(missing_ok=True)


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


def _writer_is_gone(path: Path) -> bool:
    number = path.name.removesuffix(TEMPORARY).rpartition(".")[2]
    if not number.isdigit():
        return False
    try:
        os.kill(int(number), 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False
