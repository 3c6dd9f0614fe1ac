"""Measure run time and memory of simulation methods on this machine. The repetitions of the compared methods alternate.

The timing starts after all kernels are compiled. For a radar at rest, the additional time of the first recording is the set-up time,
divided by the frames of a whole recording (`Problem.frames`); a moving radar is timed without cached rooms. Seconds are processor seconds
of all threads and of other simulators' processes, because they depend little on the load; on a GPU they are wall-clock seconds.
"""

import gc
import itertools
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.speed.machine import memory_kib
from experiments.speed.methods import OURS, Method, counted_rays, rays_of
from experiments.speed.problems import RADAR, Problem
from radartwin.benchmark import signal_error
from radartwin.benchmark.entrants import published_seconds
from radartwin.simulation import variant
from radartwin.simulation.backends import sionna
from radartwin.store import array_cache

ASIDE_M = 1e-6  # shift of the radar between calls that must not reuse cached paths


class Peak:
    """Measure the peak resident memory of this process and of other simulators' processes since the object was created."""

    def __init__(self) -> None:
        gc.collect()
        self._before = {pid: _reset(pid) for pid in ("self", *map(str, sionna.process_ids()))}

    def mib(self) -> float | None:
        """Return the peak memory in MiB above the value at the start, or None on systems other than Linux."""
        if None in self._before.values():
            return None
        total = 0
        for pid in ("self", *map(str, sionna.process_ids())):
            total += (memory_kib("VmHWM", pid) or 0) - (self._before.get(pid) or 0)
        return total / 1024


def clock() -> float:
    """Return the processor seconds of this process and of other simulators; wall-clock seconds if a GPU traces the rays."""
    if variant.activate("auto").startswith("cuda"):
        return time.perf_counter()
    total = time.process_time()
    for pid in sionna.process_ids():
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() if Path(f"/proc/{pid}/stat").is_file() else []
        total += sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK") if fields else 0.0
    return total


def _reset(pid: str) -> int | None:
    """Reset the peak memory counter of a process. Returns the resident memory in KiB, or None on systems other than Linux."""
    try:
        Path(f"/proc/{pid}/clear_refs").write_text("5")
    except OSError:
        return None
    return memory_kib("VmRSS", pid)


class Timed:
    """Errors, run times and memory of one simulation method on one test problem."""

    def __init__(self, problem: Problem, method: Method, calls: Iterator[int]) -> None:
        self.problem, self.method, self._calls = problem, method, calls
        self.frames = min(part.scored for part in problem.parts)
        self.times: list[tuple[float, float]] = []  # result of the method `once` of each repetition
        self.setup_s = 0.0
        self.memory_mib: float | None = None
        self.rays: float | None = None

    def score(self) -> signal_error.Errors:
        """Return the errors of the samples over the frames that have a reference."""
        pairs = [(self.method.iq(part, part.scored, part.radar), self.problem.reference(part)) for part in self.problem.parts]
        return signal_error.compare(pairs, self.problem.parts[0].radar)

    def once(self, moved: bool = False) -> tuple[float, float]:
        """Simulate all recordings once, with a shifted radar if `moved`. Returns (seconds of `clock`, wall-clock seconds) per frame."""
        if self.method.published:
            settings = self.method.simulator.settings
            seconds = [
                published_seconds(part.scene, part.sensor[:1], {k: p[:1] for k, p in part.motion.items()}, settings, RADAR, clock)
                for part in self.problem.parts
            ]
            return float(np.mean(seconds)), float(np.mean(seconds))  # one thread works, so processor and wall-clock time are nearly equal
        aside = ASIDE_M * next(self._calls) if moved or not self.problem.resting else 0.0
        began, wall = clock(), time.perf_counter()
        for part in self.problem.parts:
            self.method.iq(part, self.frames, RADAR, aside)
        frames = self.frames * len(self.problem.parts)
        wall_s = (time.perf_counter() - wall) / frames
        return (clock() - began) / frames, wall_s

    def prepare(self, budget_s: float, most: int) -> None:
        """Simulate the first recordings, measure their memory and rays, and choose the number of frames of a repetition: all (`most`) for
        our tracer, which does some work for several frames at once; of others as many as fit into `budget_s` seconds.
        """
        is_radartwin = self.method.family == OURS
        if is_radartwin and not self.problem.resting:
            self.frames = most
        frames = self.frames * len(self.problem.parts)
        peak = Peak()
        with counted_rays() as launched:
            first = self.once()
        self.memory_mib = peak.mib()
        if self.method.published or (is_radartwin and not self.problem.resting):
            self.times.append(first)
            self.rays = self._rays(sum(launched) / frames, 0.0)
            return
        with counted_rays() as again:
            warm, _ = self.once()
        self.rays = self._rays(sum(again) / frames, sum(launched) - sum(again))
        self.setup_s = max(0.0, first[0] - warm) * self.frames if self.problem.resting else 0.0
        self.frames = most if is_radartwin else int(np.clip(budget_s / max(warm * len(self.problem.parts), 1e-9), self.frames, most))

    def _rays(self, each: float, once: float) -> float:
        """Return the rays per frame: of our tracer `each` and its share of those launched `once`; of others the setting."""
        from_settings = rays_of(self.method.simulator)
        return each + once / self.problem.frames if from_settings is None else float(from_settings)

    def row(self) -> dict[str, Any]:
        """Return the errors, the run time and its single repetitions as a table row."""
        shared = self.setup_s / self.problem.frames
        seconds, wall = np.array(self.times).T + shared
        errors = self.score()
        case = {"problem": self.problem.name, "family": self.method.family, "setting": self.method.setting}
        times = {"seconds_frame": float(np.median(seconds)), "seconds": seconds.tolist(), "wall_s_frame": float(np.median(wall))}
        spent = {"setup_s": self.setup_s, "frames timed": self.frames, "memory_mib": self.memory_mib, "rays": self.rays}
        found = {"signal_error": errors.signal, "profile_error_db": errors.profile_db, "offset_db": errors.offset_db}
        return {**case, **times, **spent, **found, "free_error_db": errors.free_db, "exact": not self.method.backend}


def measure(
    problem: Problem, methods: Sequence[Method], rounds: int, budget_s: float, slow_s: float, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Time all methods on a test problem and return one row per method.

    The first call compiles the kernels. After two repetitions there are `rounds` more in alternating order, because a method can be slower
    after another one. A method whose repetition takes more than `slow_s` seconds is timed once.
    """
    calls = itertools.count(1)
    timed = [Timed(problem, method, calls) for method in methods]
    most = min(len(next(iter(part.motion.values()), part.sensor)) for part in problem.parts)
    with tempfile.TemporaryDirectory() as folder, array_cache.in_folder(folder):
        timed[0].once(moved=True)
        for timing in timed:
            timing.prepare(budget_s, most)
        for number in range(rounds):
            for timing in timed[:: 1 if number % 2 else -1]:
                length_s = timing.times[-1][0] * timing.frames * len(problem.parts) if timing.times else 0.0
                if not timing.times or (length_s < slow_s and not timing.method.published):
                    timing.times.append(timing.once())
        rows = [timing.row() for timing in timed]
    for timing in timed:
        say(f"  {problem.name}: {timing.method.name}: {np.median(timing.times, axis=0)[0] * 1e3:.3g} ms a frame")
    return rows
