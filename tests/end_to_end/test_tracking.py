"""MLflow tracking in a real SQLite store is complete after a run, works with concurrent processes and prints nothing."""

from __future__ import annotations

import hashlib
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from radartwin.config.study import TrackingConfig
from radartwin.errors import BackendError, ConfigError, OutputError
from radartwin.runs.dashboard import dashboard
from radartwin.runs.tracking import ARTIFACTS, DATABASE, Tracker

# SQLAlchemy warns about a loader that mlflow uses.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")


def query(output: Path, statement: str) -> list[tuple]:
    """Return the rows that an SQL statement selects from the tracking database, read without mlflow."""
    with closing(sqlite3.connect(output / DATABASE)) as connection:
        return connection.execute(statement).fetchall()


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an output folder that tracks a finished run, a failed run and a sweep with one job."""
    folder = tmp_path_factory.mktemp("tracked")
    tracker = Tracker(TrackingConfig(), folder)
    artifact = folder / "result.json"
    artifact.write_text("{}")
    with tracker.run("environment", "a" * 32, "void", {"materials": "void"}, "The room.") as record:
        record.metrics = {"correlation_2m": 0.42}
        record.artifacts = [artifact]
        record.inputs = {"campaign": ["d" * 32, "e" * 32], "recordings": ["f" * 64]}
    with pytest.raises(RuntimeError), tracker.run("environment", "b" * 32, "x", {}):
        raise RuntimeError("solver")
    parent = tracker.sweep("environment", "materials=void,uniform", "1" * 32)
    with Tracker(TrackingConfig(parent_run_id=parent), folder).run("environment", "c" * 32, "y", {}):
        pass
    jobs = folder / "jobs.csv"
    jobs.write_text("job,status\n")
    tracker.end_sweep(parent, "FINISHED", jobs)
    return folder


def test_a_run_is_recorded_with_its_metrics_tags_artifacts_and_digests_of_its_input(output: Path) -> None:
    ((run_id, status, artifacts),) = query(output, "SELECT run_uuid, status, artifact_uri FROM runs WHERE name = 'void aaaaaaaa'")
    assert status == "FINISHED"
    assert query(output, f"SELECT key, value FROM metrics WHERE run_uuid = '{run_id}'") == [("correlation_2m", 0.42)]
    assert query(output, f"SELECT key, value FROM params WHERE run_uuid = '{run_id}'") == [("materials", "void")]
    tags = dict(query(output, f"SELECT key, value FROM tags WHERE run_uuid = '{run_id}'"))
    assert {"run_key", "table", "git_commit", "dirty"} <= set(tags)
    assert tags["run_key"] == "a" * 32
    assert artifacts.startswith((output / ARTIFACTS).as_uri())
    assert (Path(artifacts.removeprefix("file://")) / "result.json").is_file()
    both = hashlib.sha256(f"{'d' * 32} {'e' * 32}".encode()).hexdigest()[:32]
    rows = query(output, "SELECT name, digest, dataset_profile FROM datasets ORDER BY name")
    assert rows == [("campaign", both, '{"products": 2}'), ("recordings", "f" * 32, '{"products": 1}')]
    assert query(output, "SELECT value FROM experiment_tags WHERE key = 'mlflow.note.content'") == [("The room.",)]
    assert query(output, "SELECT DISTINCT destination_id FROM inputs") == [(run_id,)]


def test_the_parent_run_of_a_sweep_holds_the_table_of_jobs_and_a_link_that_compares_them(output: Path) -> None:
    ((child, parent),) = query(output, "SELECT run_uuid, value FROM tags WHERE key = 'mlflow.parentRunId'")
    assert query(output, "SELECT run_uuid FROM runs WHERE name = 'materials=void,uniform'") == [(parent,)]
    ((note,),) = query(output, "SELECT value FROM tags WHERE key = 'mlflow.note.content'")
    assert f"/compare-runs?runs=%5B%22{child}%22%5D" in note
    assert len(list((output / ARTIFACTS).rglob("jobs.csv"))) == 1


def test_system_metrics_are_sampled_when_they_are_switched_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING", "true")
    monkeypatch.setenv("MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL", "0.05")
    with Tracker(TrackingConfig(), tmp_path).run("environment", "a" * 32, "x", {}) as record:
        record.metrics = {"correlation_2m": 0.42}
        time.sleep(1)
    names = {name for (name,) in query(tmp_path, "SELECT DISTINCT key FROM metrics")}
    assert {"correlation_2m", "system/cpu_utilization_percentage", "system/system_memory_usage_megabytes"} <= names
    steps = query(tmp_path, "SELECT step FROM metrics WHERE key = 'system/cpu_utilization_percentage' ORDER BY step")
    assert len(steps) >= 2
    assert [step for (step,) in steps] == list(range(len(steps)))


def test_a_failed_run_has_its_error_as_a_tag_and_is_not_known(output: Path) -> None:
    rows = query(output, "SELECT status, value FROM runs r JOIN tags t USING (run_uuid) WHERE t.key = 'error'")
    assert rows == [("FAILED", "solver")]
    tracker = Tracker(TrackingConfig(), output)
    assert tracker.known("environment", "a" * 32)
    assert not tracker.known("environment", "b" * 32)


OPENS = """
import sys
from pathlib import Path
import mlflow
from radartwin.config.study import TrackingConfig
from radartwin.runs.tracking import Tracker

