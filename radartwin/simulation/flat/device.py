"""Compute many paths with one compiled function: on all processor cores, or on the GPU if the Mitsuba variant is `cuda`.

The GPU needs the packages of the extra `gpu`. Without them, the processor computes the paths. No other module of the library imports
`numba.cuda`, and this module imports it only to use the GPU.

The compiled function has the arguments (begin, stop, step, *arguments, *results, work). It computes every `step`-th item from `begin` to
`stop` - 1. On the processor, the step is 1. On the GPU, thread i begins at item i, and the step is the number of threads. `work` holds the
memory of `step` workers, of which the function uses worker `begin % step`, because a thread of a GPU cannot allocate arrays.
"""

import functools
import importlib.util
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from radartwin.compiled import shared_out
from radartwin.simulation.variant import on_gpu

# No GPU was available to measure the best values of these numbers.
FEW = 1000  # the processor computes fewer items than this, because they take about as long as the copies to the GPU
BLOCK = 64  # threads of a block; a thread needs up to 255 registers
WORKERS = 32_768  # largest number of threads, which limits their memory
KEPT = 64  # largest number of tuples of arrays that stay on the GPU
_turn = threading.Lock()  # threads of one process use the GPU one after another


@functools.cache
def installed() -> bool:
    """Return whether the packages of the extra `gpu` are installed."""
    return importlib.util.find_spec("numba_cuda") is not None


def compute(
    function: Any, count: int, arguments: Sequence[Any], results: Sequence[np.ndarray], work: Callable[[int], Any], pieces: int = 4,
    grain: int = 1, processor: bool = False,
) -> None:  # fmt: skip
    """Call a compiled function for the items 0 to `count` - 1, in parallel.

    Args:
        arguments: numbers, arrays and tuples of arrays, which the function only reads. The copies of tuples stay on the GPU for later
            calls with the same tuple, so that their arrays must not change.
        results: contiguous arrays that the function writes.
        work: returns the memory of a number of workers, a named tuple of arrays whose first axis is the worker.
        pieces, grain: parts on the processor, as in `radartwin.compiled.shared_out`.
        processor: whether to use the processor in any case.
    """
    if processor or count < FEW or not on_gpu() or not installed():
        shared_out(lambda begin, stop: function(begin, stop, 1, *arguments, *results, work(1)), count, pieces=pieces, grain=grain)
        return
    blocks = -(-min(count, WORKERS) // BLOCK)
    with _turn:
        copies = [_kept(_Same(value)) if isinstance(value, tuple) else _copied(value) for value in arguments]
        written = [_copied(values) for values in results]
        _kernel(function)[blocks, BLOCK](count, (*copies, *written, _copied(work(blocks * BLOCK))))
        for values, copy in zip(results, written, strict=True):
            copy.copy_to_host(values)


def kernel_of(function: Any) -> Callable[[int, tuple], None]:
    """Return the kernel that calls a compiled function in each thread of a GPU, not yet compiled.

    The kernel has the arguments (count, (*arguments, *results, work)).
    """
    from numba import cuda

    def kernel(count: int, arguments: tuple) -> None:
        function(cuda.grid(1), count, cuda.gridsize(1), *arguments)  # pyright: ignore[reportCallIssue]

    return kernel


@functools.cache
def _kernel(function: Any) -> Any:
    from numba import cuda

    return cuda.jit(kernel_of(function))


class _Same:
    """Hold a tuple as the key of a cache that compares tuples by their identity."""

    def __init__(self, value: tuple) -> None:
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.value is other.value


@functools.lru_cache(KEPT)
def _kept(key: _Same) -> Any:
    return _copied(key.value)


def _copied(value: Any) -> Any:
    """Return a number unchanged, and an array or a nested tuple of arrays as copies on the GPU."""
    from numba import cuda

    if isinstance(value, tuple):
        parts = [_copied(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return cuda.to_device(np.ascontiguousarray(value)) if isinstance(value, np.ndarray) else value
