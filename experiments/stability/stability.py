"""Show where simulation methods fail: the error of every method along sweeps of increasing difficulty (experiments/stability/sweeps.py)."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments import verdicts
from experiments.drawing import PAGE_WIDTH_IN, Figure, figure
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.speed.methods import OURS, Method
from experiments.stability.sweeps import METHODS, SWEEPS, Sweep
from experiments.statistics import exact
from radartwin.runs import workers

TABLE = Table(
    name="stability",
    title="Where methods fail",
    caption="The error of every method along sweeps of increasing difficulty, against closed forms, series, quadrature, image sources "
    "and full-wave fields. A row's value is the size of the method's safe region: the number of swept values, easiest first, before the "
    "error exceeds 3 dB. Methods without an absolute level are calibrated on a metal sphere at 1 m. The claim of the largest safe region "
    "also holds if another method's region is equally large, and misses if no value is safe.",
)

LIMIT_DB = 3.0
METRIC = f"values before the error passes {LIMIT_DB:g} dB"
DOMAIN = "closed forms, series, quadrature, image sources, full-wave fields"
CLAIM = "the largest safe region of all methods"
FINITE = "no method crashes or returns a value that is not a number"
COLUMNS = 2  # columns of panels in the figure
STEPS_DB = (0.0, 0.5, 1.0, 3.0, 6.0, 12.0, 40.0)
COLOURS = ("#08519c", "#4292c6", "#9ecae1", "#fdd0a2", "#fd8d3c", "#a63603")  # blue is safe, brown is not; readable with colour blindness
NAMES = {"this tracer": "this tracer", "points": "points, RCS table", "Sionna RT": "Sionna RT"}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the errors of all methods along all sweeps. The quick and the paper profile compute the same sweeps."""
    rows: list[dict[str, Any]] = []
    parts = [(sweep, method) for sweep in SWEEPS for method in METHODS]
    with progress.task("sweeps by method", len(parts)) as done:
        errors = iter(workers.each(errors_of, parts, config.jobs, done))
    for sweep in SWEEPS:
        rows += sweep_rows(sweep, [(method, next(errors)) for method in METHODS])
    broken = sum(math.isnan(float(error_db)) for row in rows for error_db in row["errors_db"].split())
    tried = sum(len(row["errors_db"].split()) for row in rows)
    score = verdicts.score_columns("evaluations that broke", exact(broken, tried), DOMAIN, not broken)
    rows.append({**dict.fromkeys(rows[0], ""), "sweep": "all", "title": "all sweeps", "claim": FINITE, **score})
    metrics = {f"safe values of {row['sweep']}": row["value"] for row in rows if row["family"] == OURS} | {"broken": float(broken)}
    return Result(TABLE.name, rows, {TABLE.name: lambda: map_of(rows)}, metrics)


def errors_of(sweep: Sweep, method: Method) -> list[float]:
    """Return the errors of a method in dB at all values of a sweep; NaN where a sample of the method is not finite."""
    errors = []
    for value in sweep.values:
        try:
            errors.append(sweep.error_db(method, value))
        except FloatingPointError:
            errors.append(math.nan)
    return errors


def safe(errors_db: Sequence[float]) -> int:
    """Return the number of sweep values before the first value whose error is above LIMIT_DB.

    >>> safe([0.1, 2.9, 3.1, 0.2])
    2
    """
    return next((i for i, error_db in enumerate(errors_db) if not error_db <= LIMIT_DB), len(errors_db))


