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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from radartwin.config.compose import Composer, combinations
from radartwin.config.config import Config
from radartwin.errors import ConfigError, UserError
from radartwin.io import files, untrusted_json
from radartwin.runs.checkout import commit
from radartwin.runs.experiment import load, module_name
from radartwin.runs.job import FAILED, LOG, OUTCOME, REFUSED, STATUSES, UNFINISHED, Job, Outcome, job_name, run
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
    with sweeping(configs[0], jobs[0], ["-m", *overrides, *folders(config_dirs)], composer, title) as running:
        running.run({number: (job, config) for number, (job, config) in enumerate(zip(jobs, configs, strict=True))})
    return running.close()


@contextlib.contextmanager
def sweeping(first: Config, overrides: Sequence[str], command: Sequence[str], composer: Composer, title: str) -> Iterator[Sweep]:
    """Open a sweep within the `with` block, and wait while another process runs it. The same command uses the same folder again.

    The folder holds sweep.json (experiment, command and commit), jobs.csv (a row per job), and a folder per job.

    Args:
        first: configuration of one job; all jobs of a sweep have the same result table and output folder.
        overrides: overrides of this job.
        command: words of the command line after `radartwin run`.
        title: name of the parent run in MLflow: the overrides that distinguish this sweep from other sweeps of the same result table.
    Raises:
        ConfigError: the launcher or a setting of Hydra is refused, or hydra.sweep.dir names the folder of another sweep.
    """
    load(first.experiment)
    table, output = first.experiment.name or module_name(first.experiment), Path(first.output)
    option, settings, named = composer.launching([*overrides, *split(command)[1]])
    launch, tracker = launcher(option, settings), Tracker(first.tracking, output)
    key = spec_digest([table, title])[:KEY_LENGTH]
    folder = Path(named or output / "sweeps" / f"{re.sub(r'[^A-Za-z0-9_.-]', '_', table)}_{key[:SHORT]}").absolute()
    if (folder / DESCRIPTION).exists() and untrusted_json.read(folder / DESCRIPTION).get("key") != key:
        raise ConfigError(f"hydra.sweep.dir={folder} holds another sweep; choose another folder")
    waiting = f"waiting for another process that runs the sweep in {folder}"
    with files.lock(files.make_folder(folder) / "sweep.lock", lambda: print(waiting, flush=True)):
        head, dirty = commit()
        described = {"experiment": table, "key": key, "command": shlex.join(["radartwin", "run", *command]), "git_commit": head}
        described |= {"dirty": dirty, "started": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
        files.write_atomically(folder / DESCRIPTION, json.dumps(described, indent=1) + "\n")
        running = Sweep(folder, table, output.absolute() / CACHE / RUN, launch, tracker.sweep(table, title or table, key))
        status = None
        try:
            yield running
            status = "FINISHED" if all(outcome.finished for outcome in running.outcomes.values()) else "FAILED"
        except KeyboardInterrupt:
            status = "KILLED"
            raise
        finally:
            running.collect()
            if status in (None, "KILLED"):
                print(running.totals())
            try:
                files.write_atomically(folder / TABLE, running.table())
            finally:
                tracker.end_sweep(running.parent, status or "FAILED", folder / TABLE if (folder / TABLE).exists() else None)


@dataclass
class Sweep:
    """A running sweep, and how its jobs ended."""

    folder: Path
    experiment: str
    results: Path  # folder of the stored results
    launch: Callable[[Sequence[Job], Callable[[Job, Outcome], None]], None]
    parent: str | None  # id of the parent run in MLflow
    outcomes: dict[int, Outcome] = field(default_factory=dict)
    jobs: dict[int, list[str]] = field(default_factory=dict)

    def run(self, jobs: Mapping[int, tuple[list[str], Config]], total: int | None = None) -> None:
        """Run the jobs by number, each (overrides, configuration). Results of finished jobs are read from the store."""

        def ended(job: Job, outcome: Outcome) -> None:
            self.outcomes[int(job.folder.name)] = outcome
            print(f"[{len(self.outcomes)}/{total or len(jobs)}] {outcome}", flush=True)

        self.jobs |= {number: overrides for number, (overrides, _) in jobs.items()}
        prepared: list[Job] = []
        for number, (overrides, config) in jobs.items():
            folder = files.make_folder(self.folder / str(number))
            for name in (OUTCOME, LOG):
                (folder / name).unlink(missing_ok=True)
            job = Job(overrides, replace(config, tracking=replace(config.tracking, parent_run_id=self.parent)), folder)
            if _finished(config):
                ended(job, run(job))
            else:
                prepared.append(job)
        if prepared:
            self.launch(prepared, ended)

    def close(self) -> int:
        """Print the table of the sweep's jobs. Return the exit status."""
        for outcome in sorted(self.outcomes.values(), key=lambda o: STATUSES.index(o.status)):
            print(f"{outcome}{f'; log {outcome.log}' if outcome.log and not outcome.finished else ''}")
        print(self.totals())
        statuses = {outcome.status for outcome in self.outcomes.values()}
        return 1 if statuses & {FAILED, UNFINISHED} else 2 if REFUSED in statuses else 0

    def collect(self) -> None:
        """Take the outcomes of the jobs that ended just before an interruption, and note the other jobs as unfinished."""
        for number, overrides in self.jobs.items():
            if number not in self.outcomes:
                folder = self.folder / str(number)
                stopped = "stopped before its end" if (folder / LOG).exists() else "not begun"
                self.outcomes[number] = Outcome.read(folder) or Outcome(job_name(overrides), UNFINISHED, stopped)

    def totals(self) -> str:
        count = {status: sum(o.status == status for o in self.outcomes.values()) for status in STATUSES}
        counts = {status: n for status, n in count.items() if n or status != UNFINISHED}
        return "sweep: " + ", ".join(f"{n} {status}" for status, n in counts.items()) + f"; {self.folder / TABLE}"

    def table(self) -> str:
        """Format the jobs as CSV, with a column per option and per metric. Trials of an earlier command of a search keep their rows."""
        table = self.folder / TABLE
        earlier = csv.DictReader(table.read_text(encoding="utf-8").splitlines()) if table.exists() else ()
        known: dict[int, dict[str, Any]] = {int(row["job"]): row for row in earlier if row.get("job", "").isdecimal()}
        known |= {
            number: {"job": number, "experiment": self.experiment, **naming(self.jobs[number]), "status": outcome.status}
            | {"run_key": outcome.run_key, **outcome.metrics, "result": self.results / outcome.run_key if outcome.run_key else ""}
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
