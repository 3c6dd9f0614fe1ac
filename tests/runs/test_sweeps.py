"""A sweep runs its jobs in worker processes, and its folder tells what it holds. Settings of Hydra without effect are refused by name."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import sys
from pathlib import Path

import own_experiment
import pytest
import yaml
from processes import started, wait_until

from radartwin.config.study import TrackingConfig
from radartwin.errors import ConfigError
from radartwin.runs.checkout import commit
from radartwin.runs.launchers import launcher
from radartwin.runs.tracking import ARTIFACTS, DATABASE, Tracker

# SQLAlchemy warns about a loader that mlflow uses.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")
JOBLIB = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the arguments that run a user's experiment with a row for each seed."""
    arguments, environment = own_experiment.write(tmp_path / "mine")
    monkeypatch.setenv("OWN_EXPERIMENT", environment["OWN_EXPERIMENT"])
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", ""))
    monkeypatch.setattr(sys, "path", list(sys.path))
    sys.modules.pop("my_experiment", None)  # of another test
    return [*arguments, "--output", str(tmp_path / "out")]


WORKERS = """
import os
from radartwin.runs import workers
from radartwin.runs.experiment import Result


def run(config, store, progress):
    with progress.task("recordings simulated", 4) as done:
        workers.each(simulate, [(config.seed, number) for number in range(4)], 2, done)
    return Result("mine", [])


def simulate(seed, number):
    if seed == 7:
        os._exit(3)
"""


def test_parallel_jobs_simulate_in_workers_of_their_own_and_a_crash_there_is_a_failure(inside, own: list[str], tmp_path: Path) -> None:
    (tmp_path / "mine" / "my_experiment.py").write_text(WORKERS)
    done = inside(*own, "-m", "tracking=off", "jobs=2", *JOBLIB, "seed=6,7")
    assert "sweep: 1 done, 0 cached, 1 failed, 0 refused" in done.stdout, done.stderr
    assert done.returncode == 1
    assert "Traceback" not in done.stdout
    assert "seed=6: recordings simulated: 4 done" in next(tmp_path.glob("out/sweeps/*/0/log.txt")).read_text()


def test_a_sweep_is_described_in_its_folder_which_the_same_command_uses_again(inside, own: list[str], tmp_path: Path) -> None:
    command = [*own, "-m", "tracking=off", "seed=3,4", "trajectory.height_m=1.0"]
    first = inside(*command)
    assert first.returncode == 0, first.stderr
    (folder,) = (tmp_path / "out" / "sweeps").iterdir()
    described = json.loads((folder / "sweep.json").read_text())
    assert folder.name.startswith("mine_")
    assert described["experiment"] == "mine"
    assert "radartwin run -m experiment=mine" in described["command"]
    assert (described["git_commit"], described["dirty"]) == commit()
    rows = list(csv.DictReader((folder / "jobs.csv").read_text().splitlines()))
    assert [(row["job"], row["experiment"], row["seed"], row["trajectory.height_m"]) for row in rows] == [
        ("0", "mine", "3", "1.0"),
        ("1", "mine", "4", "1.0"),
    ]
    for row in rows:
        assert (Path(row["result"]) / "table.csv").read_text().startswith("run_keys,metric,")
        assert Path(row["result"]).name == row["run_key"]
    assert "sweep: 0 done, 2 cached" in inside(*command).stdout
    assert inside(*own, "-m", "tracking=off", "seed=3,4").returncode == 0
    assert len(list((tmp_path / "out" / "sweeps").iterdir())) == 2
    chosen = [*own, "-m", "tracking=off", "hydra.sweep.dir=${output}/chosen"]
    assert inside(*chosen, "seed=3,4").returncode == 0
    assert (tmp_path / "out" / "chosen" / "jobs.csv").is_file()
    assert "holds another sweep" in inside(*chosen, "seed=5,6").stderr