def sweep_rows(sweep: Sweep, by_method: Sequence[tuple[Method, Sequence[float]]]) -> list[dict[str, Any]]:
    """Return the rows of one sweep. The row of our tracer claims that no other method has a larger safe region."""
    best = max(safe(errors) for _, errors in by_method)
    rows = []
    for method, errors in by_method:
        count = safe(errors)
        mine = method.family == OURS
        rows.append({
            "sweep": sweep.name, "title": sweep.title, "unit": sweep.unit, "kind": sweep.kind, "family": method.family,
            "setting": method.setting,
            "values": " ".join(f"{value:g}" for value in sweep.values), "errors_db": " ".join(f"{error_db:.2f}" for error_db in errors),
            "safe": safe_words(sweep, count), "fails at": f"{sweep.values[count]:g} {sweep.unit}" if count < len(errors) else "",
            "why": sweep.why if mine else "", "claim": CLAIM if mine else "",
            **verdicts.score_columns(METRIC, exact(count, len(errors)), DOMAIN, count == best > 0 if mine else None),
        })  # fmt: skip
    return rows


def safe_words(sweep: Sweep, count: int) -> str:
    """Return as text the safe region of a sweep, which consists of the first `count` values."""
    if not count:
        return "none"
    first, last = sweep.values[0], sweep.values[count - 1]
    return f"{first:g} {sweep.unit}" if count == 1 else f"{first:g} to {last:g} {sweep.unit}"


def map_of(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw a map of the error of every method at every value of the sweeps, with the first value at which a method fails."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    rows = [row for row in rows if row["family"]]
    names = list(dict.fromkeys(row["sweep"] for row in rows))
    lines = -(-len(names) // COLUMNS)
    drawing, panels = figure(lines, COLUMNS, width_in=PAGE_WIDTH_IN * 1.25, height_in=1.16 * lines + 0.5)
    colours, norm = ListedColormap(COLOURS), BoundaryNorm(STEPS_DB, len(COLOURS))
    for panel, name in zip(panels.T.flat, names, strict=False):
        _block(panel, [row for row in rows if row["sweep"] == name], colours, norm)
    for panel in panels.T.flat[len(names) :]:
        panel.set_axis_off()
    images = [panel.images[0] for panel in panels.flat if panel.images]
    free = panels.T.flat[len(names)] if len(names) < panels.size else None
    bar = drawing.colorbar(images[0], ax=free or panels, orientation="horizontal", fraction=0.5 if free else 0.02, pad=0.05, aspect=30)
    bar.set_label("error against the reference (dB); frame: first error above 3 dB, which ends the safe region")
    return drawing


def _block(panel: Any, mine: Sequence[Mapping[str, Any]], colours: Any, norm: Any) -> None:
    from matplotlib.patches import Rectangle

    errors = np.array([[float(error_db) for error_db in row["errors_db"].split()] for row in mine])
    values = mine[0]["values"].split()
    panel.imshow(np.nan_to_num(errors, nan=40.0), cmap=colours, norm=norm, aspect="auto")
    panel.set_xticks(range(len(values)), values)
    panel.set_yticks(range(len(mine)), [NAMES.get(row["family"], f"{row['family'].split()[0]}, {row['setting']}") for row in mine])
    panel.tick_params(length=0, pad=2)
    for side in panel.spines.values():
        side.set_visible(False)
    panel.set_title(f"{mine[0]['title']}, {mine[0]['unit']} ({mine[0]['kind']})", pad=3, loc="left")
    for line, row in enumerate(errors):
        for column, error_db in enumerate(row):
            text = "40+" if error_db >= 40 else f"{error_db:.1f}" if error_db < 9.95 else f"{error_db:.0f}"
            panel.text(column, line, text, ha="center", va="center", color="white" if error_db < 1 or error_db >= 12 else "black")
        panel.text(len(row) - 0.42, line, verdict(mine[line]), va="center")
        if words := mine[line]["fails at"]:
            corner = values.index(words.split()[0]) - 0.48, line - 0.46
            panel.add_patch(Rectangle(corner, 0.96, 0.92, fill=False, ec="black", lw=0.9))


def verdict(row: Mapping[str, Any]) -> str:
    """Return as text the value of the sweep at which a method fails."""
    return "safe throughout" if not row["fails at"] else "never safe" if not row["value"] else f"fails at {row['fails at']}"
