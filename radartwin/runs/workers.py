"""Distribute function calls over worker processes. A result must not depend on which worker computed it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from typing import Any

from radartwin.compiled import cores, sharers
from radartwin.errors import CrashError
from radartwin.io import memory
from radartwin.io.process_pool import BrokenProcessPool, ProcessPool, finished, in_worker
from radartwin.store import products

BYTES_PER_WORKER = 8e9  # memory in bytes that one worker needs to simulate the room `atrium`
IDLE_BYTES = 2e9  # memory in bytes that a worker may keep between two tasks
FEWEST_ITEMS = 4  # with fewer items, starting a second worker process takes longer than it saves

_pool: ProcessPool | None = None
_reusing = False


def worker_count(jobs: int, items: int) -> int:
    """Return the number of workers for `items` function calls, of which each worker gets two; 1: the calling process does the work itself.

    jobs: configured number of workers; 0 means as many as processor cores and memory allow.
    """
    if items < FEWEST_ITEMS or in_worker():
        return 1
    idle_bytes = sum(memory.resident_bytes(pid) for pid in _pool.pids) if _pool else 0.0
    fit = max(1, int((memory.free_bytes() / sharers() + idle_bytes) / BYTES_PER_WORKER))
    return min(jobs or min(cores(), fit), -(-items // 2))


@contextlib.contextmanager
def reused() -> Iterator[None]:
    """Within the `with` block, keep the worker processes alive between tasks."""
    global _reusing
    before, _reusing = _reusing, True
    try:
        yield
    finally:
        _reusing = before
        if not before:
            _end_pool()


def each(function: Callable[..., Any], items: Sequence[tuple[Any, ...]], jobs: int, done: Callable[[], None] = lambda: None) -> list[Any]:
    """Return [function(*item) for item in items]. Worker processes compute the calls if there are enough items.

    Args:
        function: a function defined in a module; its arguments and its result can be pickled.
        items: one tuple of arguments per function call.
        jobs: configured number of workers, see `worker_count`.
        done: function that is called after each finished item.
    Raises:
        UserError, CrashError: for the same reasons as in the function `run`.
    """
    count = worker_count(jobs, len(items))
    by_number: dict[int, Any] = {}
    calls = ((function, number, item) for number, item in enumerate(items))

    def on_result(numbered: tuple[int, Any]) -> None:
        number, by_number[number] = numbered
        done()

    if count == 1:
        for call in calls:
            on_result(_numbered(*call))
    else:
        run(_numbered, lambda _: next(calls, None), on_result, count)
    return [by_number[number] for number in range(len(items))]


def _numbered(function: Callable[..., Any], number: int, item: tuple[Any, ...]) -> tuple[int, Any]:
    return number, function(*item)


def run(
    function: Callable[..., Any],
    next_call: Callable[[int], tuple[Any, ...] | None],
    on_result: Callable[[Any], object],
    count: int,
    fresh: bool = False,
) -> None:
    """Call a function of a module, with pickled arguments, in `count` worker processes until `next_call` returns None for all.

    Args:
        next_call: gets a worker's number (0 to count - 1) and returns the arguments of its next call, or None for no further call.
        on_result: is called with each returned value, in the order in which the calls finish.
        fresh: True starts new workers, for measurements of run time, because earlier work in a worker makes later work faster.
    Raises:
        UserError: raised by the function.
        CrashError: a worker died or ran out of memory. Any other error is a programming error and carries the worker's traceback.
    """
    pool = _pool_of(count, fresh)

    def start(worker: int) -> Future[Any] | None:
        arguments = next_call(worker)
        return None if arguments is None else pool.submit(_counted, function, arguments)

    try:
        for _, call in finished(start, count):
            value, counts = call.result()
            products.count(counts)
            on_result(value)
        if not _reusing or any(memory.resident_bytes(pid) > IDLE_BYTES for pid in pool.pids):
            _end_pool()
    except BaseException as error:
        _end_pool()
        if isinstance(error, BrokenProcessPool):
            raise _failed("ended unexpectedly, perhaps because memory ran out") from None
        if isinstance(error, MemoryError):
            raise _failed(f"ran out of memory ({str(error) or 'no details'})") from None
        raise


def _failed(reason: str) -> CrashError:
    return CrashError(
        f"a worker process {reason}. Finished recordings and tables are kept, and the same command computes the rest; "
        "jobs=1 needs the least memory"
    )


def _counted(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, products.Counts]:
    """Return the value of the function call, and how many stored results the call computed and how many it reused."""
    with products.counting() as counts:
        value = function(*arguments)
    if memory.resident_bytes(os.getpid()) > IDLE_BYTES:
        memory.give_back()
    return value, counts


def _pool_of(count: int, fresh: bool) -> ProcessPool:
    """Return the idle worker pool if it is large enough and none of its workers has died; otherwise return a new pool."""
    global _pool
    if _pool is not None:
        try:
            _pool.submit(os.getpid).result()
            died = False
        except BrokenProcessPool:
            died = True
        if died or fresh or _pool.size < count:
            _end_pool()
    if _pool is None:
        _pool = ProcessPool(count)
    return _pool


def _end_pool() -> None:
    global _pool
    if _pool is not None:
        pool, _pool = _pool, None
        pool.end()
