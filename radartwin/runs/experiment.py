"""Define the interface between the runner and an experiment, which is a module with a function `run(config, store, progress) -> Result`."""

from __future__ import annotations

import importlib
import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol

from radartwin.config.study import ExperimentConfig
from radartwin.errors import ConfigError, InputError
from radartwin.io import files
from radartwin.runs import checkout
from radartwin.store import digest
from radartwin.store.products import Product, save_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCORE_COLUMNS = ("metric", "paper", "value", "low", "high", "n", "domain", "verdict")  # the last columns of every table, in this order
VERDICTS = ("supported", "direction shown", "undecided", "contradicted", "not testable here")  # experiments/verdicts.py says what they mean
# columns from which the verdict on a claim follows
JUDGED = ("bound", "direction", "null", "margin", "level", "family", "test", "unit", "p", "freedom", "interval_scale", "lowest", "highest")
LIMITS = ("holds", "misses")  # verdicts of tables that check limits, such as `validation`
TABLE_FILE = "table.csv"  # file with the rows in the folder of a stored result
MODELS = "models"  # name of the folder for trained models within a stored result


@dataclass
class Result:
    """The result of one experiment."""

    table: str
    rows: Sequence[dict[str, Any]]  # columns: the conditions, then SCORE_COLUMNS and `run_keys`
    figures: Mapping[str, Callable[[], Figure] | Path] = field(default_factory=dict)  # read from the store: paths without suffix
    metrics: Mapping[str, float] = field(default_factory=dict)  # numbers for MLflow, about thirty, without brackets in the names
    keys: list[str] = field(default_factory=list)  # keys of the stored data that the result was computed from
    run_key: str = ""  # set by the runner, as is `folder`
    folder: Path | None = None  # folder of the stored result, with the rows in TABLE_FILE
    models: Mapping[str, Model | Path] = field(default_factory=dict)  # trained models; read from the store: folders


@dataclass(frozen=True)
class Table:
    """Describes how the report shows the result table of an experiment. Each experiment module assigns its description to `TABLE`."""

    name: str  # of the experiment (conf/experiment/NAME.yaml) and of the files with its result table
    title: str
    caption: str
    chart: Callable[[Sequence[dict[str, Any]]], str] | None = None  # returns an HTML page with an interactive chart of the rows
    timed: bool = False  # whether the table states run times, so that no other table may be computed at the same time


class Model(Protocol):
    """A model that can be saved in a folder, such as radartwin.recognize.model.Recogniser."""

    def save(self, folder: str | Path) -> Path: ...


def module_name(experiment: ExperimentConfig) -> str:
    """Return the module name of the configured experiment. Raises ConfigError if no experiment is named or its name is not valid."""
    if not experiment.module and not experiment.name:
        raise ConfigError("no experiment was named; add experiment=NAME (radartwin run --help lists them)")
    name = experiment.module or f"experiments.{experiment.name}"
    if not all(part.isidentifier() for part in name.split(".")):
        key, value = ("module", experiment.module) if experiment.module else ("name", experiment.name)
        raise ConfigError(f"experiment.{key}={value} is not the name of a module; write letters, digits and underscores")
    return name


def load(experiment: ExperimentConfig) -> ModuleType:
    """Import and return the module of the experiment. Raises ConfigError if it is no experiment or does not read a configured option."""
    name = module_name(experiment)
    checkout.add_to_path()
    top = name.partition(".")[0]
    digest.include(top)
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name not in (name, top):
            raise
        hint = "run it from a checkout of the repository" if top == "experiments" else "put its folder on PYTHONPATH"
        raise ConfigError(f"experiment '{experiment.name or name}': there is no module {name}; {hint}") from None
    if not callable(getattr(module, "run", None)):
        raise ConfigError(f"experiment module {name} has no function run(config, store, progress)")
    if top == "experiments":  # the module of a user may read every option
        default, read = ExperimentConfig(), {"name", "module", *getattr(module, "READS", ())}
        for option in fields(experiment):
            if option.name not in read and getattr(experiment, option.name) != getattr(default, option.name):
                raise ConfigError(f"experiment.{option.name} is not read by experiment={experiment.name}; leave it out")
    return module


