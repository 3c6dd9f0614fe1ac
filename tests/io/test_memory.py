"""With the GNU C library, a process keeps the memory that it frees; with another C library nothing changes."""

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
memory.keep_freed()
faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
np.ones(8_000_000)
before = faults()
for _ in range(20):
    np.ones(8_000_000)
print(faults() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only the GNU C library can avoid these page faults")
def test_memory_of_a_large_array_is_reused():
    done = subprocess.run([sys.executable, "-c", CHURN], capture_output=True, text=True, check=True, env={"NUMPY_MADVISE_HUGEPAGE": "0"})
    assert int(done.stdout) < 2000  # 20 arrays of 64 MB are 312,000 pages


def test_another_c_library_changes_nothing(monkeypatch):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())  # a C library without mallopt and malloc_trim
    memory.keep_freed.__wrapped__()
    memory.give_back()
