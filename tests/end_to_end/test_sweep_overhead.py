"""The overhead of a sweep per job: composing, the key, tracking and the outcome's files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import own_experiment
import pytest

from radartwin.runs.job import OUTCOME

MOST_S = 0.3  # per job in a worker that is warm


@pytest.mark.slow
@pytest.mark.parametrize("launcher", [("hydra/launcher=basic",), ("hydra/launcher=joblib", "hydra.launcher.n_jobs=1")])
def test_overhead_per_job_is_small_in_a_warm_worker(tmp_path: Path, launcher: tuple[str, ...]) -> None:
    arguments, own = own_experiment.write(tmp_path / "mine")
    command = [sys.executable, "-m", "radartwin", *arguments, "-m", *launcher, "seed=range(60)", "--output", str(tmp_path / "out")]
    done = subprocess.run(command, env={**os.environ, **own}, capture_output=True, text=True, timeout=500, check=False)
    assert "sweep: 60 done" in done.stdout, done.stderr
    ended = sorted(path.stat().st_mtime for path in (tmp_path / "out" / "sweeps").glob(f"*/*/{OUTCOME}"))
    between = np.diff(ended)[10:]  # the first ones warm up
    print(f"{launcher[0]}: {np.median(between):.3f} s a job, {between.min():.3f} to {between.max():.3f}")
    assert np.median(between) <= MOST_S
