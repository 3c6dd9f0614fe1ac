"""One experiment or a sweep: compose -> store -> experiment -> track, with resume.

A single run composes in this process. A sweep goes through Hydra's multirun, so that every launcher (serial, joblib,
SLURM) works with the same command; all jobs are composed once beforehand, so that a wrong key stops it before anything
has started. A job never raises into its launcher, which would lose the rest of the sweep: it writes its outcome, and
the parent reads them all.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from radartwin import files
from radartwin.compose import CONFIG_NAME, compose, conf_dir, path_override, quoted, register, search_override, typed
from radartwin.config import Config
from radartwin.digest import semantic
from radartwin.errors import ConfigError, UserError
from radartwin.experiment import Result, load, module_name, read, save
from radartwin.progress import Progress
from radartwin.store import RUN, Counts, Store
from radartwin.tracking import Tracker

if TYPE_CHECKING:
    from omegaconf import DictConfig

OUTCOME = "outcome.json"
DONE, FAILED, REFUSED = "done", "failed", "refused"
_UNTOLD = ("experiment", "output", "tracking", "hydra")  # overrides that do not tell runs of one table apart


@dataclass(frozen=True)
class Outcome:
    """How one job of a sweep ended: done, failed (a defect) or refused (the user's input)."""

    job: str
    status: str
    line: str


def run_experiment(config: Config, overrides: Sequence[str] = (), progress: Progress | None = None) -> tuple[Result, Counts]:
    """The result of a composed experiment, computed or read back, and what that took.

    Raises:
        UserError: what the configuration asks for cannot be done.
    """
    from radartwin.simulation import path_cache  # brings the numerical packages along

    progress = progress or Progress()
    experiment = load(config.experiment)
    store = Store(Path(config.output) / "cache", progress.say)
    tracker = Tracker(config.tracking, Path(config.output))
    spec, roots = {"config": semantic(config)}, [module_name(config.experiment)]
    key = store.key(RUN, spec, roots)
    name, told = config.experiment.name or roots[0], telling(overrides)
    title = ",".join(f"{k}={v}" for k, v in told.items()) or name

    def build(folder: Path) -> None:
        with tracker.run(name, key, title, told) as record:
            with path_cache.kept_in(store.root / "paths"):
                result = experiment.run(config, store, progress)
            save(result, folder)
            (folder / "config.json").write_text(json.dumps(asdict(config), indent=1) + "\n", encoding="utf-8")
            record.metrics = result.metrics
            record.artifacts = sorted(folder.iterdir())

    product = store.fetch(RUN, spec, roots, build)
    result = read(product)
    if product.reused and not tracker.known(name, key):  # computed with tracking=off, or tracked elsewhere
        with tracker.run(name, key, title, told) as record:
            record.metrics = result.metrics
            record.artifacts = sorted(product.path.iterdir())
    return result, store.counts


def telling(overrides: Sequence[str]) -> dict[str, str]:
    """The overrides that name a run, by key: {"materials": "void"}."""
    pairs = (override.lstrip("+~").partition("=") for override in overrides)
    return {key: value for key, _, value in pairs if key.partition(".")[0].partition("/")[0] not in _UNTOLD}


def summary(result: Result) -> str:
    """Rows with their verdicts and the headline numbers, as lines for a terminal."""
    verdicts = ", ".join(f"{sum(row['verdict'] == v for row in result.rows)} {v}" for v in ("holds", "fails", "untestable"))
    numbers = [f"  {name} = {value:.4g}" for name, value in result.metrics.items()]
    return "\n".join([f"{result.table}: {len(result.rows)} rows ({verdicts}); run {result.run_key[:8]}", *numbers])


def run(overrides: Sequence[str], config_dirs: Sequence[Path] = ()) -> int:
    """`radartwin run`: one experiment. Returns the exit status."""
    _extend_path(config_dirs)
    config = compose(overrides, config_dirs)
    result, counts = run_experiment(config, overrides)
    page = getattr(load(config.experiment), "page", None)
    if callable(page):  # an experiment that is read row by row says how
        print(page(result.rows))
    print(summary(result))
    print(f"run: simulated {counts.simulated}, reused {counts.reused}, scored {counts.scored}")
    return 0


def sweep(overrides: Sequence[str], config_dirs: Sequence[Path] = ()) -> int:
    """`radartwin run -m`: one job per combination. Returns 0 if all are done, 1 if one failed, 2 if one was refused."""
    _extend_path(config_dirs)
    jobs = plan(overrides, config_dirs)
    first = compose(jobs[0], config_dirs)
    load(first.experiment)
    table = first.experiment.name or module_name(first.experiment)
    folder = files.make_folder(Path(first.output).absolute() / "sweeps" / f"{time.strftime('%Y-%m-%d_%H-%M-%S')}_{os.getpid()}")
    tracker = Tracker(first.tracking, Path(first.output))
    parent = tracker.sweep(table, " ".join(o for o in overrides if telling([o])) or table)
    own = [path_override("hydra.sweep.dir", folder), *([f"tracking.parent_run_id={parent}"] if parent else [])]
    try:
        _launch([*quoted(overrides), *own], config_dirs)
    except KeyboardInterrupt:
        tracker.end_sweep(parent, "KILLED")
        raise
    except BaseException:
        tracker.end_sweep(parent, "FAILED")
        raise
    outcomes = [_outcome(folder / str(number), job) for number, job in enumerate(jobs)]
    tracker.end_sweep(parent, "FINISHED" if all(o.status == DONE for o in outcomes) else "FAILED")
    for outcome in outcomes:
        print(f"{outcome.status:8s} {outcome.job}: {outcome.line}")
    count = {status: sum(o.status == status for o in outcomes) for status in (DONE, FAILED, REFUSED)}
    print("sweep: " + ", ".join(f"{n} {status}" for status, n in count.items()))
    return 1 if count[FAILED] else 2 if count[REFUSED] else 0


def plan(overrides: Sequence[str], config_dirs: Sequence[Path] = ()) -> list[list[str]]:
    """The overrides of each job of a sweep, every one composed once.

    Raises:
        ConfigError: the first job that cannot be composed, named.
    """
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    from radartwin.compose import explain

    register()
    try:
        parsed = OverridesParser.create().parse_overrides(quoted(overrides))
        batches = BasicSweeper.split_arguments(parsed, max_batch_size=None)
    except HydraException as error:
        raise ConfigError(explain(error)) from error
    jobs = [list(job) for batch in batches for job in batch]
    for job in jobs:
        try:
            compose(job, config_dirs)
        except UserError as error:
            raise ConfigError(f"{_job_name(job)}: {error}" if len(jobs) > 1 else str(error)) from error
    return jobs


def _launch(overrides: list[str], config_dirs: Sequence[Path]) -> None:
    import hydra

    register()
    arguments, sys.argv = sys.argv, ["radartwin", "--multirun", *overrides, *search_override(config_dirs)]
    try:
        hydra.main(config_path=str(conf_dir()), config_name=CONFIG_NAME, version_base="1.3")(_job)()
    finally:
        sys.argv = arguments


def _job(composed: DictConfig) -> None:
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    runtime = HydraConfig.get()
    overrides = list(runtime.overrides.task)
    unresolved = OmegaConf.to_container(runtime.runtime, resolve=False)  # Hydra wrote a plain path, which may hold ${
    name, folder = _job_name(overrides), Path(cast(dict, unresolved)["output_dir"])
    progress = Progress()
    progress.say(f"--- {name}")
    try:
        result, counts = run_experiment(typed(composed), overrides, progress)
        line = f"run {result.run_key[:8]}, simulated {counts.simulated}, reused {counts.reused}, scored {counts.scored}"
        outcome = Outcome(name, DONE, line)
    except UserError as error:
        outcome = Outcome(name, REFUSED, str(error))
    except Exception as error:
        traceback.print_exc()
        outcome = Outcome(name, FAILED, f"{type(error).__name__}: {error}".splitlines()[0])
    files.write_atomically(folder / OUTCOME, json.dumps(asdict(outcome)))


def _outcome(folder: Path, job: list[str]) -> Outcome:
    try:
        return Outcome(**json.loads((folder / OUTCOME).read_text(encoding="utf-8")))
    except FileNotFoundError:
        return Outcome(_job_name(job), FAILED, "it was interrupted; run the same command again to finish it")


def _job_name(overrides: Sequence[str]) -> str:
    return ",".join(f"{key}={value}" for key, value in telling(overrides).items()) or "defaults"


def _extend_path(config_dirs: Sequence[Path]) -> None:
    """A user's experiment module may lie in, or beside, the folder of its configuration; workers inherit the path."""
    for folder in config_dirs:
        for root in (str(folder.resolve()), str(folder.resolve().parent)):
            if root not in sys.path:
                sys.path.append(root)
                os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), root)))
