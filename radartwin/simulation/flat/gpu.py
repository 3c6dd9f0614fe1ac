"""Run compiled functions as kernels of numba.cuda. Only `parallel` imports this module, and only to use a GPU.

Numba has compiled each function for the processor. For the GPU, numba.cuda compiles the Python source of the function again. The compiled
kernels are not kept on the disk, because the key of a stored kernel would have to contain the source of all functions that it calls.
"""

import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import cuda
from numba.core import config

# Measured on an NVIDIA H200 (docs/decisions/021-what-runs-on-a-gpu.md).
BLOCK = 64  # threads of a block; a thread needs up to 255 registers
WORKERS = 32_768  # largest number of threads, which limits their memory
KEPT = 64  # largest number of tuples of arrays that stay on the GPU
# numba.cuda would warn at each start of a kernel with few threads
config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # pyright: ignore[reportAttributeAccessIssue]
_turn = threading.Lock()  # threads of one process use the GPU one after another


def compute(function: Any, count: int, arguments: Sequence[Any], results: Sequence[np.ndarray], work: Callable[[int], Any]) -> None:
    """Call a compiled function for the items 0 to `count` - 1 on the GPU; the arguments are those of `parallel.compute`."""
    blocks = -(-min(count, WORKERS) // BLOCK)
    with _turn:
        copies = [_kept(_Same(value)) if isinstance(value, tuple) else copied(value) for value in arguments]
        written = [copied(values) for values in results]
        _compiled(function)[blocks, BLOCK](count, (*copies, *written, memory(work(blocks * BLOCK))))
        for values, copy in zip(results, written, strict=True):
            copy.copy_to_host(values)


def kernel(function: Any) -> Callable[[int, tuple], None]:
    """Return the kernel, not yet compiled, that calls a compiled function in each thread of a GPU.

    The kernel has the arguments (count, (*arguments, *results, work)).
    """

    def call(count: int, arguments: tuple) -> None:
        function(cuda.grid(1), count, cuda.gridsize(1), *arguments)  # pyright: ignore[reportCallIssue]

    return call


@functools.cache
def _compiled(function: Any) -> Any:
    return cuda.jit(kernel(function))


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
    return copied(key.value)


def copied(value: Any) -> Any:
    """Return a number unchanged, and an array or a nested tuple of arrays as copies on the GPU."""
    if isinstance(value, tuple):
        parts = [copied(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return cuda.to_device(np.ascontiguousarray(value)) if isinstance(value, np.ndarray) else value


def memory(value: tuple) -> Any:
    """Return a named tuple of arrays on the GPU without values, with the shapes of the processor's arrays `value`."""
    return type(value)(*(cuda.device_array(part.shape, part.dtype) for part in value))
