"""Compile functions for a GPU on a computer without one, and run this code on the processor.

numba-cuda asks the GPU for its compute capability even if the caller gives a capability. A substitute for the GPU answers.

To run the code, this module changes the LLVM text that numba-cuda makes for NVVM. Pointers lose their types and address spaces. Functions
of the C library replace those of NVIDIA, and counters replace the registers that hold the number of a thread. This does not test what NVVM
and a GPU do with the text.
"""

import ctypes
import importlib
import re
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba import int64, typeof

from radartwin.simulation.flat import gpu

cuda, codegen, dispatcher = (importlib.import_module(f"numba.cuda{name}") for name in ("", ".codegen", ".dispatcher"))

# One block of threads that take turns. `isnand` is not a function of the C library.
THREADS = """
@thread = global i32 0
@threads = global i32 1
define i32 @thread.tid.x() { %n = load i32, ptr @thread
 ret i32 %n }
define i32 @thread.ntid.x() { %n = load i32, ptr @threads
 ret i32 %n }
define i32 @thread.ctaid.x() { ret i32 0 }
define i32 @thread.nctaid.x() { ret i32 1 }
define i32 @isnand(double %x) { %n = fcmp uno double %x, %x
 %i = zext i1 %n to i32
 ret i32 %i }
"""
OPENING = {"}": "{", "]": "[", ")": "("}


def ptx(function: Any, arguments: tuple, capability: tuple[int, int], optimised: bool = True) -> str:
    """Return the kernel of a function in NVIDIA's assembly language."""
    vars(dispatcher)["get_current_device"] = lambda: SimpleNamespace(compute_capability=capability)
    signature = int64, typeof(arguments)
    how = {"device": False, "abi": "numba", "output": "ptx", "opt": optimised}
    return cuda.compile(gpu.kernel(function), signature, cc=capability, **how)[0]


class _Made(Exception):
    """Stop numba-cuda after it has made the LLVM texts, before NVVM compiles them."""


def llvm_texts(function: Any, arguments: tuple) -> list[str]:
    """Return the LLVM texts of the kernel of a function. The kernel is in the first text."""
    texts: list[str] = []

    def stop(library: Any, cc: Any = None) -> None:
        texts.extend(library.llvm_strs)
        raise _Made

    compiles = codegen.CUDACodeLibrary.get_asm_strs
    codegen.CUDACodeLibrary.get_asm_strs = stop
    try:
        ptx(function, arguments, (9, 0))
    except _Made:
        return texts
    finally:
        codegen.CUDACodeLibrary.get_asm_strs = compiles
    raise AssertionError("numba-cuda did not make LLVM code")


class Emulated:
    """The kernel of a function, compiled for the processor."""

    def __init__(self, function: Any, arguments: tuple) -> None:
        texts = llvm_texts(function, arguments)
        kernel = re.search(r'^define void @"([^"]+)"', texts[0], re.MULTILINE)
        assert kernel
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        machine = llvm.Target.from_default_triple().create_target_machine(opt=2)
        module = llvm.parse_assembly(THREADS)
        for text in texts:
            module.link_in(llvm.parse_assembly(for_processor(text)))
        module.triple, module.data_layout = llvm.get_default_triple(), str(machine.target_data)
        module.verify()
        self.engine = llvm.create_mcjit_compiler(module, machine)
        self.engine.finalize_object()
        self.kernel = self.engine.get_function_address(kernel[1])

    def run(self, count: int, arguments: tuple, threads: int) -> None:
        """Run all threads of one block, one after another. Arrays must be contiguous."""
        values = [count, *_flat(arguments)]
        call = ctypes.CFUNCTYPE(None, *(ctypes.c_double if isinstance(value, float) else ctypes.c_int64 for value in values))(self.kernel)
        number, size = (ctypes.c_int32.from_address(self.engine.get_global_value_address(name)) for name in ("thread", "threads"))
        size.value = threads
        for i in range(threads):
            number.value = i
            call(*values)


def contiguous(value: Any) -> Any:
    """Return copies of the arrays of nested tuples, contiguous and writeable as on a GPU."""
    if isinstance(value, tuple):
        parts = [contiguous(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return np.array(value, order="C") if isinstance(value, np.ndarray) else value


def _flat(value: Any) -> Iterator[int | float]:
    """Yield the arguments of a kernel for nested tuples: numbers, and the fields of Numba's array structure."""
    if isinstance(value, tuple):
        for part in value:
            yield from _flat(part)
    elif isinstance(value, np.ndarray):
        yield from (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
    else:
        yield float(value) if isinstance(value, float) else int(value)


def for_processor(text: str) -> str:
    """Return an LLVM text for NVVM as a text for the processor."""
    text = "\n".join(line for line in text.splitlines() if not line.startswith(("target ", "!", '@"llvm.used"')))
    text = re.sub(r",\s*![\w.]+\s*!\d+", "", text)  # metadata of instructions
    text = re.sub(r"\s*addrspace\(\d+\)", "", text).replace("addrspacecast", "bitcast")
    text = text.replace('"llvm.nvvm.read.ptx.sreg.', '"thread.').replace('"__nv_', '"')
    done: list[str] = []
    for part in re.findall(r'"[^"]*"|[{}()\[\]<>*]|\s+|[^\s"{}()\[\]<>*]+', text):
        if part == "*":  # a pointer type: the type before it goes
            _drop_type(done)
            part = "ptr"
        done.append(part)
    return "".join(done)


def _drop_type(done: list[str]) -> None:
    """Remove the last type from a list of words."""
    while done[-1].isspace():
        done.pop()
    last = done.pop()
    if last not in OPENING:
        return
    depth = 1
    while depth:
        word = done.pop()
        depth += (word == last) - (word == OPENING[last])
    if last == ")":  # a type of a function begins with the type of its result
        _drop_type(done)
