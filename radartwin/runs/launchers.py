"""Run the jobs of a sweep with one of Hydra's launchers (serial, joblib, SLURM), so that a killed job does not end the sweep.

In Hydra's own multirun command, all jobs are lost as soon as one worker is killed. Here, each job of the sweep writes whether it succeeded
or failed to a file outcome.json in the job's own folder (see radartwin/runs/job.py). If the launcher fails, this module takes the jobs that
had started but not ended, and runs them again one at a time. A job that crashes again when it runs alone has failed. All other jobs
continue together.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from pathlib import Path

from radartwin.config.compose import launcher, path_override
from radartwin.io import files
from radartwin.io.one_line import one_line
from radartwin.runs.job import FAILED, LOG, STARTED, Outcome, job, job_name

POLL_S = 0.2
ALONE_TRIES = 2  # number of times that a crashed job is run alone; another program may kill it once, but hardly twice in a row
ERROR_LENGTH = 300  # largest number of characters of a launcher's error in the reason of a failed job


class Launcher:
    """Runs the jobs of one sweep with a launcher of Hydra.

    Args:
        hydra_overrides: overrides of Hydra's settings, such as `hydra/launcher=joblib` and `hydra.launcher.n_jobs=2`.
        folder: folder of the sweep; job N writes its files into folder/N.
        say: called with one line of text for each finished job.
    Raises:
        ConfigError: the launcher or a setting is unknown, or would call code outside radartwin and the launchers.
    """

    def __init__(
        self, hydra_overrides: Sequence[str], config_dirs: Sequence[Path], folder: Path, say: Callable[[str], None] = print
    ) -> None:
        self.folder, self._say = folder, say
        self._plugin = launcher([*hydra_overrides, path_override("hydra.sweep.dir", folder)], config_dirs, job)

    def run(self, jobs: Mapping[int, Sequence[str]], total: int) -> None:
        """Run the sweep's jobs (`jobs` maps job number to overrides) until each has ended.

        If the launcher fails before any job starts, raise its error.
        """
        waiting = dict(jobs)
        with self._watched(list(jobs), total):
            while waiting:
                self._launch(waiting)
                waiting = self._unsettled(waiting)
                for number in [n for n in waiting if (self._place(n) / STARTED).exists()]:
                    self._alone(number, waiting.pop(number))

    def _alone(self, number: int, overrides: Sequence[str]) -> None:
        error = None
        for _ in range(ALONE_TRIES):
            error = self._launch({number: overrides})
            if Outcome.read(self._place(number)):
                return
        if error is None or (isinstance(error, BrokenExecutor) and "terminated" in str(error)):
            reason = f"its process was killed {ALONE_TRIES + 1} times (memory ran out, or another program ended it)"
        else:
            reason = f"the launcher failed {ALONE_TRIES + 1} times: {type(error).__name__}: {one_line(error)[:ERROR_LENGTH]}"
        log = self._place(number) / LOG
        Outcome(job_name(overrides), FAILED, reason, log=str(log) if log.exists() else "").write(self._place(number))

    def _launch(self, jobs: Mapping[int, Sequence[str]]) -> Exception | None:
        """Call Hydra's launcher once.

        Return an error that the launcher raised after jobs had started, because `run` starts these jobs again. None means no error.
        """
        for number in jobs:
            files.make_folder(self._place(number))
            (self._place(number) / STARTED).unlink(missing_ok=True)
        placed = [[*overrides, f"hydra.sweep.subdir='{number}'"] for number, overrides in jobs.items()]
        try:
            self._plugin.launch(placed, initial_job_idx=0)
        except Exception as error:
            if not any((self._place(number) / STARTED).exists() for number in jobs):
                raise
            return error
        return None

    def _unsettled(self, jobs: Mapping[int, Sequence[str]]) -> dict[int, Sequence[str]]:
        return {number: overrides for number, overrides in jobs.items() if Outcome.read(self._place(number)) is None}

    def _place(self, number: int) -> Path:
        return self.folder / str(number)

    @contextlib.contextmanager
    def _watched(self, numbers: list[int], total: int) -> Iterator[None]:
        """Within the `with` block, print a line for each job as soon as the file that states how the job ended appears."""
        over, said = threading.Event(), total - len(numbers)

        def report() -> None:
            nonlocal said
            for number in list(numbers):
                if outcome := Outcome.read(self._place(number)):
                    numbers.remove(number)
                    said += 1
                    self._say(f"[{said}/{total}] {status_line(outcome)}")

        def watch() -> None:
            while not over.wait(POLL_S):
                report()

        watcher = threading.Thread(target=watch, daemon=True)
        watcher.start()
        try:
            yield
        finally:
            over.set()
            watcher.join()
            report()


def status_line(outcome: Outcome) -> str:
    run = f"run {outcome.run_key[:8]}, " if outcome.run_key else ""
    return f"{outcome.status:8s} {outcome.job}: {run}{outcome.line} ({outcome.seconds:.1f} s)"
