"""Run the jobs of a sweep one after another, in worker processes, or on a SLURM cluster. A killed job does not end the sweep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from radartwin.compiled import cores
from radartwin.errors import ConfigError
from radartwin.io.process_pool import BrokenProcessPool, ProcessPool, finished
from radartwin.runs.job import Job, Outcome, run
from radartwin.runs.slurm import run_on_slurm

KILLED = "its process was killed (memory ran out, or another program ended it); the same command runs it again"
Ended = Callable[[Job, Outcome], None]


def launcher(option: str, settings: Mapping[str, Any]) -> Callable[[Sequence[Job], Ended], None]:
    """Return the function that runs jobs for hydra/launcher=OPTION and calls its second argument for each ended job."""
    if option == "slurm":
        return partial(run_on_slurm, settings)
    if option != "joblib":
        return _run_here
    if not settings["n_jobs"]:
        raise ConfigError("hydra.launcher.n_jobs=0 must be above zero, or -1 for all processor cores")
    return partial(_run_in_workers, settings["n_jobs"])


def _run_here(jobs: Sequence[Job], ended: Ended) -> None:
    for job in jobs:
        ended(job, run(job))


def _run_in_workers(n_jobs: int, jobs: Sequence[Job], ended: Ended) -> None:
    """Run the jobs in `n_jobs` worker processes. -1 means one per processor core, -2 one less, and so on."""
    count = min(len(jobs), n_jobs if n_jobs > 0 else max(1, cores() + 1 + n_jobs))
    pools = [ProcessPool(1, beside=count, nested=True) for _ in range(count)]  # the kill of a worker ends all workers of its pool
    waiting, running = iter(jobs), dict[int, Job]()

    def start(slot: int) -> Future[Outcome] | None:
        if job := next(waiting, None):
            running[slot] = job
            return pools[slot].submit(run, job)
        return None

    try:
        for slot, call in finished(start, count):
            try:
                outcome = call.result()
            except BrokenProcessPool:
                outcome = running[slot].lost(KILLED)
                pools[slot].end()
                pools[slot] = ProcessPool(1, beside=count, nested=True)
            ended(running[slot], outcome)
    finally:
        with ThreadPoolExecutor(count) as threads:  # each worker has some seconds for its clean-up
            list(threads.map(ProcessPool.end, pools))
