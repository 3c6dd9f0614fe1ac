"""What methods cost on this machine: seconds of a frame by interleaved repetitions, memory at its peak, and the machine they are of.

A recording is timed warm: kernels compiled, and of a radar at rest the room already traced. What the first recording took beyond a warm
one is `setup_s`, which a recording of `Problem.frames` frames shares; a moving radar is timed as if nothing were kept. Seconds of a frame
are setup over that number of frames, and the median warm recording over its own. Methods alternate, so that a machine that slows down
slows all. Seconds are the processors', of all threads and of the processes of peers, which move little with what else runs; the wall clock
stands beside them, and in their place where rays are traced on a GPU.
"""

from __future__ import annotations

import gc
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.speed import signal_error
from experiments.speed.methods import OURS, Method, counted_rays, published_seconds, rays_of, worker_pids
from experiments.speed.problems import RADAR, Problem
from radartwin.simulation import variant
from radartwin.store import array_cache

ASIDE_M = 1e-6  # of a radar from one call to the next, where nothing may be kept


class Peak:
    """Resident memory above what it was, in MiB, of this process and of the processes of peers; None where the system does not tell."""

    def __init__(self) -> None:
        gc.collect()
        self._before = {pid: _reset(pid) for pid in ("self", *map(str, worker_pids()))}

    def mib(self) -> float | None:
        if None in self._before.values():
            return None
        total = 0
        for pid in ("self", *map(str, worker_pids())):
            total += (_status(pid, "VmHWM") or 0) - (self._before.get(pid) or 0)
        return total / 1024


def clock() -> float:
    """Seconds of this process and of the processes of peers, all threads; of the wall where a GPU does the work."""
    if variant.activate("auto").startswith("cuda"):
        return time.perf_counter()
    total = time.process_time()
    for pid in worker_pids():
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() if Path(f"/proc/{pid}/stat").is_file() else []
        total += sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK") if fields else 0.0
    return total


def _reset(pid: str) -> int | None:
    """Start the high-water mark of a process anew; what it holds now, in KiB. Linux alone."""
    try:
        Path(f"/proc/{pid}/clear_refs").write_text("5")
    except OSError:
        return None
    return _status(pid, "VmRSS")


def _status(pid: str, name: str) -> int | None:
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) for line in lines if line.startswith(name)), None)


class Timed:
    """One method on one problem."""

    def __init__(self, problem: Problem, method: Method, count: Callable[[], int]) -> None:
        self.problem, self.method, self._count = problem, method, count
        self.frames = min(part.scored for part in problem.parts)
        self.seconds: list[float] = []
        self.wall: list[float] = []
        self._last_wall = 0.0
        self.setup_s = 0.0
        self.memory_mib: float | None = None
        self.rays: float | None = None

    def score(self) -> signal_error.Errors:
        """Errors of the scored frames."""
        pairs = [(self.method.iq(part, part.scored, part.radar), self.problem.reference(part)) for part in self.problem.parts]
        return signal_error.compare(pairs, self.problem.parts[0].radar)

    def once(self, moved: bool = False) -> float:
        """Seconds of all recordings once, over their frames. `moved`: with nothing that is kept."""
        if self.method.published:
            settings = self.method.simulator.settings
            found = [published_seconds(part, settings, RADAR, clock) for part in self.problem.parts]
            self._last_wall = float(np.mean(found))  # of one thread, were it alone
            return self._last_wall
        aside = ASIDE_M * self._count() if moved or not self.problem.resting else 0.0
        began, wall = clock(), time.perf_counter()
        for part in self.problem.parts:
            self.method.iq(part, self.frames, RADAR, aside)
        frames = self.frames * len(self.problem.parts)
        self._last_wall = (time.perf_counter() - wall) / frames
        return (clock() - began) / frames

    def prepare(self, budget_s: float, most: int) -> None:
        """The first recording, with its memory and rays; then how many frames a repetition has.

        This tracer takes all, for it shares work among them; others, whose frames cost the same each, what the budget allows.
        """
        own = self.method.family == OURS
        if own and not self.problem.resting:
            self.frames = most
        frames = self.frames * len(self.problem.parts)
        peak = Peak()
        with counted_rays() as launched:
            first = self.once()
        self.memory_mib = peak.mib()
        if self.method.published or (own and not self.problem.resting):
            self._note(first)
            self.rays = self._rays(sum(launched) / frames, 0.0)
            return
        with counted_rays() as again:
            warm = self.once()
        self.rays = self._rays(sum(again) / frames, sum(launched) - sum(again))
        self.setup_s = max(0.0, first - warm) * self.frames if self.problem.resting else 0.0
        self.frames = most if own else int(np.clip(budget_s / max(warm * len(self.problem.parts), 1e-9), self.frames, most))

    def _rays(self, each: float, once: float) -> float:
        """Of a frame: those launched for it, and its share of those for all; or what a peer's settings tell."""
        told = rays_of(self.method.simulator)
        return each + once / self.problem.frames if told is None else float(told)

    def again(self) -> None:
        self._note(self.once())

    def _note(self, frame_s: float) -> None:
        self.seconds.append(frame_s)
        self.wall.append(self._last_wall)

    def row(self) -> dict[str, Any]:
        """Its figures: error, cost and their spread."""
        shared = self.setup_s / self.problem.frames
        seconds = np.array(self.seconds) + shared
        errors = self.score()
        return {
            "problem": self.problem.name,
            "family": self.method.family,
            "setting": self.method.setting,
            "seconds_frame": float(np.median(seconds)),
            "seconds": seconds.tolist(),
            "wall_s_frame": float(np.median(self.wall)) + shared,
            "setup_s": self.setup_s,
            "frames timed": self.frames,
            "memory_mib": self.memory_mib,
            "rays": self.rays,
            "signal_error": errors.signal,
            "profile_error_db": errors.profile_db,
            "offset_db": errors.offset_db,
            "free_error_db": errors.free_db,
            "exact": not self.method.backend,
        }


def measure(
    problem: Problem, methods: Sequence[Method], rounds: int, budget_s: float, slow_s: float, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """All methods on a problem, in turn; the first is run once more beforehand, so that what all share is compiled.

    Args:
        rounds: repetitions after the first two. budget_s: of one repetition, where it may hold more frames.
        slow_s: of a repetition, beyond which a method is timed once and no more.
    """
    calls = iter(range(1, 1_000_000))

    def count() -> int:
        return next(calls)

    timed = [Timed(problem, method, count) for method in methods]
    most = min(len(next(iter(part.motion.values()), part.sensor)) for part in problem.parts)
    with tempfile.TemporaryDirectory() as folder, array_cache.in_folder(folder):
        timed[0].once(moved=True)
        for one in timed:
            one.prepare(budget_s, most)
        for _ in range(rounds):
            for one in timed:
                length_s = (one.seconds[-1] if one.seconds else 0.0) * one.frames * len(problem.parts)
                if not one.seconds or (length_s < slow_s and not one.method.published):
                    one.again()
        rows = [one.row() for one in timed]
    for one in timed:
        say(f"  {problem.name}: {one.method.name}: {np.median(one.seconds) * 1e3:.3g} ms a frame")
    return rows
