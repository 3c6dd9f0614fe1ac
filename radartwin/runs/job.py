"""Run one job of a sweep for a launcher: run the experiment, write how the job ended to a file, and raise no exception.

An exception in a launcher would lose the remaining jobs of the sweep. Therefore each job writes three files to its own folder. The
process that started the sweep reads the files:

    started        written first; a folder with this file and without outcome.json belongs to a job that was killed
    log.txt        standard error of the job, with the traceback of a programming error
    outcome.json   how the job ended, written atomically
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from radartwin.config.compose import typed
from radartwin.errors import UserError
from radartwin.io import files
from radartwin.io.progress import Progress
from radartwin.runs.run import naming, run_experiment

if TYPE_CHECKING:
    from omegaconf import DictConfig

OUTCOME, STARTED, LOG = "outcome.json", "started", "log.txt"
DONE, CACHED, FAILED, REFUSED, UNFINISHED = "done", "cached", "failed", "refused", "not run"
STATUSES = (DONE, CACHED, FAILED, REFUSED, UNFINISHED)


@dataclass(frozen=True)
class Outcome:
    """How one job of a sweep ended.

    The status is "done", "cached" (an earlier run finished the job), "failed" (by a programming error, or because the job was killed),
    "refused" (because of wrong user input) or "not run".

    Attributes:
        line: text with the number of results computed and reused, or with the reason of a failure.
        seconds: wall-clock run time of the job.
        log: path of the job's log file; empty if the job wrote no log text.
    """

    job: str
    status: str
    line: str = ""
    run_key: str = ""
    seconds: float = 0.0
    log: str = ""
    metrics: Mapping[str, float] = field(default_factory=dict)

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


def job(composed: DictConfig) -> None:
    """Run one job of a sweep. Hydra's launchers call the function `job`, in any process or on any machine."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    runtime = HydraConfig.get()
    overrides = list(runtime.overrides.task)
    unresolved = OmegaConf.to_container(runtime.runtime, resolve=False)  # a ${ in the path must stay as it is
    folder = Path(cast(dict, unresolved)["output_dir"])
    in_parent = runtime.runtime.choices.get("hydra/launcher") == "basic"
    (folder / STARTED).touch()
    started = time.monotonic()
    with _logged(folder / LOG, echo=in_parent):
        outcome = _outcome(composed, overrides)
    log = str(folder / LOG) if (folder / LOG).stat().st_size else ""
    replace(outcome, seconds=round(time.monotonic() - started, 3), log=log).write(folder)


def _outcome(composed: DictConfig, overrides: Sequence[str]) -> Outcome:
    name = job_name(overrides)
    try:
        result, counts = run_experiment(typed(composed), overrides, Progress())
    except UserError as error:
        print(error, file=sys.stderr)
        return Outcome(name, REFUSED, " ".join(str(error).split()))
    except MemoryError as error:
        traceback.print_exc()
        return Outcome(name, FAILED, f"out of memory ({error}); run fewer jobs at once" if str(error) else "out of memory")
    except Exception as error:
        traceback.print_exc()
        return Outcome(name, FAILED, f"{type(error).__name__}: {error}".splitlines()[0])
    return Outcome(name, DONE if counts.scored else CACHED, str(counts), result.run_key, metrics=dict(result.metrics))


@contextlib.contextmanager
def _logged(path: Path, echo: bool) -> Iterator[None]:
    """Within the `with` block, write standard error to the file `path`, and if `echo` is True also to the terminal."""
    with (
        path.open("w", encoding="utf-8", buffering=1) as log,
        contextlib.redirect_stderr(cast(Any, _Both(log, sys.stderr)) if echo else log),
    ):
        yield


class _Both(io.TextIOBase):
    """A text stream that writes to two other streams. It does not count as a terminal, so progress is printed line by line."""

    def __init__(self, first: TextIO, second: TextIO) -> None:
        self._streams = (first, second)

    def write(self, text: str) -> int:
        for stream in self._streams:
            stream.write(text)
        return len(text)

    def flush(self) -> None:
        for stream in self._streams:
            stream.flush()
