"""Compute many paths with one compiled function: on all processor cores, or on the GPU if the Mitsuba variant is `cuda`.

The GPU needs the packages of the extra `gpu`. Without them, the processor computes the paths.

The compiled function has the arguments (begin, stop, step, *arguments, *results, work). It computes every `step`-th item from `begin` to
`stop` - 1. On the processor, the step is 1. On the GPU, thread i begins at item i, and the step is the number of threads. A thread of a GPU
cannot allocate arrays. `work` therefore holds memory for `step` workers, and the function uses the memory of the worker `begin % step`.
"""

import functools
import importlib.util
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from radartwin.compiled import shared_out
from radartwin.simulation.variant import on_gpu

FEW = 1000  # the processor computes fewer items than this, because copies to the GPU take longer (decision 021)


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
    if not processor and count >= FEW and on_gpu() and installed():
        from radartwin.simulation.flat import gpu  # imports numba.cuda

        gpu.compute(function, count, arguments, results, work)
        return
    shared_out(lambda begin, stop: function(begin, stop, 1, *arguments, *results, work(1)), count, pieces=pieces, grain=grain)
