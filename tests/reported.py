"""Write an output folder in which the tables of a report have all possible states, in the same form as `radartwin tables`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from analysis import main, registry, table_runs
from experiments.speed.chart_page import COSTS, ERRORS
from experiments.speed.methods import DEFAULT, OURS
from radartwin.plotting import style
from radartwin.runs.experiment import Result

HOSTILE = "</script><script>document.title='taken'</script> \"'><img src=x onerror=alert(1)> {{script}} &amp;"
KEY, OLD_KEY = "a" * 32, "b" * 32


def row(**changes: Any) -> dict[str, Any]:
    given = {
        "room": "lab", "strength": 0.5, "claim": "closer than 3 dB", "run_keys": "abc def", "metric": "error", "paper": "1.5",
        "value": 1 / 3, "low": 0.25, "high": 0.5, "n": 3, "domain": "testbed", "verdict": "supported",
    }  # fmt: skip
    return {**given, **changes}


def rows() -> list[dict[str, Any]]:
    """Return table rows with every verdict, a row without a claim, and rows with hostile HTML in every text column."""
    return [
        row(),
        row(verdict="contradicted", value=7.0, low=6.0, high=8.0, strength=2.0),
        row(verdict="not testable here", value=None, low=None, high=None, n=0, strength=1.0),
        row(claim="", verdict="", strength=3.0),
        row(room=HOSTILE, claim=HOSTILE, metric=HOSTILE, paper=HOSTILE, run_keys=HOSTILE, verdict="contradicted"),
        *(row(strength=float(k), value=float(k), low=float(k), high=float(k)) for k in range(4, 20)),
    ]


def methods() -> list[dict[str, Any]]:
    """Return the rows of two simulation methods for one test problem, as in the table that compares speed and accuracy."""
    case = {
        "problem": "plate",
        "title": "a plate",
        "machine": "a laptop",
        "exact": False,
        "setup_s": 0.1,
        "frames timed": 3,
        "offset_db": 0.0,
    }
    case |= dict.fromkeys(ERRORS, 1.0) | {"claim": "", "verdict": "", "n": 3}
    return [
        row(**case, family=OURS, setting=DEFAULT, **dict.fromkeys(COSTS, 2.0)),
        row(**case, family="points", setting="table", **dict.fromkeys(COSTS, 1.0)),
    ]


def curve() -> Any:
    drawing, axes = style.figure()
    axes.plot([0, 1], [0, 1])
    return drawing


def write(output: Path, figures: Mapping[str, Callable[[], Any]] | None = None) -> Path:
    """Write three current tables, a stale table, a failed table and the report. Returns the path of the report. All other tables count as
    never run.
    """
    figures = {"environment_curve": curve} if figures is None else figures
    main.write(registry.table("environment"), Result("environment", rows(), figures, run_key=KEY), "quick", output)
    pair = {"gallery_mug_lab_turntable_1m": curve}
    main.write(registry.table("gallery"), Result("gallery", [row(claim="", verdict="")], pair, run_key=KEY), "quick", output)
    main.write(registry.table("speed_accuracy"), Result("speed_accuracy", methods(), {}, run_key=KEY), "quick", output)
    main.write(registry.table("stability"), Result("stability", [row(metric="an old figure")], {}, run_key=OLD_KEY), "paper", output)
    table_runs.add_failure(output, "positioning", KEY, "paper", RuntimeError(f"a cell {HOSTILE}\nand more"))
    return report(output)


def report(output: Path) -> Path:
    return main.write_report(output, current=lambda name, profile, output: KEY)
