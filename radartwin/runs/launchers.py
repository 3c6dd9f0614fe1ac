"""Run the jobs of a sweep one after another, in worker processes, or on a SLURM cluster. A killed job does not end the sweep.

Each job writes how it ended to a file outcome.json in its own folder (radartwin/runs/job.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

from radartwin.compiled import cores
from radartwin.errors import ConfigError
from radartwin.io.process_pool import BrokenProcessPool, ProcessPool
from radartwin.runs.job import FAILED, LOG, Job, Outcome, run

KILLED = "its process was killed twice (memory ran out, or another program ended it)"


@dataclass(frozen=True)
class Serial:
    """Run the jobs in this process."""

    def run(self, jobs: Sequence[Job], ended: Callable[[Job, Outcome], None]) -> None:
        """Run the jobs, and call `ended` for each job as soon as it has ended."""
        for job in jobs:
            ended(job, run(job))


@dataclass(frozen=True)
class Parallel:
    """Run the jobs in worker processes on this machine.

    Attributes:
        n_jobs: number of worker processes; -1 means one per processor core, -2 one less, and so on.
    """

    n_jobs: int = -1

    def __post_init__(self) -> None:
        if not self.n_jobs:
            raise ConfigError("hydra.launcher.n_jobs=0 must be above zero, or -1 for all processor cores")

    def run(self, jobs: Sequence[Job], ended: Callable[[Job, Outcome], None]) -> None:
        """Run the jobs, and call `ended` for each job as soon as it has ended. A job whose process is killed runs again alone at the end,
        when more memory is free. A second kill is its failure.
        """
        count = self.n_jobs if self.n_jobs > 0 else max(1, cores() + 1 + self.n_jobs)
        for job in _killed(jobs, count, ended):
            if _killed([job], 1, ended):
                log = job.folder / LOG
                outcome = Outcome(job.name, FAILED, KILLED, log=str(log) if log.exists() else "")
                outcome.write(job.folder)
                ended(job, outcome)


def _killed(jobs: Sequence[Job], count: int, ended: Callable[[Job, Outcome], None]) -> list[Job]:
    """Run the jobs in `count` processes, and return the jobs whose process was killed.

    Each process belongs to a pool of its own, because the kill of a worker ends all workers of its pool.
    """
    count = min(count, len(jobs))
    pools = [ProcessPool(1, beside=count, nested=True) for _ in range(count)]
    waiting, killed, running = list(reversed(jobs)), list[Job](), dict[Future, tuple[int, Job]]()

    def submit(slot: int) -> None:
        if waiting:
            job = waiting.pop()
            running[pools[slot].submit(run, job)] = slot, job

    try:
        for slot in range(count):
            submit(slot)
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                slot, job = running.pop(future)
                try:
                    ended(job, future.result())
                except BrokenProcessPool:
                    killed.append(job)
                    pools[slot].end()
                    pools[slot] = ProcessPool(1, beside=count, nested=True)
                submit(slot)
    finally:
        if pools:
            with ThreadPoolExecutor(count) as threads:  # each worker has some seconds for its clean-up
                list(threads.map(ProcessPool.end, pools))
    return killed


def status_line(outcome: Outcome) -> str:
    key = f"run {outcome.run_key[:8]}, " if outcome.run_key else ""
    return f"{outcome.status:8s} {outcome.job}: {key}{outcome.line} ({outcome.seconds:.1f} s)"
