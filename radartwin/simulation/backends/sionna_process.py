"""Run Sionna RT in a worker process.

Sionna RT needs a different Mitsuba variant than the package's own tracer, and a process can have only one Mitsuba variant.
"""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from radartwin.errors import BackendError
from radartwin.io.process_pool import BrokenProcessPool, ProcessPool
from radartwin.simulation.backends import sionna_worker

# Worker pools by the id of the process that started them, because a forked process must not use the worker of its parent process.
_pools: dict[int, ProcessPool] = {}


def ask(message: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Call `sionna_worker.answer` in the worker process and return its result.

    The first call starts the worker process. If the worker process has died, the next call starts a new one.

    Raises:
        BackendError: the worker refused the message, or the worker process died.
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
    """Return a list with the process id of the worker; the list is empty before the worker has handled its first message."""
    return sorted(_pools[os.getpid()].pids) if os.getpid() in _pools else []


def close() -> None:
    """Stop the worker process of Sionna RT."""
    if pool := _pools.pop(os.getpid(), None):
        pool.end()


def _print_to_stderr() -> None:
    """Redirect the worker's standard output to standard error, because the standard output is reserved for the results of radartwin."""
    os.dup2(2, 1)
