"""Compile functions with Numba, and run compiled functions on all processor cores.

Numba caches the machine code in the folder of the source file. If the folder of the source file is read-only, Numba caches the machine code
in the user's cache folder. If both folders are read-only, the machine code stays in memory only. While a process compiles a function, other
processes that need the function wait for a lock file next to the machine code, and then read it from the cache.

Machine code contains the functions that it calls and the constants that it reads, also those of other files. Numba compiles a function
again if the function's own file changes. With this module, Numba also compiles the function again if a file changes that the function's
file imports (`_sources`).
"""

import functools
import gc
import hashlib
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from filelock import FileLock
from numba import njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock

from radartwin import source_files

T = TypeVar("T")
R = TypeVar("R")
PARTS = numba.__version__.startswith("0.68.")  # `_Part` replaces internal methods of Numba, which other versions may not have


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function to machine code that releases Python's global interpreter lock, and keep the machine code in Numba's cache.

    The machine code does not fuse a multiplication and an addition into one instruction. With fused instructions, newly compiled code and
    code from the cache gave results that differed in the last bits, and the code was not faster.
    """
    return _cached(function)


def _cached(function: Callable[..., Any], **options: Any) -> Any:
    source = function.__code__.co_filename
    try:
        dispatcher = _jit(function, cache=Path(source).is_file(), **options)  # the cell of a notebook has no file
    except RuntimeError:  # no folder for the cache can be written
        return _jit(function, **options)
    if not Path(source).is_file():
        return dispatcher
    file = dispatcher._cache._cache_file
    file._source_stamp = (file._source_stamp, _sources(function.__module__, source))
    compile_or_load = dispatcher.compile
    lock = FileLock(Path(dispatcher.stats.cache_path) / f"{function.__module__}.{function.__qualname__}.lock")

    def compile_once(signature: Any) -> Any:
        # A thread waits for the file lock only while it holds Numba's own lock, so that two threads cannot wait for each other.
        with global_compiler_lock, ExitStack() as held:
            # The lock only saves time. Where a file system has no locks, two processes compile the same function.
            with suppress(OSError, NotImplementedError):
                held.enter_context(lock)
            if gc.isenabled():  # otherwise Python would search for garbage for a sixth of the time
                gc.disable()
                held.callback(gc.enable)
            return compile_or_load(signature)

    dispatcher.compile = compile_once
    return dispatcher


def inner(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that only compiled functions call. Its machine code is part of theirs, and it has none of its own.

    Numba would compile another version for each literal argument. A call from Python compiles the function once more, as a whole.
    With a version of Numba other than that of PARTS, the function has machine code of its own, which takes twice as long to compile.
    """
    if not PARTS:
        return _cached(function, **options)
    dispatcher = _jit(function, _PartCompiler, no_cpython_wrapper=True, **options)
    whole = functools.cache(lambda: _jit(function, **options))
    compile_part = dispatcher.compile
    dispatcher.compile = lambda arguments: compile_part(tuple(types.unliteral(each) for each in arguments))
    dispatcher._insert = lambda *_, **__: None
    dispatcher._compile_for_args = lambda *_, **__: whole()  # what this returns, Numba calls with the same arguments
    return dispatcher


def innermost(function: Callable[..., Any]) -> Any:
    """Compile a small `inner` function that compiled loops call millions of times. The function must not create or return arrays.

    The compiled function does not count references to its arrays. Counting references would take as long as ten divisions per call, because
    the counter is atomic, and longer if several threads use the same array.
    """
    return inner(function, _nrt=False)


def vectorised(function: Callable[..., Any]) -> Any:
    """Compile an `inner` function with loops that the processor can vectorise, so that it computes several iterations at a time.

    A division by zero gives infinity or NaN, as in NumPy, because a check of each divisor would end the loop early. The function must not
    create or return arrays.
    """
    return inner(function, error_model="numpy", _nrt=False)


def _jit(function: Callable[..., Any], compiler: type[Compiler] | None = None, **options: Any) -> Any:
    if PARTS:
        options |= {"no_cfunc_wrapper": True, "pipeline_class": compiler or _WholeCompiler}
    return njit(nogil=True, **options)(function)


class _Whole(JITCodeLibrary):
    """Machine code of a function that Python calls, with all `inner` functions that it calls. LLVM optimises this code once, as a whole."""

    def _optimize_functions(self, ll_module: Any) -> None: ...


class _Part(_Whole):
    """Intermediate code of an `inner` function and of those that it calls. If LLVM optimised this code too, it would optimise a function
    once more for each function between Python and it. That took a quarter of the time of all compilations.
    """

    codegen = property(lambda self: self)

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0

    def set_env(self, name: str, environment: object) -> None: ...


