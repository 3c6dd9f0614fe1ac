"""`radartwin run` computes a user's own experiment once, resumes sweeps, and refuses wrong input in one line."""

from __future__ import annotations

import json
import sqlite3
import subprocess
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

Command = Callable[..., subprocess.CompletedProcess[str]]

EXPERIMENT = """
import numpy as np

from radartwin.plotting import style
from radartwin.errors import MissingError
from radartwin.runs.experiment import Result
from radartwin.store.products import save_arrays


def run(config, store, progress):
    if config.materials.source == "vlm":
        raise MissingError("materials=vlm has no recorded answers")
    if config.seed == 13:
        raise RuntimeError("the solver broke")
    spec = {"materials": config.materials}
    product = store.fetch("recording", spec, ["radartwin.constants"], lambda f: save_arrays(f, {"iq": np.ones(3)}))
    row = {
        "distance_m": 1.0, "run_keys": product.key, "metric": "correlation", "paper": "0.42", "value": 0.4,
        "low": 0.1, "high": 0.9, "n": 3, "domain": "testbed", "verdict": "holds",
    }
    return Result("mine", [row], {"curve": draw}, {"correlation_1m": row["value"]}, [product.key])


def draw():
    figure, axes = style.figure()
    axes.plot([0, 1], [1, 0])
    return figure
"""
YAML = "# @package _global_\nexperiment:\n  name: mine\n  module: my_experiment\n"


@pytest.fixture
def own(tmp_path: Path) -> list[str]:
    """Arguments that run a user's experiment from a folder outside the checkout."""
    folder = tmp_path / "mine" / "experiment"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text(YAML)
    (folder.parent / "my_experiment.py").write_text(EXPERIMENT)
    return ["run", "experiment=mine", "--config-dir", "mine"]


def test_a_run_is_computed_once_and_read_back(radartwin: Command, own: list[str], tmp_path: Path) -> None:
    first, second = radartwin(*own), radartwin(*own)
    assert first.returncode == second.returncode == 0, first.stderr
    assert "simulated 1, reused 0, scored 1" in first.stdout
    assert "simulated 0, reused 1, scored 0" in second.stdout
    results = list((tmp_path / "outputs" / "cache" / "run").glob("*/result.json"))
    assert len(results) == 1
    assert json.loads(results[0].read_text())["rows"][0]["value"] == 0.4
    assert {p.name for p in (results[0].parent / "figures").iterdir()} == {"curve.png", "curve.pdf", "curve.html"}
    assert list((tmp_path / "outputs").rglob("*.tmp")) == []


def test_a_run_is_tracked_with_its_table_and_its_input_data(radartwin: Command, own: list[str], tmp_path: Path) -> None:
    assert radartwin(*own).returncode == 0
    ((key,),) = [(path.name,) for path in (tmp_path / "outputs" / "cache" / "recording").iterdir()]
    with closing(sqlite3.connect(tmp_path / "outputs" / "mlflow.db")) as connection:
        assert connection.execute("SELECT name, digest FROM datasets").fetchall() == [("recording", key)]
    (table,) = (tmp_path / "outputs" / "mlflow-artifacts").rglob("table.csv")
    assert f"1.0,{key},correlation,0.42,0.4,0.1,0.9,3,testbed,holds" in table.read_text()


def test_a_result_computed_without_tracking_is_tracked_once_later(radartwin: Command, own: list[str], tmp_path: Path) -> None:
    assert radartwin(*own, "tracking=off").returncode == 0
    for _ in range(2):
        assert "scored 0" in radartwin(*own).stdout
    with closing(sqlite3.connect(tmp_path / "outputs" / "mlflow.db")) as connection:
        tracked = connection.execute("SELECT status, key, value FROM runs JOIN metrics USING (run_uuid)").fetchall()
    assert tracked == [("FINISHED", "correlation_1m", 0.4)]


