"""Track runs in MLflow, either in an SQLite database in the output folder or on an MLflow server.

Processes that create the database at once damage it, and of two that write at once one fails. Therefore one file lock protects it, which a
run holds twice for a short time: to create the run, and to end it with all metrics, tags and datasets.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import socket
import sqlite3
import time
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from radartwin.config.study import TrackingConfig
from radartwin.errors import BackendError, OutputError, UserError
from radartwin.io import files
from radartwin.io.secret import hidden
from radartwin.runs import artifacts
from radartwin.runs.artifacts import Record
from radartwin.runs.experiment import MODELS

if TYPE_CHECKING:
    from mlflow import MlflowClient

DATABASE, ARTIFACTS = "mlflow.db", "mlflow-artifacts"
KIND = {"mlflow.experimentKind": "custom_model_development"}  # with this tag, MLflow's experiment page opens on the table of runs
DESCRIPTION = "mlflow.note.content"  # tag with the text that MLflow shows as the description of an experiment or run
PARENT = "mlflow.parentRunId"  # tag with the id of the sweep's run
PROCESS = "process"  # name of the tag that holds the host name and process id of the process that computes the run
COMPARED = 100  # largest number of jobs in the comparison link of a sweep's parent run
MAX_METRICS = 40  # largest number of metrics per run; a run has about thirty numbers, and its curves and tables are artifacts


class Tracker:
    """Tracks the runs of one output folder in MLflow, or does nothing if tracking is off. The method `prepare` opens the database.

    Raises:
        BackendError, OutputError: the SQLite database cannot be opened or created.
    """

    def __init__(self, config: TrackingConfig, output: Path) -> None:
        self.off = config.backend == "off"
        self.uri = config.uri or f"sqlite:///{(Path(output).absolute() / DATABASE).as_posix()}"
        self.parent_run_id = config.parent_run_id
        self._database = Path(self.uri.removeprefix("sqlite:///")) if self.uri.startswith("sqlite:///") else None
        self._client: MlflowClient | None = None
        if self._database and not self.off:
            _check_database(self._database)
            files.drop_stale(self._lock)

    @property
    def artifacts(self) -> str | None:
        """Return the URI of the folder for artifacts beside an SQLite database; None if runs are tracked on a server."""
        return (self._database.absolute().parent / ARTIFACTS).as_uri() if self._database else None

    @property
    def exists(self) -> bool:
        """Return whether there is a database of runs, or a server."""
        return self._database is None or self._database.is_file()

    @property
    def _lock(self) -> Path:
        assert self._database is not None
        return self._database.with_name(f".{self._database.name}.lock")

    def prepare(self) -> None:
        """Create or open MLflow's database. The parent process of a sweep calls this method before the sweep's jobs start."""
        if not self.off:
            with self._visit():
                pass

    @contextlib.contextmanager
    def run(self, table: str, key: str, name: str, params: Mapping[str, str], text: str = "") -> Iterator[Record]:
        """Within the `with` block, track one run in MLflow. Yield the record that the caller fills with the data to log.

        If an error leaves the block, the MLflow run is marked as failed. An unfinished run with the same key must have been killed, so it
        is marked as killed.

        Args:
            table: name of the result table and of the MLflow experiment, which has the description `text`.
            key: run key, stored as a tag; its first characters follow `name` in the name of the MLflow run.
            params: configuration values of the run that MLflow shows, by name.
        """
        record = Record()
        if self.off:
            yield record
            return
        with self._visit() as client:
            experiment_id = self._experiment(client, table)
            if text:
                client.set_experiment_tag(experiment_id, DESCRIPTION, text)
            for run in _of_key(client, experiment_id, key):
                if run.info.status == "RUNNING":
                    client.set_terminated(run.info.run_id, "KILLED")
            tags = {**artifacts.tags(table, key), PROCESS: f"{socket.gethostname()}:{os.getpid()}"}
            if self.parent_run_id:
                tags[PARENT] = self.parent_run_id
            record.run_id = client.create_run(experiment_id, run_name=f"{name} {key[:8]}", tags=tags).info.run_id
        began, clock = int(time.time() * 1000), time.monotonic()
        status, error = "FINISHED", ""
        try:
            yield record
        except BaseException as raised:
            status, error = "KILLED" if isinstance(raised, KeyboardInterrupt | SystemExit) else "FAILED", hidden(str(raised))[:500]
            raise
        finally:
            ended = began + int((time.monotonic() - clock) * 1000)  # the monotonic clock is not affected if the system time is changed
            try:
                self._end(record, params, status, error, ended)
            except (BackendError, OutputError) as lost:
                warnings.warn(f"run {key[:8]} is not complete in MLflow: {lost}; its result is kept", stacklevel=1)

    def sweep(self, table: str, name: str, sweep_key: str) -> str | None:
        """Open the parent run of a sweep in MLflow and return its id; None if tracking is off. A resumed sweep continues its parent run."""
        if self.off:
            return None
        with self._visit() as client:
            experiment_id = self._experiment(client, table)
            before = client.search_runs([experiment_id], filter_string=f"tags.`sweep_key` = '{sweep_key}'", max_results=1)
            if before:
                client.update_run(before[0].info.run_id, status="RUNNING")
                return before[0].info.run_id
            tags = {**artifacts.tags(table, "sweep"), "sweep_key": sweep_key}
            return client.create_run(experiment_id, run_name=name, tags=tags).info.run_id

    def end_sweep(self, run_id: str | None, status: Literal["FINISHED", "FAILED", "KILLED"], table: Path | None = None) -> None:
        """End a sweep's parent run with the table of its jobs and a link that compares them. An error only causes a warning."""
        if run_id is None:
            return
        try:
            with self._visit() as client:
                experiment_id = client.get_run(run_id).info.experiment_id
                children = client.search_runs([experiment_id], f"tags.`{PARENT}` = '{run_id}'", max_results=COMPARED)
                if children:
                    client.set_tag(run_id, DESCRIPTION, artifacts.comparison(experiment_id, [c.info.run_id for c in children]))
                if table:
                    client.log_artifact(run_id, str(table))
                client.set_terminated(run_id, status)
        except (BackendError, OutputError) as lost:
            warnings.warn(f"the sweep is not complete in MLflow: {lost}; its runs are kept", stacklevel=1)

    def known(self, table: str, key: str) -> bool:
        """Return whether MLflow holds a finished run with this run key, or a running process on this machine computes this run."""
        if self.off:
            return True
        with self._visit() as client:
            runs = _of_key(client, self._experiment(client, table), key)
        return any(run.info.status == "FINISHED" or (run.info.status == "RUNNING" and _alive(run.data.tags)) for run in runs)

    @contextlib.contextmanager
    def _visit(self) -> Iterator[MlflowClient]:
        """Yield a client of MLflow's database while holding the file lock. An error of MLflow's database is raised as BackendError."""
        with files.lock(self._lock) if self._database else contextlib.nullcontext():
            client = self._connect()
            with _store_errors(self.uri):
                yield client

    def _connect(self) -> MlflowClient:
        if self._client is None:
            _prepare_environment()
            with _store_errors(self.uri), _short_timeouts():
                from mlflow import MlflowClient

                client = MlflowClient(tracking_uri=self.uri)
                client.search_experiments(max_results=1)  # the first query creates the tables of an SQLite database
                if self._database and self.artifacts:
                    _move_artifacts(self._database, self.artifacts)
            self._client = client
        return self._client

    def _experiment(self, client: MlflowClient, table: str) -> str:
        experiment = client.get_experiment_by_name(table)
        if experiment is not None:
            return experiment.experiment_id
        location = f"{self.artifacts}/{table}" if self._database else None
        return client.create_experiment(table, artifact_location=location, tags=KIND)

    def _end(self, record: Record, params: Mapping[str, str], status: str, error: str, ended_ms: int) -> None:
        from mlflow.entities import Metric, Param, RunTag

        if len(record.metrics) > MAX_METRICS:
            raise ValueError(f"{len(record.metrics)} metrics in one run; keep {MAX_METRICS} and write the rest as an artifact")
        with _store_errors(self.uri):
            client = self._connect()
            for path in record.artifacts:
                if path.name == MODELS and path.is_dir():
                    artifacts.log_models(client, record.run_id, path)
                elif path.is_dir():
                    client.log_artifacts(record.run_id, str(path), path.name)
                else:
                    client.log_artifact(record.run_id, str(path))
        with self._visit() as client:
            client.log_batch(
                record.run_id,
                metrics=[Metric(name, float(value), ended_ms, 0) for name, value in record.metrics.items()],
                params=[Param(name, value) for name, value in params.items()],
                tags=[RunTag("error", error)] if error else [],
            )
            if record.inputs:
                client.log_inputs(record.run_id, artifacts.datasets(record.inputs))
            client.set_terminated(record.run_id, status, ended_ms)


