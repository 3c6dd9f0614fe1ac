"""Compiled code gives the same bits when it is new and when it is read from Numba's cache, and is compiled once."""

import multiprocessing
import os
import shutil
import subprocess
import sys
import warnings

import numpy as np
import pytest
from numba.core.errors import NumbaError

from radartwin import compiled as compiled_module

SIGNAL = """
import hashlib
import numpy as np
import radartwin as rt
from radartwin.scene import rooms

radar = rt.Radar.iwr1843()
pose = rooms.bench("lab").sensor_pose
print(hashlib.sha256(rt.simulate(rooms.room("lab", detail="shell"), radar, pose[None]).iq.tobytes()).hexdigest())
"""

TOGETHER = """
import time

from function import square
from numba.core import event


class Slow(event.Listener):
    def on_start(self, event):
        time.sleep(3)  # so that the other process needs the function before it is compiled

    def on_end(self, event):
        pass


event.register("numba:compile", Slow())
print("ready", flush=True)
input()
square(2.0)
print(sum(square.stats.cache_misses.values()), sum(square.stats.cache_hits.values()))
"""


def test_two_processes_compile_a_function_once(tmp_path):
    (tmp_path / "function.py").write_text("from radartwin.compiled import compiled\n\n\n@compiled\ndef square(x):\n    return x * x\n")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen([sys.executable, "-c", TOGETHER], env=environment, **pipes) for _ in range(2)]
    for process in processes:
        assert process.stdout
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin
        process.stdin.write("\n")
        process.stdin.flush()
    counts = sorted(process.communicate(timeout=120)[0] for process in processes)
    assert counts == ["0 1\n", "1 0\n"], "(misses, hits) of each process"


def test_an_inner_function_is_compiled_once_and_can_be_called_from_python():
    """The machine code of an inner function is only in that of its callers. Numba itself makes a version for each literal argument."""

    @compiled_module.inner
    def item(values, place, twice):
        return values[place] * (2 if twice else 1)

    @compiled_module.compiled
    def outer(values):
        place, total = 0, item(values, 1, False)
        while place < 2:
            total += item(values, place, True)
            place += 1
        return total

    assert outer(np.array([1.0, 2.0])) == 8.0
    assert len(item.overloads) == 1
    assert item(np.array([1.0, 2.0]), 1, True) == 4.0
    assert item.stats.cache_path is None


@pytest.mark.slow
def test_compiled_now_and_read_from_the_cache_are_the_same(tmp_path):
    """With fused multiply-add instructions, the last bits depended on which process had compiled the code."""

    def digest() -> str:
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        return subprocess.run([sys.executable, "-c", SIGNAL], env=environment, capture_output=True, text=True, check=True).stdout

    first = digest()
    assert list(tmp_path.rglob("*.nbc")), "nothing was compiled into the cache"
    assert digest() == first


def test_each_keeps_the_order_within_each_and_after_a_fork() -> None:
    """Threads of a pool that wait for their own pool would never end."""

    def nested(depth: int, number: int) -> list:
        return [number] if depth == 0 else compiled_module.each(lambda item: nested(depth - 1, 10 * number + item), range(4))

    def expected(depth: int, number: int) -> list:
        return [number] if depth == 0 else [expected(depth - 1, 10 * number + item) for item in range(4)]

    assert nested(3, 1) == expected(3, 1)
    context = multiprocessing.get_context("fork")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of a fork in a process with threads
        child = context.Process(target=lambda: os._exit(0 if nested(3, 1) == expected(3, 1) else 1))
        child.start()
    child.join(timeout=60)
    assert child.exitcode == 0


def test_an_error_in_one_thread_reaches_the_caller() -> None:
    def fail(item: int) -> None:
        if item == 3:
            raise ValueError("item 3")

    with pytest.raises(ValueError, match="item 3"):
        compiled_module.each(fail, range(6))


def test_innermost_functions_cannot_make_arrays() -> None:
    """They do not count references to arrays, so that an array that they make would never be freed."""

    @compiled_module.innermost
    def makes(count):
        return np.zeros(count).sum()

    with pytest.raises(NumbaError):
        makes(3)


CALLED = "from radartwin.compiled import compiled\n\n\n@compiled\ndef called(x):\n    return {} * x\n"
CALLER = (
    "from radartwin.called import called\nfrom radartwin.compiled import compiled\n\n\n@compiled\ndef caller(x):\n    return called(x)\n"
)


@pytest.mark.parametrize("module", ["radartwin.caller", "own_script"])
def test_a_change_in_another_file_compiles_its_callers_again(tmp_path, module):
    """Numba itself looks only at the file of the caller, so that the old function would stay in its machine code."""
    package = tmp_path / "radartwin"
    package.mkdir()
    (package / "__init__.py").touch()
    for source in (compiled_module.__file__, compiled_module.source_files.__file__):
        shutil.copy(str(source), package)
    (tmp_path / f"{module.replace('.', '/')}.py").write_text(CALLER)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    code = f"from {module} import caller; print(caller(1.0), sum(caller.stats.cache_hits.values()))"
    printed = []
    for factor in (2.0, 2.0, 3.0):
        (package / "called.py").write_text(CALLED.format(factor))
        done = subprocess.run([sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        printed.append(done.stdout)
    assert printed == ["2.0 0\n", "2.0 1\n", "3.0 0\n"]
