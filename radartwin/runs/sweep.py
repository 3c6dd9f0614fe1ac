"""Implement `radartwin run -m`: run one job per combination of values, and print a table of all jobs at the end.

The configurations of all jobs are composed before the first job starts, so that a wrong key is found early. Results of jobs that an earlier
run finished are read from the store. The launcher that hydra/launcher names runs all other jobs. A sweep stores only the results of its
jobs, so the same command resumes an interrupted sweep.
"""

from __future__ import annotations

import csv
import io
import time
import uuid
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from radartwin.config.compose import Composer, combinations, quoted
from radartwin.config.config import Config
from radartwin.errors import ConfigError, UserError
from radartwin.io import files
from radartwin.io.progress import Progress
from radartwin.runs.experiment import load, module_name
from radartwin.runs.job import CACHED, FAILED, REFUSED, STARTED, STATUSES, UNFINISHED, Outcome, job_name
from radartwin.runs.launchers import Launcher, status_line
from radartwin.runs.run import extend_path, finished, naming, run_experiment
from radartwin.runs.tracking import Tracker

TABLE = "jobs.csv"


def sweep(overrides: Sequence[str], config_dirs: Sequence[Path] = ()) -> int:
    """Run one job per combination of values. Return 0 if all jobs are done, 1 if a job failed, 2 if a job had wrong user input."""
    extend_path(config_dirs)
    ours, hydras = split(overrides)
    jobs = combinations(ours)
    configs = composed(jobs, Composer(config_dirs))
    title = " ".join(override for override in ours if naming([override]))
    with Sweep(configs[0], hydras, config_dirs, title) as running:
        running.run({number: (job, config) for number, (job, config) in enumerate(zip(jobs, configs, strict=True))})
    return running.close()


class Sweep:
    """A running sweep: its folder, its parent run in MLflow, its launcher, and how the finished jobs ended.

    Args:
        first: configuration of one job; all jobs of a sweep have the same result table and output folder.
        hydra_overrides: overrides that select the launcher and its settings.
        config_dirs: further folders with option files.
        title: name of the parent run in MLflow: the overrides that distinguish this sweep from other sweeps of the same result table.
    """

    def __init__(self, first: Config, hydra_overrides: Sequence[str], config_dirs: Sequence[Path], title: str) -> None:
        load(first.experiment)
        table = first.experiment.name or module_name(first.experiment)
        stamp = f"{time.strftime('%Y-%m-%d_%H-%M-%S')}_{uuid.uuid4().hex[:6]}"
        self.folder = Path(first.output).absolute() / "sweeps" / stamp
        self.outcomes: dict[int, Outcome] = {}
        self._launcher = Launcher(hydra_overrides, config_dirs, self.folder)
        self._tracker = Tracker(first.tracking, Path(first.output))
        self._title = (table, title or table)
        self._parent: str | None = None
        self._jobs: dict[int, list[str]] = {}

    def __enter__(self) -> Sweep:
        files.make_folder(self.folder)
        self._parent = self._tracker.sweep(*self._title)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self._collect()
        if kind is None:
            status = "FINISHED" if all(o.finished for o in self.outcomes.values()) else "FAILED"
        else:
            status = "KILLED" if issubclass(kind, KeyboardInterrupt) else "FAILED"
            print(self._totals())
        try:
            self._write()
        finally:
            table = self.folder / TABLE
            self._tracker.end_sweep(self._parent, status, table if table.exists() else None)

    def run(self, jobs: Mapping[int, tuple[list[str], Config]], total: int | None = None) -> None:
        """Run the sweep's jobs; `jobs` maps the job number to (overrides, configuration).

        Results of jobs that are already finished are read from the store.
        """
        total = total or len(jobs)
        self._jobs |= {number: overrides for number, (overrides, _) in jobs.items()}
        waiting: dict[int, list[str]] = {}
        for number, (overrides, config) in jobs.items():
            if outcome := _cached(config, overrides):
                self.outcomes[number] = outcome
                print(f"[{len(self.outcomes)}/{total}] {status_line(outcome)}", flush=True)
            else:
                waiting[number] = [*quoted(overrides), *([f"tracking.parent_run_id={self._parent}"] if self._parent else [])]
        if waiting:
            self._launcher.run(waiting, total)
        self._collect()

    def close(self) -> int:
        """Print the table of the sweep's jobs. Return the exit status."""
        print(table_text(self.outcomes.values()))
        print(self._totals())
        statuses = {outcome.status for outcome in self.outcomes.values()}
        return 1 if statuses & {FAILED, UNFINISHED} else 2 if REFUSED in statuses else 0

    def _collect(self) -> None:
        for number, overrides in self._jobs.items():
            if number not in self.outcomes or self.outcomes[number].status == UNFINISHED:
                folder = self.folder / str(number)
                stopped = "stopped before its end" if (folder / STARTED).exists() else "not begun"
                self.outcomes[number] = Outcome.read(folder) or Outcome(job_name(overrides), UNFINISHED, stopped)

    def _totals(self) -> str:
        count = {status: sum(o.status == status for o in self.outcomes.values()) for status in STATUSES}
        shown = {status: n for status, n in count.items() if n or status != UNFINISHED}
        return "sweep: " + ", ".join(f"{n} {status}" for status, n in shown.items()) + f"; {self.folder / TABLE}"

    def _write(self) -> None:
        files.write_atomically(self.folder / TABLE, table_csv(self.outcomes[number] for number in sorted(self.outcomes)))


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


def _cached(config: Config, overrides: Sequence[str]) -> Outcome | None:
    """Return how a job ended if an earlier run finished it; None if the job has to run."""
    started = time.monotonic()
    try:
        if not finished(config):
            return None
        result, counts = run_experiment(config, overrides, Progress(quiet=True))
    except UserError:  # the job raises the same error again when it runs, and reports it
        return None
    return Outcome(
        job_name(overrides), CACHED, str(counts), result.run_key, round(time.monotonic() - started, 3), metrics=dict(result.metrics)
    )


def table_text(outcomes: Iterable[Outcome]) -> str:
    lines = []
    for outcome in sorted(outcomes, key=lambda o: STATUSES.index(o.status)):
        log = f"; log {outcome.log}" if outcome.log and not outcome.finished else ""
        lines.append(f"{status_line(outcome)}{log}")
    return "\n".join(lines)


def table_csv(outcomes: Iterable[Outcome]) -> str:
    """Format the jobs of a sweep as CSV with the columns job, status, run_key, one column per metric, line, log and seconds."""
    rows = list(outcomes)
    metrics = sorted({name for row in rows for name in row.metrics})
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["job", "status", "run_key", *metrics, "line", "log", "seconds"])
    for row in rows:
        writer.writerow([row.job, row.status, row.run_key, *(row.metrics.get(m, "") for m in metrics), row.line, row.log, row.seconds])
    return text.getvalue()
