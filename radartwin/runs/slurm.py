"""Run a sweep on a SLURM cluster: submitit submits the jobs as one job array, and the command squeue reports which jobs still run.

submitit itself waits forever on a cluster without SLURM accounting. Here a job has ended when it wrote outcome.json or left the queue.
"""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from radartwin.errors import BackendError, ConfigError
from radartwin.io.one_line import one_line, plural
from radartwin.runs.job import Job, Outcome, run

POLL_S = 5.0  # seconds between two looks at the queue, unless RADARTWIN_SLURM_POLL gives another number
GRACE = 4  # looks at the queue until a job that left it without outcome.json has failed; files of other nodes appear with a delay
WAITING = ("PENDING", "RUNNING", "COMPLETING", "CONFIGURING", "REQUEUED", "SUSPENDED", "RESIZING", "SIGNALING", "STAGE_OUT", "STOPPED")


def run_on_slurm(settings: Mapping[str, Any], jobs: Sequence[Job], ended: Callable[[Job, Outcome], None]) -> None:
    """Submit the jobs as one SLURM job array, and call `ended` for each job as soon as it has ended.

    settings: keys below hydra.launcher (conf/hydra/launcher/slurm.yaml). Raises BackendError or ConfigError.
    """
    from hydra_plugins.hydra_submitit_launcher.config import BaseQueueConf
    from submitit import AutoExecutor
    from submitit.core.utils import FailedJobError

    poll_s = _poll_s()
    logs = jobs[0].folder.parent / settings["submitit_folder"]
    apart, shared = {"_target_", "submitit_folder", "max_num_timeout"}, set(BaseQueueConf.__dataclass_fields__)
    try:
        executor = AutoExecutor(folder=logs, cluster="slurm", slurm_max_num_timeout=settings["max_num_timeout"])
        executor.update_parameters(**{key if key in shared else f"slurm_{key}": settings[key] for key in settings if key not in apart})
        submitted = executor.map_array(run, list(jobs))
    except (RuntimeError, FailedJobError) as error:
        reason = one_line(error)[-300:]
        raise BackendError(f"hydra/launcher=slurm: {reason}; run it where sbatch works, or choose another launcher") from error
    array = submitted[0].job_id.partition("_")[0]
    print(f"slurm: {plural(len(jobs), 'job')} submitted as {array}; scancel {array} stops them", flush=True)
    _wait(array, {sent.job_id: job for sent, job in zip(submitted, jobs, strict=True)}, poll_s, logs, ended)


def _wait(array: str, jobs: dict[str, Job], poll_s: float, logs: Path, ended: Callable[[Job, Outcome], None]) -> None:
    """Wait until each job of the SLURM array has ended. A job that left the SLURM queue without writing outcome.json has failed."""
    gone_since = dict[str, float]()
    while jobs:
        for number, job in list(jobs.items()):
            if outcome := Outcome.read(job.folder):
                del jobs[number]
                ended(job, outcome)
        states = queue_states(array) if jobs else {}
        for number, job in list(jobs.items()):
            state = states.get(number, "") if states is not None else None
            if state is None or state in WAITING:
                gone_since.pop(number, None)
            elif time.monotonic() - gone_since.setdefault(number, time.monotonic()) >= GRACE * poll_s:
                reason = f"SLURM job {number} ended {state or 'and left the queue'} without a result"
                job.lost(reason, Path(str(logs).replace("%j", number)) / f"{number}_0_log.err")
        if jobs:
            time.sleep(poll_s)


def queue_states(array: str) -> dict[str, str] | None:
    """Return the states of a SLURM array's queued jobs by job id, such as {"12_3": "RUNNING"}; None if SLURM does not answer."""
    command = ["squeue", "--noheader", "--array", "--states=all", f"--jobs={array}", "--format=%i %T"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and "Invalid job id" not in done.stderr:
        return None
    return dict(line.split()[:2] for line in done.stdout.splitlines() if len(line.split()) >= 2) if not done.returncode else {}


def _poll_s() -> float:
    text = os.environ.get("RADARTWIN_SLURM_POLL", str(POLL_S))
    with contextlib.suppress(ValueError):
        if 0 < float(text) < math.inf:
            return float(text)
    raise ConfigError(f"RADARTWIN_SLURM_POLL={text} is not a number of seconds above zero; correct it or unset it")
