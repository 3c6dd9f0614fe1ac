"""Freed memory stays with the process."""

import platform
import subprocess
import sys

import pytest

CHURN = """
import resource, sys
import numpy as np
from radartwin import memory
kept = memory.keep_freed()
faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt
np.ones(8_000_000)
before = faults()
for _ in range(20):
    np.ones(8_000_000)
print(kept, faults() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only the GNU C library can be asked")
def test_a_large_array_is_not_mapped_afresh():
    told = subprocess.run([sys.executable, "-c", CHURN], capture_output=True, text=True, check=True, env={"NUMPY_MADVISE_HUGEPAGE": "0"})
    kept, faults = told.stdout.split()
    assert kept == "True"
    assert int(faults) < 2000  # 20 arrays of 64 MB are 312,000 pages