def _of_key(client: MlflowClient, experiment_id: str, key: str) -> list[Any]:
    return list(client.search_runs([experiment_id], filter_string=f"tags.`run_key` = '{key}'"))


def _prepare_environment() -> None:
    """Before the first import of mlflow, switch off its telemetry, logs and redirects. Settings of the user take precedence."""
    quiet = {"MLFLOW_DISABLE_TELEMETRY": "true", "DO_NOT_TRACK": "true", "MLFLOW_LOGGING_LEVEL": "WARNING", "GIT_PYTHON_REFRESH": "quiet"}
    for name, value in {**quiet, "MLFLOW_ALLOW_HTTP_REDIRECTS": "false"}.items():
        os.environ.setdefault(name, value)
    logging.getLogger("alembic").setLevel(logging.WARNING)
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.CRITICAL)  # `_unusable` reports the same database error


def _check_database(path: Path) -> None:
    """Raise BackendError for an SQLite database that cannot be used, because mlflow would retry for minutes before it fails."""
    if signs := [sign for sign in "?#%" if sign in str(path)]:
        raise _unusable(path, f"mlflow misreads '{signs[0]}' in the path of a database")
    if not path.exists():
        files.check_folder(path.parent)
        return
    if not os.access(path, os.R_OK | os.W_OK) or not os.access(path.parent, os.W_OK | os.X_OK):
        raise _unusable(path, "it or its folder cannot be written")
    try:
        with contextlib.closing(sqlite3.connect(path, timeout=30)) as connection:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchall()
    except sqlite3.Error as error:
        raise _unusable(path, "it is not a file" if path.is_dir() else _one_line(error)) from error


