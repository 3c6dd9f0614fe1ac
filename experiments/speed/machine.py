"""Describe the machine on which run times are measured."""

from __future__ import annotations

import functools
import importlib.metadata
import os
import platform

from radartwin.benchmark.leaderboard import processor


@functools.cache
def machine() -> dict[str, str]:
    """Return processor, memory, operating system and package versions of this machine, as {name: text}."""
    versions = {name: importlib.metadata.version(name) for name in ("numpy", "mitsuba", "drjit")}
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30 if hasattr(os, "sysconf") else 0.0
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": processor(), "cores": f"{cores} cores", "memory": f"{memory:.0f} GiB",
        "system": f"{platform.system()} {platform.machine()}", "python": f"Python {platform.python_version()}",
        "packages": ", ".join(f"{name} {version}" for name, version in versions.items()),
    }  # fmt: skip
