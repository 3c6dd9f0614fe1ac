"""With the GNU C library freed memory stays with the process; with another C library nothing changes."""

import ctypes
import platform
import subprocess
import sys

import pytest

from radartwin.io import memory

CHURN = """
import resource, sys
import numpy as np
from radartwin.io import memory
kept = memory.keep_freed()
faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
np.ones(8_000_000)
before = faults()
for _ in range(20):
    np.ones(8_000_000)
print(kept, faults() - before)
"""


REASON = "only the GNU C library can avoid these page faults; results are the same with this one, tracing is slower"


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason=REASON)
def test_memory_of_a_large_array_is_reused():
    done = subprocess.run([sys.executable, "-c", CHURN], capture_output=True, text=True, check=True, env={"NUMPY_MADVISE_HUGEPAGE": "0"})
    kept, faults = done.stdout.split()
    assert kept == "True"
    assert int(faults) < 2000  # 20 arrays of 64 MB are 312,000 pages


@pytest.mark.parametrize("found", [AttributeError, OSError, TypeError])  # no such function, no such library, no library without a name
def test_another_c_library_is_not_used(monkeypatch, found):
    def opened(name):
        raise found

    monkeypatch.setattr(ctypes, "CDLL", opened)
    assert memory.keep_freed.__wrapped__() is False


def test_a_refusal_of_the_c_library_is_reported(monkeypatch):
    class Refusing:
        def mallopt(self, parameter, value):
            return 0

    monkeypatch.setattr(ctypes, "CDLL", lambda name: Refusing())
    assert memory.keep_freed.__wrapped__() is False
