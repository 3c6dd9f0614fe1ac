"""Recordings made by several processes at once. Each goes on with what shares a track with its last, then takes over from the others.

What is made does not depend on who makes it, or after what: the store holds the same bytes after any number of processes, kills included.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import traceback
from collections import defaultdict
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from experiments.campaigns.cases import ROVER, Case
from radartwin.compiled import cores
from radartwin.config import Config
from radartwin.errors import BackendError, UserError

MEMORY = 8e9  # bytes of one process, along the atrium
LEAST = 4  # recordings below which a second process is not worth its start
PIECE = 12  # recordings given out at a time
Wanted = tuple[str, Case]
Track = tuple[str, str, str]  # domain, room, motion


def hands(jobs: int, recordings: int) -> int:
    """Processes for so many recordings: `jobs`, or with 0 as many as there are cores and memory for; 1 is this process itself."""
    if recordings < LEAST:
        return 1
    return min(jobs or min(cores(), max(1, int(_free_bytes() / MEMORY))), -(-recordings // 2))


def make(config: Config, wanted: Sequence[Wanted], count: int, made: Callable[[], object]) -> None:
    """Make recordings and what features are read from, in `count` processes.

    Args:
        config: of the campaign; its output folder holds the store.
        made: called after each recording.
    Raises:
        UserError: what one of the processes was refused; BackendError: one of them ended or ran out of memory; RuntimeError: a defect, with
            its traceback.
    """
    left: dict[Track, list[Wanted]] = defaultdict(list)
    for domain, case in wanted:
        left[_track(domain, case)].append((domain, case))
    context = multiprocessing.get_context("spawn")
    crew: dict[Connection, tuple[Any, Track | None]] = {}
    try:
        for _ in range(count):
            here, there = context.Pipe()
            process = context.Process(target=_work, args=(there, config), daemon=True)
            process.start()
            there.close()
            crew[here] = (process, None)
            _give(here, crew, left)
        while crew:
            for one in wait(list(crew)):
                assert isinstance(one, Connection)
                _heard(one, crew, left, made)
    finally:
        for process, _ in crew.values():
            process.terminate()


def _track(domain: str, case: Case) -> Track:
    """What shares a track."""
    return domain, case.room, case.motion if case.motion in ROVER else "bench"


def _give(to: Connection, crew: dict[Connection, tuple[Any, Track | None]], left: dict[Track, list[Wanted]]) -> None:
    """The next piece of its own track, else of one that nobody is on; or the end.

    A twin's room is scanned by the first who needs it, and the others wait: so scans come first, each for one process, and what there is
    most of.
    """
    process, last = crew[to]
    taken = [track for connection, (_, track) in crew.items() if track and connection is not to]
    tracks = [track for track, some in left.items() if some]
    if not tracks:
        to.send(None)
        process.join()
        del crew[to]
        return

    def after(track: Track) -> tuple[bool, bool, bool, bool, int]:
        scanned = track[0] == "twin"
        waits = scanned and any(track[:2] == other[:2] for other in taken)
        return track != last, track in taken, waits, not scanned, -len(left[track])

    track = min(tracks, key=after)
    piece, left[track] = left[track][:PIECE], left[track][PIECE:]
    crew[to] = (process, track)
    to.send(piece)


def _heard(
    one: Connection, crew: dict[Connection, tuple[Any, Track | None]], left: dict[Track, list[Wanted]], made: Callable[[], object]
) -> None:
    try:
        kind, *told = one.recv()
    except (EOFError, OSError):
        process = crew[one][0]
        process.join()
        raise _short_of_memory(f"ended (exit status {process.exitcode}), perhaps for want of memory") from None
    if kind == "made":
        made()
    elif kind == "refused":
        raise told[0]
    elif kind == "failed":
        raise RuntimeError(f"a process of the campaign failed:\n{told[0]}")
    elif kind == "short":
        raise _short_of_memory(f"ran out of memory ({told[0]})")
    else:
        _give(one, crew, left)


def _short_of_memory(what: str) -> BackendError:
    return BackendError(
        f"campaign: a process that made recordings {what}. "
        "What is finished is kept and the same command makes the rest; jobs=1 needs least memory"
    )


def _work(parent: Connection, config: Config) -> None:
    """A process of the crew: until there is nothing more, or nobody to make it for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    from pathlib import Path

    from experiments.campaigns.campaign import Campaign
    from radartwin.progress import Progress
    from radartwin.store import Store

    def tell(*message: Any) -> None:
        try:
            parent.send(message)
        except (BrokenPipeError, ConnectionResetError):
            raise SystemExit from None  # nobody to make it for

    try:
        campaign = Campaign(config, Store(Path(config.output) / "cache"), Progress(quiet=True))
        while (piece := _next(parent)) is not None:
            for domain, case in piece:
                campaign.process(domain, case)
                tell("made")
            tell("idle")
    except UserError as refused:
        tell("refused", refused)
    except MemoryError as short:
        tell("short", str(short) or "no more is to be had")
    except Exception:
        tell("failed", traceback.format_exc())


def _next(parent: Connection) -> list[Wanted] | None:
    """What is to be made now; None at the end, also where there is no parent any more."""
    try:
        return parent.recv()
    except (EOFError, ConnectionResetError):
        return None


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
