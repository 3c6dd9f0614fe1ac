"""A pool of worker processes that end when their parent process ends. The pool is built on concurrent.futures
(docs/decisions/011-worker-pool.md).
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from multiprocessing.util import Finalize
from typing import Any

from threadpoolctl import threadpool_limits

from radartwin.compiled import share_cores, sharers
from radartwin.io.one_line import show_warning

__all__ = ["BrokenProcessPool", "ProcessPool", "finished", "in_worker"]

ENDS_WITHIN_S = 5.0  # time that a worker has to remove its temporary files
_in_worker = False
_crowded = False  # whether several workers share the processor cores
_busy: Any = None  # in a worker, the number of workers of its pool that compute a call


class ProcessPool:
    """Run calls in up to `size` worker processes. If one dies, unfinished calls and the next `submit` raise BrokenProcessPool.

    Args:
        prepare: function that each worker calls when it starts.
        import_main: whether workers import the script of the user, which must then have `if __name__ == "__main__"`.
        beside: number of pools that compute at the same time and share the processor cores.
        nested: whether calls may start worker processes of their own.
    """

    def __init__(
        self, size: int, prepare: Callable[[], object] | None = None, import_main: bool = True, beside: int = 1, nested: bool = False
    ) -> None:
        self.size, self._import_main = size, import_main
        context = multiprocessing.get_context("spawn")
        self._executor = ProcessPoolExecutor(size, context, _start, (context.Value("i", 0), size, beside * sharers(), nested, prepare))

    @property
    def pids(self) -> set[int]:
        """Return the ids of the worker processes."""
        return set(self._executor._processes or ())

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Call a module-level function in a worker. The arguments, the return value and exceptions are pickled."""
        with contextlib.nullcontext() if self._import_main else _without_main():
            return self._executor.submit(_call, function, arguments)

    def end(self) -> None:
        """End all worker processes. A worker that is still in compiled code after ENDS_WITHIN_S is killed."""
        processes = list((self._executor._processes or {}).values())  # Python 3.14 has terminate_workers instead
        for process in processes:
            process.terminate()
        end = time.monotonic() + ENDS_WITHIN_S
        for process in processes:
            if not connection.wait([process.sentinel], max(0.0, end - time.monotonic())):
                process.kill()
        self._executor.shutdown(cancel_futures=True)


def finished(start: Callable[[int], Future[Any] | None], slots: int) -> Iterator[tuple[int, Future[Any]]]:
    """Yield (slot, call) as calls finish. `start(slot)` submits the next call of a slot, 0 to `slots` - 1, or returns None without one."""
    running: dict[Future[Any], int] = {}
    free = list(range(slots))
    while free or running:
        running |= {call: slot for slot in free if (call := start(slot)) is not None}
        free = []
        for call in wait(running, return_when=FIRST_COMPLETED).done if running else ():
            free.append(running.pop(call))
            yield free[-1], call


def in_worker() -> bool:
    return _in_worker


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Hide the file of the main module within the `with` block, because the start method `spawn` would import it in the worker."""
    main = sys.modules["__main__"]
    hidden = {name: vars(main)[name] for name in ("__file__", "__spec__") if name in vars(main)}
    vars(main).update(dict.fromkeys(hidden))
    try:
        yield
    finally:
        vars(main).update(hidden)


def _start(busy: Any, size: int, others: int, nested: bool, prepare: Callable[[], object] | None) -> None:
    global _in_worker, _busy, _crowded
    _in_worker, _busy, _crowded = not nested, busy, size * others > 1
    share_cores(lambda: busy.value * others)
    warnings.showwarning = show_warning
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a worker ignores Ctrl-C, because the parent process ends its workers
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    # While a worker exits, SIGTERM ends the worker at once; SystemExit inside an exit function would print a traceback.
    Finalize(None, signal.signal, (signal.SIGTERM, signal.SIG_DFL), exitpriority=0)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if prepare is not None:
        prepare()


def _end_with_parent() -> None:
    """Wait until the parent process dies, then end this worker process."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(ENDS_WITHIN_S)
    os._exit(1)


def _call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    try:
        with _busy.get_lock():
            _busy.value += 1
        # on busy cores, threads of BLAS wait for each other: a product of 10,000 numbers took 11 ms
        with threadpool_limits(1, "blas") if _crowded else contextlib.nullcontext():
            return function(*arguments)
    except SystemExit:  # raised on SIGTERM; the executor would treat it as an error of the call and continue
        os._exit(1)
    finally:
        with _busy.get_lock():
            _busy.value -= 1
