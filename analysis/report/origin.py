"""Collect the origin of a report: the code version, the machine, and the key, seed, run time and MLflow page of each run.

This module only reads files; it runs no experiment.
"""

from __future__ import annotations

import contextlib
import re
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from analysis.report.content import Section
from experiments.speed.machine import machine
from radartwin.constants import __version__
from radartwin.io import untrusted_json
from radartwin.runs.checkout import commit
from radartwin.runs.dashboard import HOST, USUAL_PORT
from radartwin.runs.tracking import DATABASE
from radartwin.store.products import KEY_LENGTH, META, RUN

_KEY = re.compile(rf"[0-9a-f]{{{KEY_LENGTH}}}")


@dataclass(frozen=True)
class Run:
    """One run of an experiment behind the report. An attribute is None if the cache no longer holds its value."""

    section: Section
    seed: int | None = None
    finished: str = ""
    core_seconds: float | None = None  # processor time of the run, including the products that it computed
    # core-seconds of the products (recordings, scans) that the run uses, by key; another run may have computed them
    made: dict[str, float] = field(default_factory=dict)
    mlflow: str = ""  # address of the run's page while `radartwin dashboard` runs, or ""


@dataclass(frozen=True)
class Origin:
    """The origin of the whole report: code, machine, and all runs."""

    written_by: list[tuple[str, str]]  # name and value of each line about code and machine
    runs: list[Run]
    tracking: str = ""  # why no run is linked to MLflow, or ""

    @property
    def core_seconds(self) -> float:
        """Return the sum of the processor time over all runs, in core-seconds."""
        return sum(run.core_seconds or 0.0 for run in self.runs)

    @property
    def made(self) -> dict[str, float]:
        """Return the core-seconds of the stored results (recordings, scans) of all runs, by store key.

        A stored result that several runs use appears once.
        """
        return {key: seconds for run in self.runs for key, seconds in run.made.items()}


def of(sections: Sequence[Section], output: Path) -> Origin:
    """Read the origin of a report from the files of the output folder. `sections` are the tables of the report."""
    present = [section for section in sections if not section.absent]
    pages, why = mlflow_pages(output)
    runs = [_run(section, output / "cache", pages.get(section.run_key, "")) for section in present]
    head, dirty = commit()
    code = f"commit {head[:12]}{' with local changes' if dirty else ''}" if head != "none" else "no repository"
    return Origin([("radartwin", f"{__version__}, {code}"), *machine().items()], runs, why)


def _run(section: Section, cache: Path, page: str) -> Run:
    if not _KEY.fullmatch(section.run_key):
        return Run(section, mlflow=page)
    folder = cache / RUN / section.run_key
    meta, result = read_json(folder / META), read_json(folder / "result.json")
    spec = meta.get("spec")
    config = spec.get("config") if isinstance(spec, dict) else None
    seed = config.get("seed") if isinstance(config, dict) else None
    keys = result.get("keys")
    return Run(
        section,
        seed if isinstance(seed, int) else None,
        str(meta.get("finished", "")),
        _number(meta.get("core_seconds")),
        _costs(cache, keys if isinstance(keys, list) else []),
        page,
    )


def _costs(cache: Path, keys: Iterable[Any]) -> dict[str, float]:
    """Return {store key: core-seconds} of the stored results with these keys; results that the cache no longer holds are left out."""
    kinds = sorted(folder for folder in cache.iterdir() if folder.is_dir()) if cache.is_dir() else []
    costs = {}
    for key in {key for key in keys if isinstance(key, str) and _KEY.fullmatch(key)}:
        for kind in kinds:
            seconds = _number(read_json(kind / key / META).get("core_seconds"))
            if seconds is not None:
                costs[key] = seconds
    return costs


def mlflow_pages(output: Path) -> tuple[dict[str, str], str]:
    """Return the addresses of the MLflow pages of the finished runs by run key, and a reason as text if there are no such pages."""
    database = output / DATABASE
    if not database.is_file():
        return {}, f"There is no {database.name} in the output folder, so no run is linked to MLflow."
    query = (
        "SELECT tags.value, runs.experiment_id, runs.run_uuid FROM tags JOIN runs ON runs.run_uuid = tags.run_uuid "
        "WHERE tags.key = 'run_key' AND runs.status = 'FINISHED' AND runs.lifecycle_stage = 'active' "
        "ORDER BY runs.start_time, runs.run_uuid"
    )
    try:
        with contextlib.closing(sqlite3.connect(f"{database.absolute().as_uri()}?mode=ro", uri=True, timeout=5)) as connection:
            rows = connection.execute(query).fetchall()
    except sqlite3.Error as error:
        return {}, f"{database.name} cannot be read ({error}), so no run is linked to MLflow."
    return {str(key): f"http://{HOST}:{USUAL_PORT}/#/experiments/{experiment}/runs/{run}" for key, experiment, run in rows}, ""


def read_json(path: Path) -> dict[str, Any]:
    """Read the JSON object in a file; returns an empty object if the file is absent or damaged, for instance after the cache was
    cleared.
    """
    try:
        content = untrusted_json.read(path)
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) else None
