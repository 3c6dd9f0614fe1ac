"""The functions of the flat engine give the same values as kernels of a GPU as on the processor.

Each test has a process of its own, because numba.cuda reads its settings when it is imported.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from radartwin.simulation import variant
from radartwin.simulation.flat import parallel

ROOT = Path(__file__).resolve().parents[2]
RECORD = """
import sys
import numpy as np
from kernel_calls import kinds, largest_error, recorded
from radartwin.simulation.flat import parallel

calls = recorded()
assert set(calls) == {"field.evaluate", "legs._evaluate", "legs._weigh", "crossing._fill", "silhouette._of_lines",
                      "silhouette._over_mirrors"}, set(calls)
assert min(kinds(calls["field.evaluate"]).values()) > 5, kinds(calls["field.evaluate"])
assert any((call.after[0] > 0).any() for call in calls["crossing._fill"]), "no line crosses a pane"
"""
# The simulator runs the kernel's Python code in one thread of the processor per thread of the GPU. The functions that the kernel calls are
# machine code of the processor, which needs NumPy's arrays.
SIMULATED = """
class Copy(np.ndarray):
    def copy_to_host(self, values):
        values[...] = self

def copied(value):
    if isinstance(value, tuple):
        parts = [copied(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value.view(Copy) if isinstance(value, np.ndarray) else value

from radartwin.simulation.flat import gpu

gpu.WORKERS, gpu.copied, gpu.memory = 128, copied, copied
for some in calls.values():
    for call in some:
        found = [values.copy() for values in call.before]
        gpu.compute(call.function, call.count, call.arguments, found, call.work)
        assert largest_error(found, call.after) < 1e-9, call.name
"""
EMULATED = """
from gpu_code import Emulated, contiguous

for name in sys.argv[1:]:
    kernel = None
    for call in calls[name]:
        arguments = contiguous((*call.arguments, *call.before, call.work(64)))
        kernel = kernel or Emulated(call.function, arguments)
        kernel.run(call.count, arguments, 64)
        found = list(arguments[len(call.arguments) : -1])
        assert largest_error(found, call.after) < 1e-9, name
"""
# A kernel has at most 64 KiB of constants.
COMPILED = """
import re
from gpu_code import contiguous, ptx
from numba.cuda.cudadrv.error import NvvmSupportError

for name in sys.argv[2:]:
    call = calls[name][0]
    arguments = contiguous((*call.arguments, *call.before, call.work(64)))
    for capability in ((8, 0), (9, 0)) if sys.argv[1] == "optimised" else ((9, 0),):
        try:
            text = ptx(call.function, arguments, capability, sys.argv[1] == "optimised")
        except (NvvmSupportError, ImportError, RuntimeError) as error:
            if "No such file" not in str(error) and not isinstance(error, (NvvmSupportError, ImportError)):
                raise
            print(error)
            sys.exit(77)
        assert f".target sm_{capability[0]}{capability[1]}" in text
        assert sum(int(size) for size in re.findall(r"[.]const [.]align \\d+ [.]b8 [^\\[]+\\[(\\d+)\\]", text)) < 65_536, name
"""
ON_GPU = """
from radartwin.simulation import variant
from radartwin.simulation.flat import gpu

variant.activate("cuda")
parallel.FEW = 1
for some in calls.values():
    for call in some:
        found = [values.copy() for values in call.before]
        parallel.compute(call.function, call.count, call.arguments, found, call.work)
        assert largest_error(found, call.after) < 1e-9, call.name
assert gpu._compiled.cache_info().currsize == len(calls)
"""
KERNELS = (
    ("field.evaluate",),
    ("legs._evaluate", "legs._weigh", "crossing._fill"),
    ("silhouette._of_lines", "silhouette._over_mirrors"),
)
needs_numba_cuda = pytest.mark.skipif(not parallel.installed(), reason="numba-cuda is not installed; pip install 'radartwin[gpu]'")


def run(code: str, *arguments: str, **settings: str) -> None:
    """Run code after RECORD in a process of its own. The exit status 77 skips the test."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")]), **settings}
    command = [sys.executable, "-c", RECORD + code, *arguments]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if answer.returncode == 77:
        missing = answer.stdout.strip().splitlines()[-1]
        pytest.skip(f"NVIDIA's compiler is not installed ({missing}); pip install 'radartwin[gpu]'")
    assert answer.returncode == 0, answer.stderr[-4000:]


def test_kernels_in_the_simulator_of_numba_give_the_values_of_the_processor() -> None:
    """The test covers the copies, the grid of threads and the memory of the workers."""
    run(SIMULATED, NUMBA_ENABLE_CUDASIM="1")


@needs_numba_cuda
@pytest.mark.parametrize("names", KERNELS, ids=lambda names: names[0])
def test_code_for_a_gpu_gives_the_values_of_the_processor(names: tuple[str, ...]) -> None:
    """The test runs the LLVM code of the kernels on the processor, where it gives equal bits. A GPU rounds sines and roots differently."""
    run(EMULATED, *names)


@needs_numba_cuda
@pytest.mark.parametrize("names", KERNELS, ids=lambda names: names[0])
def test_kernels_compile_for_a_gpu(names: tuple[str, ...]) -> None:
    """NVVM compiles for a capability of 9.0, as that of an H100, without optimising the code, which would take a minute."""
    run(COMPILED, "quick", *names)


@pytest.mark.slow
@needs_numba_cuda
@pytest.mark.parametrize("names", KERNELS, ids=lambda names: names[0])
def test_optimised_kernels_compile_for_a_gpu(names: tuple[str, ...]) -> None:
    """NVVM compiles for capabilities of 8.0 and 9.0."""
    run(COMPILED, "optimised", *names)


@pytest.mark.gpu
@needs_numba_cuda
@pytest.mark.skipif(not variant.has_cuda(), reason="this computer has no NVIDIA GPU")
def test_kernels_on_a_gpu_give_the_values_of_the_processor() -> None:
    run(ON_GPU)
