"""Implement `radartwin run -m`: run one job per combination of values, and print a table of all jobs at the end.

All configurations are composed before the first job starts. The store keeps the results of jobs, so the same command resumes a sweep.
"""

from __future__ import annotations

import contextlib
import csv
import json
import re
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from radartwin.config.compose import Composer, combinations
from radartwin.config.config import Config
from radartwin.errors import ConfigError, UserError
from radartwin.io import files, untrusted_json
from radartwin.runs.checkout import commit
from radartwin.runs.experiment import load, module_name
from radartwin.runs.job import FAILED, OUTCOME, REFUSED, STARTED, STATUSES, UNFINISHED, Job, Outcome, job_name, run
from radartwin.runs.launchers import launcher
from radartwin.runs.run import extend_path, finished, naming
from radartwin.runs.tracking import Tracker
from radartwin.store.digest import spec_digest
from radartwin.store.products import CACHE, KEY_LENGTH, RUN, SHORT

TABLE, DESCRIPTION = "jobs.csv", "sweep.json"


def sweep(overrides: Sequence[str], config_dirs: Sequence[Path] = ()) -> int:
    """Run one job per combination of values. Return 0 if all jobs are done, 1 if a job failed, 2 if a job had wrong user input."""
    extend_path(config_dirs)
    settings, _ = split(overrides)
    jobs, composer = combinations(settings), Composer(config_dirs)
    common = set(jobs[0]).intersection(*jobs)
    jobs = [sorted(job, key=common.__contains__) for job in jobs]  # the swept values come first in the names of the jobs
    configs = composed(jobs, composer)
    title = " ".join(override for override in settings if naming([override]))
    with Sweep(configs[0], jobs[0], ["-m", *overrides, *folders(config_dirs)], composer, title) as running:
        running.run({number: (job, config) for number, (job, config) in enumerate(zip(jobs, configs, strict=True))})
    return running.close()


