"""Where methods fail: the error of every method along sweeps of increasing difficulty (experiments/stability/sweeps.py), shown as a map.

The safe region of a method on a sweep starts at the easiest value and ends before the first value with an error above LIMIT_DB. The value
of a row is the number of swept values in that region.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from experiments.speed.methods import OURS, Method
from experiments.stability.sweeps import METHODS, SWEEPS, Sweep
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs import workers
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="stability",
    title="Where methods fail",
    caption="The error of every method along sweeps of increasing difficulty, against closed forms, series, quadrature and image "
    "sources. A row's value is the size of the method's safe region: the number of swept values, easiest first, before the error "
    "exceeds 3 dB. Methods without an absolute level are calibrated on a metal sphere at 1 m. The claim of the largest safe region "
    "also holds if another method's region is equally large.",
)

LIMIT_DB = 3.0
CLAIM = "the largest safe region of all methods"
FINITE = "no method crashes or returns what is no number"


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Run all sweeps. The quick and the paper profile compute the same sweeps."""
    rows: list[dict[str, Any]] = []
    parts = [(number, method) for number in range(len(SWEEPS)) for method in METHODS]
    with progress.task("sweeps by method", len(parts)) as done:
        found = iter(workers.each(_errors, parts, config.jobs, done))
    for sweep in SWEEPS:
        rows += sweep_rows(sweep, [(method, next(found)) for method in METHODS])
    broken = sum(math.isnan(float(one)) for row in rows for one in row["errors_db"].split())
    tried = sum(len(row["errors_db"].split()) for row in rows)
    rows.append({
        **dict.fromkeys(rows[0], ""), "sweep": "all", "title": "all sweeps", "claim": FINITE, "metric": "evaluations that broke",
        "paper": None, "value": float(broken), "low": float(broken), "high": float(broken), "n": tried, "domain": DOMAIN,
        "verdict": "fails" if broken else "holds",
    })  # fmt: skip
    metrics = {f"safe values of {row['sweep']}": row["value"] for row in rows if row["family"] == OURS} | {"broken": float(broken)}
    return Result(TABLE.name, rows, _figures(rows), metrics)


DOMAIN = "closed forms, series, quadrature, image sources"


def _figures(rows: list[dict[str, Any]]) -> dict[str, Callable[[], Figure]]:
    from experiments.stability import map

    return {"stability": lambda: map.map_of(rows)}


def _errors(number: int, method: Method) -> list[float]:
    """Return the errors of a method at all values of one sweep, in dB."""
    return [error(SWEEPS[number], method, value) for value in SWEEPS[number].values]


def error(sweep: Sweep, method: Method, value: float) -> float:
    """Return the error of a method at one value in dB; NaN if the method returns samples that are not finite."""
    try:
        return sweep.error_db(method, value)
    except FloatingPointError:
        return math.nan


def safe(errors_db: Sequence[float]) -> int:
    """Return the number of values before the first error above LIMIT_DB.

    >>> safe([0.1, 2.9, 3.1, 0.2])
    2
    """
    return next((i for i, one in enumerate(errors_db) if not one <= LIMIT_DB), len(errors_db))


def sweep_rows(sweep: Sweep, found: Sequence[tuple[Method, Sequence[float]]]) -> list[dict[str, Any]]:
    """Return the rows of one sweep, one per method. The row of this tracer has the claim that its safe region is the largest."""
    best = max(safe(errors) for _, errors in found)
    rows = []
    for method, errors in found:
        count = safe(errors)
        mine = method.family == OURS
        rows.append({
            "sweep": sweep.name, "title": sweep.title, "unit": sweep.unit, "kind": sweep.kind, "family": method.family,
            "setting": method.setting,
            "values": " ".join(f"{value:g}" for value in sweep.values), "errors_db": " ".join(f"{one:.2f}" for one in errors),
            "safe": safe_words(sweep, count), "fails at": f"{sweep.values[count]:g} {sweep.unit}" if count < len(errors) else "",
            "why": sweep.why if mine else "", "claim": CLAIM if mine else "", "run_keys": "",
            "metric": f"values before the error passes {LIMIT_DB:g} dB", "paper": None, "value": float(count), "low": float(count),
            "high": float(count), "n": len(errors), "domain": DOMAIN, "verdict": _verdict(count, best) if mine else "untestable",
        })  # fmt: skip
    return rows


def _verdict(count: int, best: int) -> str:
    return "holds" if count == best else "fails"


def safe_words(sweep: Sweep, count: int) -> str:
    """Return the safe region, the first `count` values, as text."""
    if not count:
        return "none"
    first, last = sweep.values[0], sweep.values[count - 1]
    return f"{first:g} {sweep.unit}" if count == 1 else f"{first:g} to {last:g} {sweep.unit}"
