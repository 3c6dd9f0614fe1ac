"""Run one job of a sweep for a launcher: run the experiment, write how the job ended to a file, and raise no exception.

An exception in a launcher would lose the remaining jobs of the sweep. Each job writes two files to its own folder:

    log.txt        standard error of the job, with the traceback of a programming error; without outcome.json, the job was killed
    outcome.json   how the job ended, written atomically
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO, cast

from radartwin.config.config import Config
from radartwin.errors import CrashError, UserError
from radartwin.io import files
from radartwin.io.one_line import one_line
from radartwin.io.progress import Progress
from radartwin.runs.run import naming, run_experiment

OUTCOME, LOG = "outcome.json", "log.txt"
DONE, CACHED, FAILED, REFUSED, UNFINISHED = "done", "cached", "failed", "refused", "not run"
STATUSES = (DONE, CACHED, FAILED, REFUSED, UNFINISHED)


@dataclass(frozen=True)
class Outcome:
    """How one job of a sweep ended: done, cached (an earlier run finished it), failed (by a defect or a kill), refused (wrong input) or not
    run.
    """

    job: str
    status: str
    line: str = ""  # counts of computed and reused results, or the reason of a failure
    run_key: str = ""
    seconds: float = 0.0  # wall-clock run time
    log: str = ""  # path of the log file; empty without log text
    metrics: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        key = f"run {self.run_key[:8]}, " if self.run_key else ""
        return f"{self.status:8s} {self.job}: {key}{self.line} ({self.seconds:.1f} s)"

    @property
    def finished(self) -> bool:
        return self.status in (DONE, CACHED)

    def write(self, folder: Path) -> None:
        files.write_atomically(folder / OUTCOME, json.dumps(asdict(self)))

    @classmethod
    def read(cls, folder: Path) -> Outcome | None:
        """Read how a job ended from the job's folder; None if the job has not ended."""
        try:
            return cls(**json.loads((folder / OUTCOME).read_text(encoding="utf-8")))
        except FileNotFoundError:
            return None


def job_name(overrides: Sequence[str]) -> str:
    """Join the overrides that distinguish a job from the other jobs of its sweep into a name, such as materials=void,seed=1."""
    return ",".join(f"{key}={value}" for key, value in naming(overrides).items()) or "defaults"


@dataclass(frozen=True)
class Job:
    """One job of a sweep, which a launcher may send to another machine. The number of the job names the folder of its files."""

    overrides: Sequence[str]
    config: Config
    folder: Path

    @property
    def name(self) -> str:
        return job_name(self.overrides)

    def lost(self, reason: str, *logs: Path) -> Outcome:
        """Note that the job has failed without an outcome of its own. The outcome names the first log file with text."""
        written = (str(log) for log in (self.folder / LOG, *logs) if log.exists() and log.stat().st_size)
        outcome = Outcome(self.name, FAILED, reason, log=next(written, ""))
        outcome.write(self.folder)
        return outcome


def run(job: Job) -> Outcome:
    """Run one job of a sweep, in any process or on any machine. Return how the job ended, and write it to the job's folder."""
    started, log = time.monotonic(), job.folder / LOG
    with log.open("w", encoding="utf-8", buffering=1) as stream, contextlib.redirect_stderr(cast(Any, _Both(stream, sys.stderr))):
        outcome = _outcome(job)
    outcome = replace(outcome, seconds=round(time.monotonic() - started, 3), log=str(log) if log.stat().st_size else "")
    outcome.write(job.folder)
    return outcome


def _outcome(job: Job) -> Outcome:
    try:
        result, counts = run_experiment(job.config, job.overrides, Progress(label=job.name))
    except UserError as error:
        print(error, file=sys.stderr)
        return Outcome(job.name, FAILED if isinstance(error, CrashError) else REFUSED, one_line(error))
    except MemoryError as error:
        traceback.print_exc()
        return Outcome(job.name, FAILED, f"out of memory ({error}); run fewer jobs at once" if str(error) else "out of memory")
    except Exception as error:
        traceback.print_exc()
        return Outcome(job.name, FAILED, f"{type(error).__name__}: {error}".splitlines()[0])
    return Outcome(job.name, DONE if counts.scored else CACHED, str(counts), result.run_key, metrics=dict(result.metrics))


class _Both(io.TextIOBase):
    """A text stream that writes to two other streams. It does not count as a terminal, so progress is printed line by line."""

    def __init__(self, *streams: TextIO) -> None:
        self._streams = streams

    def write(self, text: str) -> int:
        for stream in self._streams:
            stream.write(text)
        return len(text)
