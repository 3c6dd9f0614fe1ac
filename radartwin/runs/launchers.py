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
from radartwin.runs.job import Job, Outcome, run

KILLED = "its process was killed (memory ran out, or another program ended it); the same command runs it again"


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
        """Run the jobs, and call `ended` for each job as soon as it has ended. A job whose process is killed has failed.

        Each process belongs to a pool of its own, because the kill of a worker ends all workers of its pool.
        """
        count = min(len(jobs), self.n_jobs if self.n_jobs > 0 else max(1, cores() + 1 + self.n_jobs))
        pools = [ProcessPool(1, beside=count, nested=True) for _ in range(count)]
        waiting, running = iter(jobs), dict[Future[Outcome], tuple[int, Job]]()

        def submit(slot: int) -> None:
            if job := next(waiting, None):
                running[pools[slot].submit(run, job)] = slot, job

        try:
            for slot in range(count):
                submit(slot)
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    slot, job = running.pop(future)
                    try:
                        outcome = future.result()
                    except BrokenProcessPool:
                        outcome = job.lost(KILLED)
                        pools[slot].end()
                        pools[slot] = ProcessPool(1, beside=count, nested=True)
                    ended(job, outcome)
                    submit(slot)
        finally:
            with ThreadPoolExecutor(count) as threads:  # each worker has some seconds for its clean-up
                list(threads.map(ProcessPool.end, pools))


def status_line(outcome: Outcome) -> str:
    key = f"run {outcome.run_key[:8]}, " if outcome.run_key else ""
    return f"{outcome.status:8s} {outcome.job}: {key}{outcome.line} ({outcome.seconds:.1f} s)"
