"""`radartwin run` computes a user's own experiment once and tracks it once, resumes interrupted sweeps, and stores no secret."""

from __future__ import annotations

import json
import signal
import sqlite3
import sys
import time
from contextlib import closing
from pathlib import Path

import own_experiment
import pytest
from processes import descendants, runs, started, wait_until

# SQLAlchemy warns about a loader that mlflow uses.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")

CONF, OUTPUT = "my [conf],x=1", "out[B]=x,y\\ ${z}'"
SECRET = "s3cr3t-w0rd-of-the-test"


@pytest.fixture
def own(here: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return arguments that run a user's experiment. The names of its folders contain characters that have a meaning in Hydra overrides."""
    arguments, environment = own_experiment.write(here / CONF)
    monkeypatch.setenv("OWN_EXPERIMENT", environment["OWN_EXPERIMENT"])
    return [*arguments[:-1], CONF, "--output", str(here / OUTPUT)]


def query(folder: Path, statement: str) -> list[tuple]:
    with closing(sqlite3.connect(folder / OUTPUT / "mlflow.db")) as connection:
        return connection.execute(statement).fetchall()


def test_a_run_is_computed_once_and_tracked_once(inside, own: list[str], here: Path) -> None:
    (here / CONF / "DRAW").touch()
    first = inside(*own, "seed=4", "tracking=off")
    assert "simulated 1, reused 0, scored 1" in first.stdout, first.stderr
    for _ in range(2):
        assert "simulated 0, reused 1, scored 0" in inside(*own, "seed=4").stdout
    (result,) = (here / OUTPUT / "cache" / "run").glob("*/result.json")
    assert json.loads(result.read_text())["rows"][0]["value"] == 0.004
    (line,) = [line for line in first.stdout.splitlines() if line.startswith("table: ")]
    assert ",0.004," in Path(line.removeprefix("table: ")).read_text()
    assert {p.name for p in (result.parent / "figures").iterdir()} == {"curve.png", "curve.pdf"}
    assert list((here / OUTPUT).rglob("*.tmp")) == []
    (stored,) = query(here, "SELECT status, value FROM runs JOIN metrics USING (run_uuid) WHERE key = 'correlation'")
    assert stored == ("FINISHED", 0.004)
    (product,) = (here / OUTPUT / "cache" / "recording").iterdir()
    assert query(here, "SELECT name, digest FROM datasets") == [("recording", product.name)]
    (table,) = (here / OUTPUT / "mlflow-artifacts").rglob("table.csv")
    assert f"{product.name},correlation,0.42,0.004,0.0,1.0,3,testbed,holds" in table.read_text()


def test_a_sweep_survives_a_refused_and_a_failed_job_and_resumes(inside, own: list[str], here: Path) -> None:
    for name in ("REFUSE_1", "BREAK_13"):
        (here / CONF / name).touch()
    swept = inside(*own, "-m", "seed=1,2,3")
    assert swept.returncode == 2
    assert "refused  seed=1: there are no recorded answers" in swept.stdout
    assert "done     seed=2" in swept.stdout
    assert "sweep: 2 done, 0 cached, 0 failed, 1 refused" in swept.stdout
    assert "Traceback" not in swept.stderr
    again = inside(*own, "-m", "materials=uniform,void", "seed=2,13")
    assert again.returncode == 1
    assert "sweep: 1 done, 1 cached, 2 failed, 0 refused" in again.stdout
    assert "the solver broke" in again.stderr
    children = query(here, "SELECT count(*) FROM tags WHERE key = 'mlflow.parentRunId' AND value IN (SELECT run_uuid FROM runs)")
    assert children == [(6,)], "three jobs of the first sweep, and the new one and the two failed ones of the second"
    assert {path.name for path in here.iterdir()} == {CONF, OUTPUT}


def test_an_interrupted_sweep_is_recorded_as_killed(inside, own: list[str], here: Path) -> None:
    (here / CONF / "STOP_14").touch()
    done = inside(*own, "-m", "seed=14,15")
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1].startswith("radartwin: interrupted")
    assert query(here, "SELECT DISTINCT status FROM runs") == [("KILLED",)]


WORKING = """
import time, warnings
from pathlib import Path
from radartwin.runs import workers


def run(config, store, progress):
    workers.each(work, [(number,) for number in range(4)], 2)


def work(number):
    warnings.warn("glass stands in\\nfor ice")
    Path(f"{number}.started").touch()
    time.sleep(600)
"""


def test_a_closed_terminal_ends_a_run_and_its_workers_as_ctrl_c_does(own: list[str], here: Path) -> None:
    next(here.glob("*/my_experiment.py")).write_text(WORKING)
    process = started([sys.executable, "-m", "radartwin", *own], here)
    wait_until(lambda: len(list(here.glob("*.started"))) == 2 or process.poll() is not None)
    begun = descendants(process.pid)
    process.send_signal(signal.SIGHUP)
    start = time.monotonic()
    said, complained = process.communicate(timeout=60)
    assert time.monotonic() - start < 30
    assert (process.returncode, said) == (128 + signal.SIGHUP, "")
    warned, interrupted = "radartwin: warning: glass stands in for ice", "radartwin: interrupted; the same command resumes where it stopped"
    assert complained.splitlines() == [warned, warned, interrupted]
    wait_until(lambda: not any(map(runs, begun)), 10)
    assert query(here, "SELECT DISTINCT status FROM runs") == [("KILLED",)]


def test_a_sweep_writes_no_secret_of_the_environment(inside, own: list[str], here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / CONF / "BREAK_13").touch()
    for name in ("RADARTWIN_VLM_KEY", "MLFLOW_TRACKING_USERNAME", "MLFLOW_TRACKING_PASSWORD"):
        monkeypatch.setenv(name, SECRET)
    done = inside(*own, "-m", "seed=0,13")
    assert "sweep: 1 done, 0 cached, 1 failed" in done.stdout, done.stderr
    assert SECRET not in done.stdout + done.stderr
    written = [path for path in (here / OUTPUT).rglob("*") if path.is_file()]
    assert len(written) > 8, "a database, a result, logs"
    assert [path for path in written if SECRET.encode() in path.read_bytes()] == []