class Sweep:
    """A running sweep. Its folder holds sweep.json (experiment, command and commit), jobs.csv (a row per job), and a folder per job.

    The same command uses the same folder again, and waits while another process runs it.

    Args:
        first: configuration of one job; all jobs of a sweep have the same result table and output folder.
        overrides: overrides of this job.
        command: words of the command line after `radartwin run`.
        title: name of the parent run in MLflow: the overrides that distinguish this sweep from other sweeps of the same result table.
    Raises:
        ConfigError: the launcher or a setting of Hydra is refused, or hydra.sweep.dir names the folder of another sweep.
    """

    def __init__(self, first: Config, overrides: Sequence[str], command: Sequence[str], composer: Composer, title: str) -> None:
        load(first.experiment)
        table = first.experiment.name or module_name(first.experiment)
        option, settings, folder = composer.launching([*overrides, *split(command)[1]])
        self._launch = launcher(option, settings)
        self._key = spec_digest([table, title])[:KEY_LENGTH]
        usual = Path(first.output) / "sweeps" / f"{re.sub(r'[^A-Za-z0-9_.-]', '_', table)}_{self._key[:SHORT]}"
        self.folder = Path(folder or usual).absolute()
        self._experiment, self._title, self._results = table, title or table, Path(first.output).absolute() / CACHE / RUN
        self._described = {"experiment": table, "key": self._key, "command": shlex.join(["radartwin", "run", *command])}
        if (self.folder / DESCRIPTION).exists() and untrusted_json.read(self.folder / DESCRIPTION).get("key") != self._key:
            raise ConfigError(f"hydra.sweep.dir={self.folder} holds another sweep; choose another folder")
        self.outcomes: dict[int, Outcome] = {}
        self._tracker = Tracker(first.tracking, Path(first.output))
        self._parent: str | None = None
        self._jobs: dict[int, list[str]] = {}
        self._total = 0
        self._held = contextlib.ExitStack()

    def __enter__(self) -> Sweep:
        waiting = f"waiting for another process that runs the sweep in {self.folder}"
        self._held.enter_context(files.lock(files.make_folder(self.folder) / "sweep.lock", lambda: print(waiting, flush=True)))
        head, dirty = commit()
        described = {**self._described, "git_commit": head, "dirty": dirty, "started": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
        files.write_atomically(self.folder / DESCRIPTION, json.dumps(described, indent=1) + "\n")
        self._parent = self._tracker.sweep(self._experiment, self._title, self._key)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        with self._held:
            self._collect()
            if kind is None:
                status = "FINISHED" if all(o.finished for o in self.outcomes.values()) else "FAILED"
            else:
                status = "KILLED" if issubclass(kind, KeyboardInterrupt) else "FAILED"
                print(self._totals())
            try:
                files.write_atomically(self.folder / TABLE, self._table())
            finally:
                table = self.folder / TABLE
                self._tracker.end_sweep(self._parent, status, table if table.exists() else None)

    def run(self, jobs: Mapping[int, tuple[list[str], Config]], total: int | None = None) -> None:
        """Run the jobs by number, each (overrides, configuration). Results of finished jobs are read from the store."""
        self._total = total or len(jobs)
        self._jobs |= {number: overrides for number, (overrides, _) in jobs.items()}
        prepared: list[Job] = []
        for number, (overrides, config) in jobs.items():
            folder = files.make_folder(self.folder / str(number))
            for name in (OUTCOME, STARTED):
                (folder / name).unlink(missing_ok=True)
            job = Job(overrides, replace(config, tracking=replace(config.tracking, parent_run_id=self._parent)), folder)
            if _finished(config):
                self._ended(number, run(job))
            else:
                prepared.append(job)
        if prepared:
            self._launch(prepared, lambda job, outcome: self._ended(int(job.folder.name), outcome))

    def _ended(self, number: int, outcome: Outcome) -> None:
        self.outcomes[number] = outcome
        print(f"[{len(self.outcomes)}/{self._total}] {outcome}", flush=True)

    def close(self) -> int:
        """Print the table of the sweep's jobs. Return the exit status."""
        for outcome in sorted(self.outcomes.values(), key=lambda o: STATUSES.index(o.status)):
            print(f"{outcome}{f'; log {outcome.log}' if outcome.log and not outcome.finished else ''}")
        print(self._totals())
        statuses = {outcome.status for outcome in self.outcomes.values()}
        return 1 if statuses & {FAILED, UNFINISHED} else 2 if REFUSED in statuses else 0

    def _collect(self) -> None:
        """Take the outcomes of the jobs that ended just before an interruption, and note the other jobs as unfinished."""
        for number, overrides in self._jobs.items():
            if number not in self.outcomes:
                folder = self.folder / str(number)
                stopped = "stopped before its end" if (folder / STARTED).exists() else "not begun"
                self.outcomes[number] = Outcome.read(folder) or Outcome(job_name(overrides), UNFINISHED, stopped)

    def _totals(self) -> str:
        count = {status: sum(o.status == status for o in self.outcomes.values()) for status in STATUSES}
        counts = {status: n for status, n in count.items() if n or status != UNFINISHED}
        return "sweep: " + ", ".join(f"{n} {status}" for status, n in counts.items()) + f"; {self.folder / TABLE}"

    def _table(self) -> str:
        """Format the jobs as CSV, with a column per option and per metric. Trials of an earlier command of a search keep their rows."""
        table = self.folder / TABLE
        earlier = csv.DictReader(table.read_text(encoding="utf-8").splitlines()) if table.exists() else ()
        known: dict[int, dict[str, Any]] = {int(row["job"]): row for row in earlier if row.get("job", "").isdecimal()}
        known |= {
            number: {"job": number, "experiment": self._experiment, **naming(self._jobs[number]), "status": outcome.status}
            | {"run_key": outcome.run_key, **outcome.metrics, "result": self._results / outcome.run_key if outcome.run_key else ""}
            | {"line": outcome.line, "log": outcome.log, "seconds": outcome.seconds}
            for number, outcome in self.outcomes.items()
        }
        rows = [known[number] for number in sorted(known)]
        last = ("result", "line", "log", "seconds")
        columns = [column for column in dict.fromkeys(column for row in rows for column in row) if column not in last]
        return files.csv_text(rows, [*columns, *last])


def folders(config_dirs: Sequence[Path]) -> list[str]:
    return [f"--config-dir={folder}" for folder in config_dirs]


def split(overrides: Sequence[str]) -> tuple[list[str], list[str]]:
    hydras = [o for o in overrides if o.lstrip("+~").startswith(("hydra.", "hydra/"))]
    return [o for o in overrides if o not in hydras], hydras


def composed(jobs: Sequence[list[str]], composer: Composer) -> list[Config]:
    """Compose the configuration of each job of a sweep. Raises a ConfigError that names the first job whose configuration is wrong."""
    configs = []
    for job in jobs:
        try:
            configs.append(composer.compose(job))
        except UserError as error:
            raise ConfigError(f"{job_name(job)}: {error}" if len(jobs) > 1 else str(error)) from error
    return configs


def _finished(config: Config) -> bool:
    """Return whether an earlier run finished a job. A job with wrong input is not finished; it reports its error when it runs."""
    try:
        return finished(config)
    except UserError:
        return False