def declared(experiment: ExperimentConfig) -> Table:
    """Return the `TABLE` of the configured experiment's module. Raises ConfigError if the module declares none."""
    table = getattr(load(experiment), "TABLE", None)
    if not isinstance(table, Table):
        raise ConfigError(f"experiment module {module_name(experiment)} declares no table; add TABLE = Table(name, title, caption)")
    return table


def check_rows(table: str, rows: Sequence[dict[str, Any]]) -> None:
    """Check that every row of a table has the score columns, a known verdict, and a value inside its interval. Raises InputError."""
    for number, row in enumerate(rows, 1):
        where = f"table {table}, row {number}"
        missing = [c for c in (*SCORE_COLUMNS, "run_keys") if c not in row]
        if missing:
            raise InputError(f"{where}: column {missing[0]} is missing")
        if row["verdict"] not in (*VERDICTS, *LIMITS, ""):
            raise InputError(f"{where}: verdict {row['verdict']!r} is not one of {', '.join((*VERDICTS, *LIMITS))}, or empty")
        if not isinstance(row["n"], numbers.Integral) or row["n"] < 0:
            raise InputError(f"{where}: n counts stored runs or recordings and cannot be {row['n']!r}")
        value, low, high = (row[c] for c in ("value", "low", "high"))
        if value is None and row["verdict"] not in ("undecided", "not testable here", ""):
            raise InputError(f"{where}: the verdict is {row['verdict']!r} but the value is missing; give a value, or an empty verdict")
        if None not in (value, low, high) and not low <= value <= high:
            raise InputError(f"{where}: value {value} lies outside its interval {low} to {high}")


def check_result(result: Result) -> None:
    """Check the rows of a result (`check_rows`) and the names of its metrics. Raises InputError."""
    check_rows(result.table, result.rows)
    for name in result.metrics:
        if any(bracket in name for bracket in "[](){}"):
            raise InputError(f"metric '{name}' of table {result.table} has brackets in its name; MLflow refuses them")


def save(result: Result, folder: Path) -> None:
    """Draw the figures of a result and write the result to `folder`, which becomes its folder in the store."""
    check_result(result)
    rows = [{column: _plain(value) for column, value in row.items()} for row in result.rows]
    metrics = {name: float(value) for name, value in result.metrics.items()}
    names = {"figures": sorted(result.figures), "models": sorted(result.models)}
    save_json(folder, "result", {"table": result.table, "rows": rows, "metrics": metrics, "keys": result.keys, **names})
    columns = list(dict.fromkeys(column for row in rows for column in row))
    (folder / TABLE_FILE).write_text(files.csv_text(rows, columns), encoding="utf-8", newline="")
    for name, model in result.models.items():
        if not isinstance(model, Path):
            model.save(folder / MODELS / name)
    if result.figures:
        from radartwin.plotting import style

        for name, figure in result.figures.items():
            style.save(figure, folder / "figures" / name)


def read(product: Product) -> Result:
    """Read a result from its folder in the store, with the figures as paths without suffix. Raises InputError if it is damaged."""
    try:
        content = product.read_json("result")
        figures = {name: files.inside(product.path / "figures", name) for name in content["figures"]}
        models = {name: files.inside(product.path / MODELS, name) for name in content["models"]}
        check_rows(content["table"], content["rows"])
        return Result(content["table"], content["rows"], figures, content["metrics"], content["keys"], product.key, product.path, models)
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise InputError(f"{product.path} is not the result of a run ({error}); delete the folder and run again") from error


def _plain(value: Any) -> Any:
    """Convert a value for JSON: NumPy scalars become Python scalars, and NaN becomes None."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return value
    if isinstance(value, numbers.Integral):
        return int(value)
    if isinstance(value, numbers.Real):
        return float(value) if math.isfinite(float(value)) else None
    raise TypeError(f"a table cell cannot hold {type(value).__name__}")
