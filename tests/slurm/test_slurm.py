"""On a real SLURM cluster, a parameter sweep loses only the cancelled job, resumes, and gives the same table as a sweep without SLURM."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import own_experiment
import pytest
from cluster import cluster, missing
from processes import started

pytestmark = pytest.mark.slow
SEEDS = "seed=0,1,2,3,4"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    if absent := missing():
        pytest.skip(f"SLURM is not installed here ({absent[0]} is missing); make test-slurm installs it")
    with cluster(tmp_path_factory.mktemp("slurm") / "cluster") as found:
        yield {**found, "RADARTWIN_SLURM_POLL": "0.5"}


def radartwin(arguments: list[str], environment: dict[str, str], output: Path) -> subprocess.Popen[str]:
    return started([sys.executable, "-m", "radartwin", *arguments, "--output", str(output)], output.parent, **environment)


def queue(environment: dict[str, str]) -> dict[str, str]:
    """Return {job number: state} for the jobs of the SLURM job array."""
    command = ["squeue", "-h", "-r", "-o", "%K %T"]
    lines = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()
    return dict(line.split() for line in lines)


def outcomes(output: Path) -> int:
    return len(list((output / "sweeps").glob("*/*/outcome.json")))


def test_a_sweep_loses_only_the_cancelled_job_and_resumes_to_the_serial_table(environment, tmp_path: Path) -> None:
    arguments, own = own_experiment.write(tmp_path / "mine")
    environment = {**environment, **own}
    serial = radartwin([*arguments, "-m", SEEDS], environment, tmp_path / "serial")
    assert "sweep: 5 done" in serial.communicate(timeout=300)[0]

    held = tmp_path / "mine" / "HOLD_3"
    held.touch()
    on_slurm = [*arguments, "-m", "hydra/launcher=slurm", "hydra.launcher.cpus_per_task=1", SEEDS]
    first = radartwin(on_slurm, environment, tmp_path / "cluster")
    end = time.monotonic() + 300
    while outcomes(tmp_path / "cluster") < 4 or queue(environment) != {"3": "RUNNING"}:
        assert time.monotonic() < end, f"queue {queue(environment)}, {outcomes(tmp_path / 'cluster')} outcomes"
        assert first.poll() is None, first.communicate()
        time.sleep(0.5)
    ids = subprocess.run(["squeue", "-h", "-r", "-o", "%i"], env=environment, capture_output=True, text=True, check=True).stdout.split()
    subprocess.run(["scancel", *ids], env=environment, check=True)
    said, complained = first.communicate(timeout=120)
    assert first.returncode == 1, complained
    assert "sweep: 4 done, 0 cached, 1 failed" in said
    assert f"SLURM job {ids[0]} ended CANCELLED without a result" in said
    held.unlink()

    second = radartwin(on_slurm, environment, tmp_path / "cluster")
    said, complained = second.communicate(timeout=300)
    assert second.returncode == 0, complained
    assert "sweep: 1 done, 4 cached, 0 failed" in said
    (expected,), (resumed,) = own_experiment.tables(tmp_path / "serial"), own_experiment.tables(tmp_path / "cluster")
    assert own_experiment.same(resumed) == own_experiment.same(expected)
    assert queue(environment) == {}


def test_a_refused_submission_prints_one_line(environment, tmp_path: Path) -> None:
    arguments, own = own_experiment.write(tmp_path / "mine")
    refused = radartwin(
        [*arguments, "-m", "hydra/launcher=slurm", "hydra.launcher.partition=absent", "seed=0,1"], {**environment, **own}, tmp_path / "out"
    )
    complained = refused.communicate(timeout=120)[1]
    assert refused.returncode == 2
    assert complained.splitlines()[-1].startswith("radartwin: hydra/launcher=slurm: ")
    assert "partition" in complained
    assert "Traceback" not in complained
    assert os.listdir(tmp_path / "out" / "cache") == []