def _move_artifacts(database: Path, artifacts: str) -> None:
    """Correct the absolute locations of artifacts in a copied or moved output folder. The caller holds the lock of the database."""
    here = f"{artifacts}/"
    elsewhere = f"artifact_location LIKE 'file:%/{ARTIFACTS}/' || name AND artifact_location != ? || name"
    with contextlib.closing(sqlite3.connect(database, timeout=30)) as connection, connection:
        for number, name in connection.execute(f"SELECT experiment_id, name FROM experiments WHERE {elsewhere}", (here,)).fetchall():
            connection.execute("UPDATE experiments SET artifact_location = ? WHERE experiment_id = ?", (here + name, number))
            place = f"{here}{name}/"
            connection.execute("UPDATE runs SET artifact_uri = ? || run_uuid || '/artifacts' WHERE experiment_id = ?", (place, number))


@contextlib.contextmanager
def _store_errors(uri: str) -> Iterator[None]:
    """Within the `with` block, raise errors of MLflow's database as a BackendError whose one-line message names the database."""
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except UserError:
        raise
    except (MlflowException, SQLAlchemyError, ImportError, OSError) as error:
        raise _unusable(uri, _one_line(error)) from error


@contextlib.contextmanager
def _short_timeouts() -> Iterator[None]:
    """Within the `with` block, let mlflow try a server twice for 10 s each instead of for minutes. Settings of the user take precedence."""
    timeouts = {"MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1", "MLFLOW_HTTP_REQUEST_TIMEOUT": "10"}
    added = {name: value for name, value in timeouts.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _unusable(store: object, reason: str) -> BackendError:
    remedy = "free some space" if "full" in reason or "space" in reason else "move the store away, correct tracking.uri"
    return BackendError(f"tracking store {store}: {reason}; {remedy}, or use tracking=off")


def _one_line(error: Exception) -> str:
    """Return SQLite's own error message if `error` wraps an SQLite error; otherwise return the first line of the error's text."""
    if match := re.search(r"\(sqlite3\.\w+\) ([^\n\[]+)", str(error)):
        return match.group(1).strip()
    return hidden((str(error).splitlines() or [type(error).__name__])[0])[:200]


def _alive(tags: Mapping[str, str]) -> bool:
    """Return whether the process that the tags of an MLflow run name still runs on this machine."""
    host, _, process = tags.get(PROCESS, "").rpartition(":")
    return host == socket.gethostname() and process.isdecimal() and files.alive(int(process))
