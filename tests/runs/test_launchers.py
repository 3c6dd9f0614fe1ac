"""A job whose process is killed fails, and all other jobs keep their results."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.runs import launchers
from radartwin.runs.job import DONE, FAILED, Job, Outcome
from radartwin.runs.launchers import KILLED, Parallel


def run_or_die(job: Job) -> Outcome:
    with (job.folder / "tries").open("a") as tries:
        tries.write("x")
    if job.folder.name == "1":
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(job.name, DONE)


def test_a_killed_job_fails_and_each_job_runs_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launchers, "run", run_or_die)
    jobs = [Job([f"seed={number}"], compose(), tmp_path / str(number)) for number in range(4)]
    for job in jobs:
        job.folder.mkdir()
    outcomes: dict[str, Outcome] = {}
    Parallel(2).run(jobs, lambda job, outcome: outcomes.update({job.folder.name: outcome}))
    assert {number: outcome.status for number, outcome in outcomes.items()} == {"0": DONE, "1": FAILED, "2": DONE, "3": DONE}
    assert outcomes["1"].line == KILLED
    assert Outcome.read(tmp_path / "1") == outcomes["1"]
    assert [len((job.folder / "tries").read_text()) for job in jobs] == [1, 1, 1, 1]


def test_no_process_at_all_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"hydra\.launcher\.n_jobs=0"):
        Parallel(0)
