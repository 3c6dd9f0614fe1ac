"""Collect the origin of a report: the code version, the machine, and the key, seed, run time and MLflow page of each run.

This module only reads files; it runs no experiment.
"""

import contextlib
import re
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
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


def of(sections: Sequence[Section], output: Path) -> Origin:
    """Read the origin of a report from the files of the output folder. `sections` are the tables of the report."""
    pages, why = mlflow_pages(output)
    runs = [_run(section, output / "cache", pages.get(section.run_key, "")) for section in sections if not section.absent]
    head, dirty = commit()
    code = f"commit {head[:12]}{' with local changes' if dirty else ''}" if head != "none" else "no repository"
    return Origin([("radartwin", f"{__version__}, {code}"), *machine().items()], runs, why)


def _run(section: Section, cache: Path, page: str) -> Run:
    seed = meta = read_json(cache / RUN / section.run_key / META) if _KEY.fullmatch(section.run_key) else {}
    for name in ("spec", "config", "seed"):
        seed = seed.get(name) if isinstance(seed, dict) else None
    seconds = meta.get("core_seconds")
    number = float(seconds) if isinstance(seconds, int | float) else None
    return Run(section, seed if isinstance(seed, int) else None, str(meta.get("finished", "")), number, page)


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
    """Read the JSON object in a file; an absent or damaged file gives an empty object."""
    try:
        content = untrusted_json.read(path)
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
