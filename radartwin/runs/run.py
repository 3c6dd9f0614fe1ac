"""One experiment: compose -> store -> experiment -> track, with resume. A sweep of them is radartwin/runs/sweep.py.

The result is in the store before it is in MLflow: a tracking store that fails at the end costs a warning, not the result,
and the next start of the same run tracks it.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs.artifacts import Record
from radartwin.runs.experiment import Result, load, module_name, read, save
from radartwin.runs.tracking import Tracker
from radartwin.store.digest import semantic
from radartwin.store.products import RUN, Counts, Store

_UNTOLD = ("experiment", "output", "jobs", "tracking", "hydra")  # overrides that do not tell runs of one table apart


def run_experiment(config: Config, overrides: Sequence[str] = (), progress: Progress | None = None) -> tuple[Result, Counts]:
    """The result of a composed experiment, computed or read back, and what that took.

    Raises:
        UserError: what the configuration asks for cannot be done.
    """
    from radartwin.store import array_cache  # imports the numerical packages

    progress = progress or Progress()
    experiment = load(config.experiment)
    store = Store(Path(config.output) / "cache", progress.say)
    tracker = Tracker(config.tracking, Path(config.output))
    spec, roots = _identity(config)
    key = store.key(RUN, spec, roots)
    name, told = config.experiment.name or roots[0], telling(overrides)
    title = ",".join(f"{k}={v}" for k, v in told.items()) or name

    with contextlib.ExitStack() as tracked:
        records: list[Record] = []

        def track() -> None:
            records.append(tracked.enter_context(tracker.run(name, key, title, told)))

        def build(folder: Path) -> None:
            track()
            with array_cache.in_folder(store.root / "paths"):
                computed = experiment.run(config, store, progress)
            save(computed, folder)
            (folder / "config.json").write_text(json.dumps(asdict(config), indent=1) + "\n", encoding="utf-8")

        product = store.fetch(RUN, spec, roots, build)
        result = read(product)
        if product.reused and not tracker.known(name, key):  # computed with tracking=off, or tracked elsewhere
            track()
        for record in records:
            record.metrics, record.artifacts = result.metrics, sorted(product.path.iterdir())
            record.rows, record.inputs = result.rows, _kinds(store, result.keys)
    return result, store.counts


def _kinds(store: Store, keys: Sequence[str]) -> dict[str, list[str]]:
    """Keys by the kind of product they name in the store; others are of a user's recording set."""
    found: dict[str, list[str]] = {}
    for key in keys:
        place = next(store.root.glob(f"*/{key}"), None)
        found.setdefault(place.parent.name if place else "recordings", []).append(key)
    return found


def finished(config: Config) -> bool:
    """Whether the run of this configuration is in the store, whole."""
    load(config.experiment)
    return Store(Path(config.output) / "cache").holds(RUN, *_identity(config))


def run_key(config: Config) -> str:
    """Key that the run of this configuration has, or would have, with the source as it is now."""
    load(config.experiment)
    return Store(Path(config.output) / "cache").key(RUN, *_identity(config))


def _identity(config: Config) -> tuple[dict[str, Any], list[str]]:
    """What the key of a run is made of: its semantic configuration, what its module adds (a machine it times), and that module."""
    own = getattr(load(config.experiment), "identity", dict)()
    return {"config": semantic(config), **own}, [module_name(config.experiment)]


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
    extend_path(config_dirs)
    config = compose(overrides, config_dirs)
    result, counts = run_experiment(config, overrides)
    page = getattr(load(config.experiment), "page", None)
    if callable(page):  # an experiment that is read row by row says how
        print(page(result.rows))
    print(summary(result))
    print(f"run: simulated {counts.simulated}, reused {counts.reused}, scored {counts.scored}")
    return 0


def extend_path(config_dirs: Sequence[Path]) -> None:
    """A user's experiment module may lie in, or beside, the folder of its configuration; workers inherit the path."""
    for folder in config_dirs:
        for root in (str(folder.resolve()), str(folder.resolve().parent)):
            if root not in sys.path:
                sys.path.append(root)
                os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), root)))
