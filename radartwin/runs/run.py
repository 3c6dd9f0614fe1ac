"""Run one experiment: compose the configuration, compute the result or read it from the store, and track the run in MLflow.

The result is saved before it is tracked. If tracking fails, the run warns, and the next run of the same configuration tracks it.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from radartwin import plugins
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.config.study import ExperimentConfig
from radartwin.io.one_line import plural
from radartwin.io.progress import Progress
from radartwin.runs.artifacts import Record
from radartwin.runs.experiment import LIMITS, TABLE_FILE, VERDICTS, Result, load, module_name, read, save
from radartwin.runs.tracking import Tracker
from radartwin.store import products
from radartwin.store.digest import semantic
from radartwin.store.products import RUN, Counts, Product, Store

_UNNAMED = ("experiment", "output", "jobs", "tracking", "hydra")  # overrides that are left out of the name of a run


def run_experiment(config: Config, overrides: Sequence[str] = (), progress: Progress | None = None) -> tuple[Result, Counts]:
    """Compute the result of a configured experiment, or read it from the store if an earlier run finished it.

    Returns: the result, and how many stored results were computed and how many were reused.

    Raises:
        UserError: the configuration cannot be run.
    """
    from radartwin.store import array_cache  # imports NumPy

    progress = progress or Progress()
    experiment = load(config.experiment)
    store = Store(Path(config.output) / "cache", progress.say)
    tracker = Tracker(config.tracking, Path(config.output))
    spec, entries = _identity(config)
    name, named = config.experiment.name or entries[0], naming(overrides)
    text = next(iter((experiment.__doc__ or "").strip().splitlines()), "")

    def build(folder: Path) -> None:
        with array_cache.in_folder(store.root / "paths"), _calling(config.experiment, "run"):
            computed = experiment.run(config, store, progress)
            if not isinstance(computed, Result):
                raise TypeError(f"the experiment returned {type(computed).__name__} and not radartwin.runs.experiment.Result")
            save(computed, folder)
        (folder / "config.json").write_text(json.dumps(asdict(config), indent=1) + "\n", encoding="utf-8")

    shown = name, _title(named) or name, named, text
    with products.counting() as counts, tracked(tracker, store, (RUN, spec, entries), build, *shown) as (product, record):
        result = read(product)
        record.metrics, record.artifacts = result.metrics, sorted(product.path.iterdir())
        record.inputs = _keys_by_kind(store, result.keys)
    return result, counts


@contextlib.contextmanager
def tracked(
    tracker: Tracker, store: Store, described: tuple[str, dict[str, Any], list[str]], build: Callable[[Path], object], table: str, *run: Any
) -> Iterator[tuple[Product, Record]]:
    """Fetch a stored result (kind, spec and entries as in `Store.fetch`) within an MLflow run, unless MLflow holds its run already.

    `run` holds the further arguments of `Tracker.run`. Yields the result, and the record to fill with the data to log.
    """
    key, records = store.key(*described), list[Record]()
    with contextlib.ExitStack() as runs:

        def build_tracked(folder: Path) -> None:
            records.append(runs.enter_context(tracker.run(table, key, *run)))
            build(folder)

        product = store.fetch(*described, build_tracked)
        if product.reused and not tracker.known(table, key):  # computed with tracking=off, or tracked on another server
            records.append(runs.enter_context(tracker.run(table, key, *run)))
        yield product, records[0] if records else Record()


def _calling(experiment: ExperimentConfig, what: str) -> contextlib.AbstractContextManager[None]:
    """Return a context manager that converts exceptions to one line if the experiment is a plug-in, see `plugins.calling`."""
    plugin = plugins.find(plugins.EXPERIMENTS, experiment.name) if experiment.name else None
    if plugin is None or plugin.module != experiment.module:
        return contextlib.nullcontext()
    return plugins.calling(plugin, what)


def _keys_by_kind(store: Store, keys: Sequence[str]) -> dict[str, list[str]]:
    """Group keys of stored data by the kind of data. A key that the store does not hold belongs to a recording set of the user."""
    by_kind: dict[str, list[str]] = {}
    for key in keys:
        place = next(store.root.glob(f"*/{key}"), None)
        by_kind.setdefault(place.parent.name if place else "recordings", []).append(key)
    return by_kind


def finished(config: Config) -> bool:
    return Store(Path(config.output) / "cache").holds(RUN, *_identity(config))


def run_key(config: Config) -> str:
    """Return the run key: the digest that identifies the result of this configuration with the current source code."""
    return Store(Path(config.output) / "cache").key(RUN, *_identity(config))


def _identity(config: Config) -> tuple[dict[str, Any], list[str]]:
    """Return the values of the run key (the configuration and additions of the experiment module), and the experiment's modules."""
    identity = getattr(load(config.experiment), "identity", dict)
    with _calling(config.experiment, "identity"):
        additions = identity()
    return {"config": semantic(config), **additions}, [module_name(config.experiment)]


def naming(overrides: Sequence[str]) -> dict[str, str]:
    """Return the overrides that distinguish this run from other runs of the same table, as a mapping such as {"materials": "void"}."""
    pairs = (override.lstrip("+~").partition("=") for override in overrides)
    return {key: value for key, _, value in pairs if key.partition(".")[0].partition("/")[0] not in _UNNAMED}


def _title(named: Mapping[str, str]) -> str:
    """Return the values of the overrides as the name of a run. A number has the last word of its option before it.

    >>> _title({"materials": "uniform", "simulator": "mitsuba", "trajectory.height_m": "1.5"})
    'uniform, mitsuba, height_m 1.5'
    """
    return ", ".join(value if value[:1].isalpha() else f"{key.rpartition('.')[2]} {value}" for key, value in named.items())


def summary(result: Result) -> str:
    """Format the number of table rows with each verdict, and the metrics, as lines for a terminal."""
    counts = Counter(row["verdict"] for row in result.rows)
    verdicts = ", ".join(f"{counts[word]} {word}" for word in (*VERDICTS, *LIMITS) if counts[word]) or "no verdicts"
    numbers = [f"  {name} = {value:.4g}" for name, value in result.metrics.items()]
    return "\n".join([f"{result.table}: {plural(len(result.rows), 'row')} ({verdicts}); run {result.run_key[:8]}", *numbers])


def run(overrides: Sequence[str], config_dirs: Sequence[Path] = ()) -> int:
    extend_path(config_dirs)
    config = compose(overrides, config_dirs)
    result, counts = run_experiment(config, overrides)
    page = getattr(load(config.experiment), "page", None)
    if callable(page):  # the experiment module may define a function that prints its rows
        with _calling(config.experiment, "page"):
            print(page(result.rows))
    print(summary(result))
    if result.folder:
        print(f"table: {result.folder / TABLE_FILE}")
    print(f"run: {counts}")
    return 0


def print_config(overrides: Sequence[str], config_dirs: Sequence[Path] = ()) -> int:
    """Print the composed and checked configuration as YAML, without a run."""
    import yaml

    print(yaml.safe_dump(asdict(compose(overrides, config_dirs)), sort_keys=False), end="")
    return 0


def extend_path(config_dirs: Sequence[Path]) -> None:
    """Let Python import the user's experiment modules from each configuration folder and its parent folder, also in worker processes."""
    for folder in config_dirs:
        for root in (str(folder.resolve()), str(folder.resolve().parent)):
            if root not in sys.path:
                sys.path.append(root)
                os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (os.environ.get("PYTHONPATH"), root)))