@pytest.mark.parametrize(
    ("setting", "sweep"),
    [
        ("hydra.sweep.subdir=x", ["-m"]), ("hydra.job.chdir=true", ["-m"]), ("hydra.run.dir=x", []), ("hydra.launcher.verbose=10", []),
        ("hydra/launcher=submitit_local", ["-m"]), ("hydra/launcher=submitit_local", []),
    ],
)  # fmt: skip
def test_a_setting_of_hydra_without_effect_is_refused_by_name(
    setting: str, sweep: list[str], inside, own: list[str], tmp_path: Path
) -> None:
    done = inside(*own, *sweep, "hydra/launcher=joblib", "seed=3", setting)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert setting.partition("=")[0] in done.stderr
    assert not (tmp_path / "out").exists()


def test_an_experiment_file_chooses_the_launcher_and_may_not_change_the_folder_of_jobs(inside, own: list[str], tmp_path: Path) -> None:
    file = tmp_path / "mine" / "experiment" / "mine.yaml"
    launcher = "defaults:\n  - override /hydra/launcher: joblib\n"
    file.write_text(own_experiment.YAML.replace("experiment:", f"{launcher}experiment:") + "hydra:\n  launcher:\n    n_jobs: 2\n")
    (tmp_path / "mine" / "KILL_3").touch()
    done = inside(*own, "-m", "tracking=off", "seed=3,4")
    assert "its process was killed" in done.stdout, done.stderr
    assert "sweep: 1 done, 0 cached, 1 failed" in done.stdout
    file.write_text(own_experiment.YAML + "hydra:\n  job:\n    chdir: true\n")
    assert "hydra.job.chdir=True is refused" in inside(*own, "seed=3").stderr


def test_no_process_at_all_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"hydra\.launcher\.n_jobs=0"):
        launcher("joblib", {"n_jobs": 0})


def test_the_composed_configuration_is_printed_without_a_run(inside, own: list[str], tmp_path: Path) -> None:
    done = inside(*own, "seed=3", "--cfg", "job")
    assert done.returncode == 0, done.stderr
    assert yaml.safe_load(done.stdout)["seed"] == 3
    assert yaml.safe_load(done.stdout)["experiment"]["name"] == "mine"
    assert not (tmp_path / "out").exists()
    assert "leave -m out" in inside(*own, "-m", "seed=3,4", "--cfg", "job").stderr


def test_a_terminated_sweep_has_the_status_that_shells_expect(own: list[str], tmp_path: Path) -> None:
    (tmp_path / "mine" / "HOLD_3").touch()
    run = started([sys.executable, "-m", "radartwin", *own, "-m", "tracking=off", "seed=3"], tmp_path)
    wait_until(lambda: list(tmp_path.glob("out/sweeps/*/0/log.txt")) or run.poll() is not None)
    run.send_signal(signal.SIGTERM)
    complained = run.communicate(timeout=60)[1]
    assert run.returncode == 128 + signal.SIGTERM, complained


def test_a_copied_output_folder_keeps_its_artifacts_to_itself(tmp_path: Path) -> None:
    def track(output: Path, key: str) -> None:
        note = tmp_path / "note.txt"
        note.write_text(key)
        with Tracker(TrackingConfig(), output).run("environment", key * 32, "x", {}) as record:
            record.artifacts = [note]

    first, copy = tmp_path / "first", tmp_path / "copy"
    track(first, "a")
    shutil.copytree(first, copy)
    track(copy, "b")
    assert sorted(path.read_text() for path in (first / ARTIFACTS).rglob("note.txt")) == ["a"]
    assert sorted(path.read_text() for path in (copy / ARTIFACTS).rglob("note.txt")) == ["a", "b"]
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{copy / DATABASE}")
    table = client.get_experiment_by_name("environment")
    assert table is not None
    uris = {str(run.info.artifact_uri) for run in client.search_runs([table.experiment_id])}
    assert all(uri.startswith((copy / ARTIFACTS).as_uri()) for uri in uris)
