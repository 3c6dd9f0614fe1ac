"""Pieces of work made by several processes at once, which end with whoever started them.

What a process makes must not depend on which it is, or on what it made before; what it takes may. Within `kept` processes outlive the work
that they were started for, and the next finds them with everything imported and compiled.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Hashable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from radartwin.compiled import cores
from radartwin.errors import BackendError, UserError
from radartwin.io import memory

MEMORY = 8e9  # bytes of one process, along the atrium
LIGHT = 2e9  # bytes that a process may hold while it waits for more
LEAST = 4  # pieces below which a second process is not worth its start
ENDS_WITHIN_S = 5.0
Tell = Callable[[Any], None]
Started = tuple[Connection, Any]

_idle: list[Started] = []
_keeping = False


def hands(jobs: int, pieces: int) -> int:
    """Processes for so many pieces: `jobs`, or with 0 as many as there are cores and memory for, but no more than have two pieces each.
    1 is this process itself."""
    if pieces < LEAST or multiprocessing.current_process().daemon:
        return 1
    fit = max(1, int((_free_bytes() + sum(_held_bytes(process.pid) for _, process in _idle)) / MEMORY))
    return min(jobs or min(cores(), fit), -(-pieces // 2))


@contextlib.contextmanager
def kept() -> Iterator[None]:
    """Processes that are started meanwhile go on to the next work, and end with this."""
    global _keeping
    before, _keeping = _keeping, True
    try:
        yield
    finally:
        _keeping = before
        if not before:
            _end_idle()


def each(function: Callable[..., Any], items: Sequence[tuple[Any, ...]], jobs: int, done: Callable[[], None] = lambda: None) -> list[Any]:
    """[function(*item) for item in items], by several processes where it pays.

    Args:
        function: of a module. What it takes and gives can be pickled; UserErrors and defects are raised here.
        jobs: as of the configuration. done: called after each item.
    """
    count, found = hands(jobs, len(items)), {}
    if count == 1:
        for number, item in enumerate(items):
            found[number] = function(*item)
            done()
    else:
        left = iter(enumerate(items))

        def heard(answer: tuple[int, Any]) -> None:
            found[answer[0]] = answer[1]
            done()

        def give(_: Hashable) -> Any:
            piece = next(left, None)
            return None if piece is None else (function, *piece)

        run(_answer, give, heard, count)
    return [found[number] for number in range(len(items))]


def _answer(piece: tuple[Callable[..., Any], int, tuple[Any, ...]], tell: Tell) -> None:
    function, number, item = piece
    tell((number, function(*item)))


def run(
    function: Callable[[Any, Tell], None],
    give: Callable[[Hashable], Any],
    heard: Callable[[Any], object],
    count: int,
    fresh: bool = False,
) -> None:
    """Have `count` processes run function(piece, tell) until there are no pieces.

    Args:
        give: the next piece for a process, None at the end. heard: what a process told.
        fresh: in new processes, for work whose cost is told: what was made before must not make it cheaper.
    Raises:
        UserError: what one of the processes was refused; BackendError: one of them ended or ran out of memory; RuntimeError: a defect, with
            its traceback.
    """
    if fresh:
        _end_idle()
    working: dict[Connection, Any] = {}
    free: list[Started] = []

    def next_of(one: Connection) -> None:
        piece = give(one)
        if piece is None:
            free.append((one, working.pop(one)))
        else:
            _send(one, working[one], (function, piece))

    try:
        while len(working) < count:
            here, process = _hired()
            working[here] = process
        for one in list(working):
            next_of(one)
        while working:
            for one in wait(list(working)):
                assert isinstance(one, Connection)
                if _heard(one, working[one], heard):
                    next_of(one)
    except BaseException:
        _end([*working.items(), *free])
        raise
    _rest(free)


def _rest(free: Sequence[Started]) -> None:
    """Processes that have done their work wait for more where they are kept and hold little."""
    light = []
    if _keeping:
        for here, process in free:
            with contextlib.suppress(BackendError):  # who ends here has done what it was to do
                _send(here, process, (_gave_back, None))
                _heard(here, process, lambda _: None)
                if _held_bytes(process.pid) < LIGHT:
                    light.append((here, process))
    _idle.extend(light)
    _end([one for one in free if one not in light])


def _gave_back(*_: object) -> None:
    memory.give_back()


def _hired() -> Started:
    """One that waits, unless it has died meanwhile, or a new one."""
    while _idle:
        one = _idle.pop()
        if one[1].is_alive() and not one[0].poll():  # it says nothing unasked: what can be read is its end
            return one
        _end([one])
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_work, args=(there,), daemon=True)
    process.start()
    there.close()
    return here, process


def _end_idle() -> None:
    _end(_idle)
    _idle.clear()


def _end(some: Sequence[Started]) -> None:
    """End processes: asked first, all at once, then not."""
    for _, process in some:
        process.terminate()
    end = time.monotonic() + ENDS_WITHIN_S
    for here, process in some:
        process.join(max(0.0, end - time.monotonic()))
        process.kill()
        process.join()
        here.close()


def _send(to: Connection, process: Any, message: Any) -> None:
    try:
        to.send(message)
    except (BrokenPipeError, ConnectionResetError):
        raise _ended(process) from None


def _heard(one: Connection, process: Any, heard: Callable[[Any], object]) -> bool:
    """Take in a message; whether it was that a piece is done."""
    try:
        kind, told = one.recv()
    except (EOFError, OSError):
        raise _ended(process) from None
    if kind == "told":
        heard(told)
    elif kind == "refused":
        raise told
    elif kind == "failed":
        what, where = told
        defect = RuntimeError(what)
        defect.add_note(f"in one of the processes at work:\n{where}")
        raise defect
    elif kind == "short":
        raise _short_of_memory(f"ran out of memory ({told})")
    return kind == "done"


def _ended(process: Any) -> BackendError:
    process.join()
    return _short_of_memory(f"ended (exit status {process.exitcode}), perhaps for want of memory")


def _short_of_memory(what: str) -> BackendError:
    return BackendError(
        f"one of the processes at work {what}. "
        "Recordings and tables that are finished are kept and the same command makes the rest; jobs=1 needs least memory"
    )


def _work(parent: Connection) -> None:
    """A process: until there is nothing more, or nobody to work for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and temporary folders go
    threading.Thread(target=_outlive_nobody, daemon=True).start()

    def send(kind: str, told: Any = None) -> None:
        try:
            parent.send((kind, told))
        except (BrokenPipeError, ConnectionResetError):
            raise SystemExit from None

    try:
        while (message := _next(parent)) is not None:
            function, piece = message
            function(piece, lambda told: send("told", told))
            send("done")
    except UserError as refused:
        send("refused", refused)
    except MemoryError as short:
        send("short", str(short) or "no more is to be had")
    except Exception as defect:
        send("failed", (f"{type(defect).__name__}: {defect}", traceback.format_exc()))


def _outlive_nobody() -> None:
    """End with the parent, whatever is being made."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _next(parent: Connection) -> Any:
    """What is to be made now; None where there is no parent any more."""
    try:
        return parent.recv()
    except (EOFError, ConnectionResetError):
        return None


def _held_bytes(pid: int) -> float:
    """Memory of a process, where the system tells; otherwise none."""
    try:
        with open(f"/proc/{pid}/statm", encoding="ascii") as told:
            return float(told.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0.0


def _free_bytes() -> float:
    """Memory that is free or can be freed, where the system tells; otherwise half of all, or enough for one process."""
    try:
        with open("/proc/meminfo", encoding="ascii") as told:
            return next(1024.0 * int(line.split()[1]) for line in told if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        pass
    try:
        return 0.5 * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return MEMORY