print("ready", flush=True)
input()
with Tracker(TrackingConfig(), Path(sys.argv[1])).run("environment", "1" * 32, "1", {"number": "1"}) as record:
    record.metrics = {"number": 1.0}
"""


def test_processes_that_open_a_new_store_at_once_all_track_their_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    import mlflow  # noqa: F401  (in both processes, before either opens the store)

    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    other = subprocess.Popen([sys.executable, "-c", OPENS, str(tmp_path)], **pipes)
    assert other.stdout
    assert other.stdin
    assert other.stdout.readline() == "ready\n"
    other.stdin.write("\n")
    other.stdin.flush()
    with Tracker(TrackingConfig(), tmp_path).run("environment", "0" * 32, "0", {"number": "0"}) as record:
        record.metrics = {"number": 0.0}
    assert other.communicate(timeout=120) == ("", ""), "the process failed, or mlflow talked"
    assert capfd.readouterr() == ("", "")
    assert query(tmp_path, "SELECT value FROM metrics ORDER BY value") == [(0.0,), (1.0,)]
    assert query(tmp_path, "SELECT DISTINCT status FROM runs") == [("FINISHED",)]
    assert {p.name for p in tmp_path.iterdir()} == {DATABASE}, "a lock or temporary file stayed"


def test_tracking_off_writes_nothing(tmp_path: Path) -> None:
    tracker = Tracker(TrackingConfig(backend="off"), tmp_path)
    tracker.prepare()
    with tracker.run("environment", "a" * 32, "x", {}):
        pass
    tracker.end_sweep(tracker.sweep("environment", "x", "1" * 32), "FINISHED")
    assert list(tmp_path.iterdir()) == []


def test_the_dashboard_does_not_serve_another_tracking_server(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"http://127\.0\.0\.1:9"):
        dashboard(TrackingConfig(uri="http://127.0.0.1:9"), tmp_path, 5000)


def test_an_unusable_store_is_refused_at_once_and_named(tmp_path: Path) -> None:
    started = time.monotonic()
    (tmp_path / "folder" / DATABASE).mkdir(parents=True)
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / DATABASE).write_text("not a database, but long enough to look like one" * 20)
    (tmp_path / "zeros").mkdir()
    (tmp_path / "zeros" / DATABASE).write_bytes(b"SQLite format 3\0" + bytes(4096))
    (tmp_path / "locked" / f".{DATABASE}.lock").mkdir(parents=True)
    (tmp_path / "file").write_text("")
    cases = {
        "folder": "not a file",
        "text": "not a database",
        "zeros": "move the store away",
        "locked": "this lock file cannot be used",
        "file": "not a folder",
        "a?b": "'\\?'",
        "a#b": "'#'",
    }
    for name, reason in cases.items():
        with pytest.raises((BackendError, OutputError), match=reason):
            Tracker(TrackingConfig(), tmp_path / name)
    with pytest.raises(BackendError, match=r"127\.0\.0\.1:9"):
        Tracker(TrackingConfig(uri="http://127.0.0.1:9"), tmp_path).prepare()
    assert time.monotonic() - started < 20
