"""Run Sionna RT in a worker process, because it needs another Mitsuba variant than the tracer, and a process can have only one."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from radartwin.errors import BackendError
from radartwin.io.process_pool import BrokenProcessPool, ProcessPool
from radartwin.simulation.backends import sionna_worker

_pools: dict[int, ProcessPool] = {}  # by the id of the process that started the pool, because a fork must not use its parent's worker


def ask(message: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Call `sionna_worker.answer` in the worker of this process. The worker starts on first use, and again after it has died.

    Raises:
        BackendError: the worker refused the message, or died.
    """
    pool = _pools.get(os.getpid()) or ProcessPool(1, _print_to_stderr, import_main=False)
    _pools[os.getpid()] = pool
    try:
        return pool.submit(sionna_worker.answer, dict(message)).result()
    except BrokenProcessPool:
        close()
        raise BackendError("simulator sionna: its process died, perhaps because memory ran out; run the same command again") from None
    except (BackendError, MemoryError) as error:
        raise BackendError(f"simulator sionna: {error}") from error


def process_ids() -> list[int]:
    """Return the worker's process id; an empty list before its first answer."""
    return sorted(_pools[os.getpid()].pids) if os.getpid() in _pools else []


def close() -> None:
    """Stop the worker."""
    if pool := _pools.pop(os.getpid(), None):
        pool.end()


def _print_to_stderr() -> None:
    """Redirect output to standard error, because standard output is for the results of radartwin."""
    os.dup2(2, 1)
