"""Memory of a process: the GNU C library keeps freed memory, and limits of jobs and control groups count as the machine's memory."""

import ctypes
import math
import os
import platform
import subprocess
import sys
from pathlib import Path

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


def test_free_memory_respects_the_limits_of_job_and_control_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    used = memory.resident_bytes(os.getpid())
    monkeypatch.setenv("SLURM_MEM_PER_NODE", str(int(used / 2**20) + 100))
    assert 0 < memory.free_bytes() < 150 * 2**20
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "1")
    assert memory.free_bytes() == 0
    group = tmp_path / "slice" / "job"
    group.mkdir(parents=True)
    (tmp_path / "process").write_text("0::/slice/job\n")
    assert memory._group_bytes(tmp_path, tmp_path / "process") == math.inf
    for folder, limit in ((group, "max"), (group.parent, "1000")):
        (folder / "memory.max").write_text(f"{limit}\n")
        (folder / "memory.current").write_text("700\n")
        (folder / "memory.stat").write_text("anon 500\ninactive_file 150\n")
    assert memory._group_bytes(tmp_path, tmp_path / "process") == 450