def test_an_interrupted_sweep_is_recorded_as_killed(radartwin: Command, own: list[str], tmp_path: Path) -> None:
    module = tmp_path / "mine" / "my_experiment.py"
    module.write_text("def run(config, store, progress):\n    raise KeyboardInterrupt\n")
    done = radartwin(*own, "-m", "seed=0,1")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("radartwin: interrupted")
    with closing(sqlite3.connect(tmp_path / "outputs" / "mlflow.db")) as connection:
        assert connection.execute("SELECT DISTINCT status FROM runs").fetchall() == [("KILLED",)]


def test_a_sweep_survives_a_refused_and_a_failed_job_and_resumes(radartwin: Command, own: list[str], tmp_path: Path) -> None:
    swept = radartwin(*own, "-m", "materials=vlm,uniform,void")
    assert swept.returncode == 2
    assert "refused  materials=vlm: materials=vlm has no recorded answers" in swept.stdout
    assert "done     materials=uniform" in swept.stdout
    assert "sweep: 2 done, 0 cached, 0 failed, 1 refused" in swept.stdout
    assert "Traceback" not in swept.stderr
    again = radartwin(*own, "-m", "materials=uniform,void", "seed=0,13")
    assert again.returncode == 1
    assert "sweep: 0 done, 2 cached, 2 failed, 0 refused" in again.stdout
    assert "materials=void,seed=0: run" in again.stdout
    assert "the solver broke" in again.stderr
    with closing(sqlite3.connect(tmp_path / "outputs" / "mlflow.db")) as connection:
        children = connection.execute(
            "SELECT count(*) FROM tags WHERE key = 'mlflow.parentRunId' AND value IN (SELECT run_uuid FROM runs)"
        ).fetchone()
    assert children == (5,), "three jobs of the first sweep and the two failed ones of the second"


def test_a_sweep_with_a_wrong_value_starts_no_job(radartwin: Command, own: list[str], tmp_path: Path) -> None:
    swept = radartwin(*own, "-m", "materials=uniform,steel")
    assert swept.returncode == 2
    assert swept.stdout == ""
    assert len(swept.stderr.splitlines()) == 1
    assert "materials=steel" in swept.stderr
    assert not (tmp_path / "outputs").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["run", "experiment=environmnt"], "did you mean environment"),
        (["run"], "experiment=NAME"),
        (["run", "experiment=environment", "-m", "scene=lab,labb"], "scene=labb"),
        (["simulate", "scene=plate", "radar.num_chirps=x"], "radar.num_chirps"),
        (["simulate", "scene=scan", "scene.path=absent.glb"], "absent.glb"),
        (["simulate", "scene=plate", "trajectory=static", "output=file/below"], "file"),
        (["simulate", "scene=plate", "trajectory=static", "materials.material=cheese", "scene=lab"], "cheese"),
        (["process", "absent"], "absent"),
        (["tables", "--only", "nonsense"], "nonsense"),
        (["report"], "run radartwin tables first"),
    ],
)
def test_wrong_input_prints_one_line_and_exits_with_status_two(radartwin: Command, arguments: list[str], word: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = radartwin(*arguments)
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("radartwin: ")
    assert word in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["file"], "a partial file is left"


def test_a_sweep_takes_folders_of_any_name(radartwin: Command, own: list[str], tmp_path: Path) -> None:
    (tmp_path / "mine").rename(tmp_path / "my [conf],x=1")
    output = tmp_path / "out[B]=x,y\\ ${z}'"
    arguments = ["run", "experiment=mine", "--config-dir", "my [conf],x=1", "--output", str(output), "tracking=off"]
    swept = radartwin(*arguments, "-m", "materials=uniform,void")
    assert "sweep: 2 done" in swept.stdout, swept.stderr
    assert len(list((output / "cache" / "run").iterdir())) == 2
    assert [p.name for p in tmp_path.iterdir() if p.name not in ("my [conf],x=1", output.name)] == []
