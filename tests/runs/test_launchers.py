"""A job that no launcher could finish fails with a reason that names the cause."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace

import pytest

from radartwin.runs.job import FAILED, STARTED, Outcome
from radartwin.runs.launchers import Launcher

KILLED = "its process was killed 3 times (memory ran out, or another program ended it)"


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (None, KILLED),
        (BrokenProcessPool("A worker process was unexpectedly terminated."), KILLED),
        (
            BrokenProcessPool("A task has failed to un-serialize."),
            "the launcher failed 3 times: BrokenProcessPool: A task has failed to un-",
        ),
        (pickle.PicklingError("cannot pickle\nthe hook"), "the launcher failed 3 times: PicklingError: cannot pickle the hook"),
    ],
)
def test_a_job_that_no_launch_finishes_fails_with_the_cause(error: Exception | None, reason: str, tmp_path: Path) -> None:
    said: list[str] = []
    launcher = Launcher([], (), tmp_path, said.append)

    def launch(jobs: Sequence[Sequence[str]], initial_job_idx: int) -> None:
        (tmp_path / "0" / STARTED).touch()
        if error:
            raise error

    launcher._plugin = SimpleNamespace(launch=launch)
    launcher.run({0: ["seed=0"]}, 1)
    outcome = Outcome.read(tmp_path / "0")
    assert outcome
    assert outcome.status == FAILED
    assert outcome.line.startswith(reason)
    assert len(said) == 1


def test_an_error_before_any_job_starts_is_raised(tmp_path: Path) -> None:
    def launch(jobs: Sequence[Sequence[str]], initial_job_idx: int) -> None:
        raise pickle.PicklingError("cannot pickle the hook")

    launcher = Launcher([], (), tmp_path)
    launcher._plugin = SimpleNamespace(launch=launch)
    with pytest.raises(pickle.PicklingError):
        launcher.run({0: ["seed=0"]}, 1)