class _WholeCompiler(Compiler):
    library: type[JITCodeLibrary] = _Whole

    def define_pipelines(self) -> Any:
        self.state.library = self.library(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class _PartCompiler(_WholeCompiler):
    library = _Part


@functools.cache
def _sources(module: str, file: str) -> str:
    """Return the digest of the source code whose functions or constants the machine code of a module can contain: of the module, of the
    modules that it imports, and, if one of these has compiled functions, of the modules that it imports. Unlike the digest of stored
    results, this digest includes comments, because a syntax tree would take 100 times as long as the text. The source of a module outside
    RadarTwin is `file`, which Numba watches itself.
    """
    entries = (module,)
    if source_files.source(module) is None:
        entries = tuple(sorted(source_files.imports_of(Path(file).read_text(encoding="utf-8"), module.rpartition(".")[0])))
    texts = (f"{name}\n{source_files.text(name)}" for name in sorted(source_files.closure(entries, _has_kernels)))
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def _has_kernels(module: str) -> bool:
    return "radartwin.compiled" in source_files.text(module)


def fixed(values: np.ndarray) -> np.ndarray:
    """Return a contiguous, read-only view or copy of an array. Numba then compiles only one version of each function that takes it."""
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def _alone() -> int:
    return 1


_sharing = _alone


def share_cores(busy: Callable[[], int]) -> None:
    """Make `cores` divide the processor cores equally among the `busy()` processes that compute at the same time."""
    global _sharing
    _sharing = busy


def sharers() -> int:
    """Return the number of processes that share the processor cores now."""
    return max(1, _sharing())


def cores() -> int:
    """Return the number of processor cores that this process should use now.

    With more threads than cores, the threads wait for each other: two drives that two processes simulated at the same time on two cores
    took 18 to 35 % longer with two threads per process than with one.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, allowed // sharers())


def shared_out(function: Callable[..., Any], count: int, *arguments: Any, pieces: int = 4, grain: int = 1) -> None:
    """Split the range 0..count into at most `pieces` parts per core, and call function(first, last, *arguments) for each part, on all
    cores.

    The parts run in Python threads, because Numba's own thread pools do not survive a fork and cannot be nested. Two parts must not write
    to the same memory, so that the result does not depend on the number of cores. A part has at least `grain` items, because handing a part
    to a thread takes about 0.05 ms.
    """
    workers = min(cores(), -(-count // grain))
    if workers <= 1:
        function(0, count, *arguments)
        return
    parts = min(-(-count // grain), pieces * workers)
    bounds = [count * i // parts for i in range(parts + 1)]
    for _ in _mapped(lambda i: function(bounds[i], bounds[i + 1], *arguments), range(parts)):
        pass


def each(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """Return function(item) of each item, in order, computed on all cores in Python threads.

    Threads save time only where the function spends its time in compiled code, which releases Python's global lock.
    """
    waiting = list(items)
    if min(cores(), len(waiting)) <= 1:
        return [function(item) for item in waiting]
    return list(_mapped(function, waiting))


def fitted(function: Callable[[int], R | None], rows: int) -> R:
    """Return the result of a function that has memory for `rows` rows. If that is too short, the function returns None, and is called again
    with four times as much.
    """
    while (result := function(rows)) is None:
        rows *= 4
    return result


def gathered(function: Callable[[int, int, int], Sequence[np.ndarray] | None], count: int, rows: int) -> list[np.ndarray]:
    """Return the arrays that function(first, last, rows) returns for all parts of the range 0..count, joined in the order of the parts.
    `rows` is the memory as in `fitted`.
    """
    parts: list[tuple[int, Sequence[np.ndarray]]] = []
    shared_out(lambda first, last: parts.append((first, fitted(lambda rows: function(first, last, rows), rows))), count)
    return [np.concatenate(column) for column in zip(*(arrays for _, arrays in sorted(parts, key=lambda part: part[0])), strict=True)]


class _Threads(threading.local):
    """Tell whether calls from the current thread get new threads, as in the threads of the pool of this process."""

    pooled = False


_threads = _Threads()


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Return a pool of threads of this process, which wait between two calls. A forked process makes its own pool."""
    return ThreadPoolExecutor(threads, initializer=own_threads)


def own_threads() -> None:
    """Give all later calls from the current thread new threads, so that they do not wait for calls from other threads."""
    _threads.pooled = True


os.register_at_fork(after_in_child=_pool.cache_clear)


def _mapped(function: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
    """Yield function(item) of each item, in order. A call from a thread of the pool gets new threads, because the call would otherwise wait
    for its own thread.
    """
    if not _threads.pooled:
        yield from _pool(cores()).map(function, items)
        return
    with ThreadPoolExecutor(min(cores(), len(items)), initializer=own_threads) as pool:
        yield from pool.map(function, items)
