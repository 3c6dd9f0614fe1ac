"""Declare the figures of the benchmarks with their targets, and compare measured values with the targets and with earlier runs.

The targets hold for 2 processor cores. A value is compared with the median of earlier runs of the same processor, number of cores and
Mitsuba variant. A step is a change beyond the scatter of the earlier runs, as in the step detection of airspeed velocity (asv). If the next
runs show a step too, the step is lasting and not a disturbance of a single run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

LAST = 10  # number of earlier runs that a value is compared with
FEWEST = 3  # fewest earlier runs for a comparison
SCATTER = 3.0  # a step exceeds this many median absolute deviations of the earlier runs,
STEP = 0.15  # and also this share of their median
COMPARABLE = ("processor", "cores", "variant")  # columns of the history that are equal in comparable runs

PROJECT = "performance target of the project on 2 processor cores"


@dataclass(frozen=True)
class Figure:
    """Describe a figure that a benchmark measures.

    Attributes:
        unit: unit of value and target; empty for ratios.
        target: worst value that passes; None if the figure has no target.
        source: where the target comes from.
        benchmark: name of the benchmark that measures the figure.
        better: whether smaller or larger values are better.
    """

    name: str
    unit: str
    target: float | None
    source: str
    benchmark: str
    better: Literal["smaller", "larger"] = "smaller"

    @property
    def column(self) -> str:
        """Return the column of the history, which is the name with the unit."""
        return f"{self.name}, {self.unit}" if self.unit else self.name

    def passes(self, value: float) -> bool:
        """Return whether a value reaches the target; a figure without target always passes."""
        return self.target is None or (value <= self.target if self.better == "smaller" else value >= self.target)


FIGURES = (
    Figure("gridding of 5,000 paths x 8 channels", "ms/frame", 10, PROJECT, "synthesis"),
    Figure("gridding of 100,000 paths at 0.0 m/s", "ms/frame", None, "", "synthesis"),
    Figure("gridding of 100,000 paths at 0.5 m/s", "ms/frame", None, "", "synthesis"),
    Figure("gridding of 1,000,000 paths at 0.5 m/s", "ms/frame", None, "", "synthesis"),
    Figure("direct sum to gridding at 0.0 m/s", "", 80, PROJECT, "synthesis", "larger"),
    Figure("exact to planar elements at 0.0 m/s", "", None, "", "synthesis"),
    Figure("direct sum to gridding at 0.5 m/s", "", 80, PROJECT, "synthesis", "larger"),
    Figure("exact to planar elements at 0.5 m/s", "", None, "", "synthesis"),
    Figure("object only, 100 frames in one call", "frames/s", 1000, PROJECT, "frames", "larger"),
    Figure("object in a static furnished room", "ms/frame", 30, PROJECT, "frames"),
    Figure("moving sensor and object, flat faces", "ms/frame", 30, PROJECT, "frames"),
    Figure("moving sensor and object, tubes alone", "ms/frame", 250, PROJECT, "frames"),
    Figure("moving sensor, resting target, flat faces", "ms/frame", 30, PROJECT, "frames"),
    Figure("static room to object only", "", None, "", "frames"),
    Figure("moving, tubes alone to flat faces", "", None, "", "frames", "larger"),
    Figure("one frame in one call, sphere", "ms", 3, PROJECT, "single"),
    Figure("one frame in one call, corner reflector", "ms", 3, PROJECT, "single"),
    Figure("drive frame", "ms/frame", 30, PROJECT, "drives"),
    Figure("track set-up", "s", None, "", "drives"),
    Figure("object track set-up", "s", None, "", "drives"),
    Figure("drive frame past a can", "ms/frame", 30, PROJECT, "drives"),
    Figure("drive frame past a can, clutter", "ms/frame", 30, PROJECT, "drives"),
    Figure("track set-up, clutter", "s", None, "", "drives"),
    Figure("memory of a furnished room", "GiB", None, "", "memory"),
    Figure("reconstruction of a scan", "s", None, "", "scan"),
    Figure("memory of a scan reconstruction", "GiB", None, "", "scan"),
)


def earlier(history: pd.DataFrame, machine: Mapping[str, object], column: str) -> list[float]:
    """Return the values of a column in the last comparable runs of the history, whose cells are text."""
    if column not in history:
        return []
    machine_of = {name: str(machine[name]) for name in COMPARABLE}
    runs = history.to_dict("records")
    return [float(run[column]) for run in runs if run.items() >= machine_of.items() and not pd.isna(run[column])][-LAST:]


def change(figure: Figure, value: float, before: Sequence[float]) -> str:
    """Describe the change of a value against the values of earlier runs, e.g. "+20 % STEP slower"."""
    if len(before) < FEWEST:
        return "no history yet"
    median = float(np.median(before))
    limit = max(SCATTER * float(np.median(np.abs(np.array(before) - median))), STEP * abs(median))
    text = f"{100 * (value / median - 1):+.0f} %"
    if abs(value - median) <= limit:
        return text
    worse = (value > median) == (figure.better == "smaller")
    words = ("larger", "smaller") if figure.unit == "GiB" else ("slower", "faster")
    return f"{text} STEP {words[0 if worse else 1]}"


def table(values: Mapping[str, float], history: pd.DataFrame, machine: Mapping[str, object]) -> str:
    """Return a table of the measured figures: value, target, pass or miss, and change against the median of earlier runs."""
    rows = [("figure", "value", "target", "", f"against the median of at most {LAST} earlier runs")]
    for figure in FIGURES:
        if figure.name in values:
            value = values[figure.name]
            bound = "at most" if figure.better == "smaller" else "at least"
            target = "-" if figure.target is None else f"{bound} {figure.target:g}"
            verdict = "-" if figure.target is None else "pass" if figure.passes(value) else "miss"
            rows.append((figure.column, f"{value:.4g}", target, verdict, change(figure, value, earlier(history, machine, figure.column))))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows)
