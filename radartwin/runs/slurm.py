"""Run a sweep on a SLURM cluster: hydra-submitit-launcher submits the jobs, and the command squeue reports which jobs still run.

hydra-submitit-launcher itself stops waiting at the first killed job, and waits forever on a cluster without SLURM accounting. In this
module a job has ended when the job's file outcome.json exists (radartwin/runs/job.py) or when the SLURM queue no longer contains the job.
"""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra_plugins.hydra_submitit_launcher.config import BaseQueueConf
from hydra_plugins.hydra_submitit_launcher.submitit_launcher import SlurmLauncher

from radartwin.errors import BackendError, ConfigError
from radartwin.io.one_line import plural
from radartwin.runs.job import FAILED, LOG, Outcome, job_name

POLL_S = 5.0  # seconds between two looks at the queue, unless RADARTWIN_SLURM_POLL gives another number
GRACE = 4  # looks at the queue until a job that left it without outcome.json has failed; files of other nodes appear with a delay
WAITING = ("PENDING", "RUNNING", "COMPLETING", "CONFIGURING", "REQUEUED", "SUSPENDED", "RESIZING", "SIGNALING", "STAGE_OUT", "STOPPED")


class SlurmSweep(SlurmLauncher):
    """The launcher for hydra/launcher=slurm; its settings are those of the launcher submitit_slurm."""

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[Any]:
        """Submit the jobs of a sweep as one SLURM job array and return when each job has ended.

        Raises:
            BackendError: SLURM is not installed here, or refuses the submission.
            ConfigError: RADARTWIN_SLURM_POLL is not a number of seconds above zero.
        """
        from hydra.core.singleton import Singleton
        from submitit import AutoExecutor
        from submitit.core.utils import FailedJobError

        assert self.config is not None
        poll_s = _poll_s()
        own = {"submitit_folder", "max_num_timeout"}
        shared = set(BaseQueueConf.__dataclass_fields__)
        settings = {name if name in shared else f"slurm_{name}": value for name, value in self.params.items() if name not in own}
        numbers = range(initial_job_idx, initial_job_idx + len(job_overrides))
        try:
            executor = AutoExecutor(
                folder=self.params["submitit_folder"], cluster="slurm", slurm_max_num_timeout=self.params["max_num_timeout"]
            )
            executor.update_parameters(**settings)
            count, names = len(job_overrides), [str(number) for number in numbers]
            submitted = executor.map_array(
                self, [list(o) for o in job_overrides], ["hydra.sweep.dir"] * count, numbers, names, [Singleton.get_state()] * count
            )
        except (RuntimeError, FailedJobError) as error:
            reason = " ".join(str(error).split())[-300:]
            raise BackendError(f"hydra/launcher=slurm: {reason}; run it where sbatch works, or choose another launcher") from error
        ids = [job.job_id for job in submitted]
        print(f"slurm: {plural(len(ids), 'job')} submitted as {_array(ids)}; scancel {_array(ids)} stops them", flush=True)
        self._wait(dict(zip(ids, job_overrides, strict=True)), poll_s)
        return []

    def _wait(self, jobs: dict[str, Sequence[str]], poll_s: float) -> None:
        """Wait until each job of the SLURM array has ended. A job that left the SLURM queue without writing outcome.json has failed."""
        array, gone_since = _array(list(jobs)), dict[str, float]()
        while True:
            jobs = {job: overrides for job, overrides in jobs.items() if Outcome.read(self._place(overrides)) is None}
            if not jobs:
                return
            states = queue_states(array)
            for job, overrides in jobs.items():
                state = states.get(job, "")
                if states is UNREACHABLE or state in WAITING:
                    gone_since.pop(job, None)
                elif time.monotonic() - gone_since.setdefault(job, time.monotonic()) >= GRACE * poll_s:
                    self._fail(job, overrides, state)
            time.sleep(poll_s)

    def _fail(self, job: str, overrides: Sequence[str], state: str) -> None:
        place = self._place(overrides)
        assert self.config is not None
        own_log, slurm_log = place / LOG, Path(str(self.config.hydra.sweep.dir)) / "slurm" / job / f"{job}_0_log.err"
        log = next((str(path) for path in (own_log, slurm_log) if path.exists() and path.stat().st_size), "")
        reason = f"SLURM job {job} ended {state or 'and left the queue'} without a result"
        named = [o for o in overrides if not o.startswith("hydra.")]
        Outcome(job_name(named), FAILED, reason, log=log).write(place)

    def _place(self, overrides: Sequence[str]) -> Path:
        """Return the folder of a job, which radartwin/runs/launchers.py passes to the job as an override."""
        assert self.config is not None
        name = next(o.partition("=")[2].strip("'") for o in overrides if o.startswith("hydra.sweep.subdir="))
        return Path(str(self.config.hydra.sweep.dir)) / name


UNREACHABLE: dict[str, str] = {}  # returned if SLURM does not answer; `is` comparison distinguishes it from an empty queue


def queue_states(array: str) -> dict[str, str]:
    """Return the states of a SLURM array's jobs that are still in the queue, by job id, such as {"12_3": "RUNNING"}."""
    command = ["squeue", "--noheader", "--array", "--states=all", f"--jobs={array}", "--format=%i %T"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and "Invalid job id" not in done.stderr:
        return UNREACHABLE
    return dict(line.split()[:2] for line in done.stdout.splitlines() if len(line.split()) >= 2) if not done.returncode else {}


def _poll_s() -> float:
    text = os.environ.get("RADARTWIN_SLURM_POLL", str(POLL_S))
    with contextlib.suppress(ValueError):
        if 0 < float(text) < math.inf:
            return float(text)
    raise ConfigError(f"RADARTWIN_SLURM_POLL={text} is not a number of seconds above zero; correct it or unset it")


def _array(ids: Sequence[str]) -> str:
    return ids[0].partition("_")[0]
