"""Write docs/choosing.md and its pictures from the committed results only.

radartwin tables --profile paper --only speed_accuracy --only stability --only complexity
cp outputs/tables/{speed_accuracy,stability,complexity}.csv docs/results/ && python -m analysis.figures.choosing
"""

from __future__ import annotations

import csv
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.speed.methods import DEFAULT, OURS, RFGENESIS
from radartwin.io import files
from radartwin.plotting import style

ROOT = Path(__file__).resolve().parents[2]
RESULTS, PAGE, FIGURES = ROOT / "docs" / "results", ROOT / "docs" / "choosing.md", ROOT / "docs" / "figures"
NAMES = ("speed_accuracy", "stability", "complexity")
GOALS = (
    ("profile_error_db", 3.0, "profile", " dB"), ("profile_error_db", 1.0, "profile", " dB"), ("signal_error", 0.1, "signal", ""),
    ("signal_error", 0.03, "signal", ""),
)  # fmt: skip
OPTIONS: dict[str, Any] = {
    "default": "simulator=mitsuba",
    "([0-9.]+) tubes per square wavelength": r"simulator.rays_per_wavelength2=\1",
    "([0-9]+) bounces?": r"simulator.max_bounces=\1",
    "planar elements": "simulator.elements=planar",
    "object and room uncoupled": "simulator.coupling=false",
    "no diffuse cloud": "simulator.diffuse=false",
    "tubes, ([0-9.]+) million": lambda found: f"simulator.room=tubes simulator.rays={1e6 * float(found[1]):.0f}",
    "room by tubes.*": "simulator.room=tubes",
}
Row = Mapping[str, Any]
KINDS = {
    "numerical": "Numerical: a finer setting removes the error",
    "a setting": "A setting: a higher value removes the error and takes more time",
    "knowledge": "Knowledge: the scan lacks this property of the scene, and no setting replaces it",
    "physical": "Physical: a limit of the sensor, the wave or the model",
}


def read(name: str, folder: Path = RESULTS) -> list[dict[str, Any]]:
    """Rows of a committed table, with numbers as numbers and empty cells as None, except in text columns."""
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return [{key: _value(key, text) for key, text in row.items()} for row in csv.DictReader(stream)]


def _value(key: str, text: str) -> Any:
    if key in ("values", "errors_db", "claim", "family", "fails at", "why", "run_keys"):
        return text
    if text in ("True", "False"):
        return text == "True"
    try:
        return float(text) if text else None
    except ValueError:
        return text


def text(speed: Sequence[Row], stability: Sequence[Row], complexity: Sequence[Row]) -> str:
    """The page."""
    measured = [row for row in speed if not row["claim"] and row["profile_error_db"] is not None]
    parts = [
        "# Choosing a method and its settings",
        _paragraph(
            "`python -m analysis.figures.choosing` writes this page from `speed_accuracy.csv`, `stability.csv` and `complexity.csv` in "
            "`docs/results/`. Every value comes from these tables. Times are processor seconds of "
            f"{measured[0]['machine'].replace('; ', ', ')}. They change with the load of the machine, so compare ratios."
        ),
        "## What accuracy costs",
        "![Seconds per frame against error of the range profile, one panel per problem](figures/speed_accuracy.png)",
        _paragraph(
            "Left is fast, low is accurate. The table gives the cheapest setting that keeps an error within a tolerance, with its "
            "error and its time relative to the default. The profile error is the rms of the range profile over 40 dB; the signal "
            "error is relative to the norm of the signal. Exact references are left out, because they work for one scene only. "
            "Where the reference is this tracer's own finer run, an error is the distance from that run."
        ),
        _goals(measured),
        "Options of the settings:",
        _options(measured),
        "## How much model the features need",
        "![Models that simulator=auto chose, and their run times](figures/complexity.png)",
        _paragraph(
            "`simulator=auto` leaves out the parts of the model that the features in `features` do not need. A feature may move by "
            "as much as recordings of the same object differ after a new set-up; `simulator.tolerance=0.5` halves that. The choice "
            "is made on a few frames, reports its reasons and is kept. Settings that you give stay unchanged (for instance "
            "`simulator.max_bounces=3`). The table shows the chosen models, and how much cheaper each is than the cheapest single "
            "setting that works for all cases."
        ),
        _needed(complexity),
        "## The default",
        _default(speed),
        "## Where methods fail",
        "![Error of each method along each sweep](figures/stability.png)",
        "A safe region contains the values before the first error above 3 dB, easiest values first.",
        _safe(stability),
        "## Kinds of failure",
        _kinds(stability),
    ]
    return "\n\n".join(parts) + "\n"


def _paragraph(words: str) -> str:
    return textwrap.fill(words, 150, break_long_words=False, break_on_hyphens=False)


def _goals(measured: Sequence[Row]) -> str:
    heads = ["problem", *(f"{words} within {goal:g}{unit}" for _, goal, words, unit in GOALS)]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name in dict.fromkeys(row["problem"] for row in measured):
        mine = [row for row in measured if row["problem"] == name and not row["exact"]]
        cells = []
        for error, goal, _, unit in GOALS:
            enough = [row for row in mine if row[error] <= goal]
            best = min(enough or mine, key=lambda row: row["seconds_frame" if enough else error])
            cells.append(("" if enough else "none; nearest is ") + _method(best, error, unit))
        lines.append(f"| {mine[0]['title']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _needed(complexity: Sequence[Row]) -> str:
    lines = [
        "| case | features | model | held-out error, in limits | times cheaper | layers needed |",
        "|---|---|---|---|---|---|",
    ]
    for row in complexity:
        if row["metric"] == "cost of the fixed default over auto's":
            layers = "yes" if row["without layers"] > 1 else "no"
            cells = [row["case"], row["features"], row["model"], f"{row['between']:.2g}", f"{row['value']:.2g} x", layers]
            lines.append(f"| {' | '.join(cells)} |")
    overall = [row for row in complexity if row["case"] == "all"]
    claims = [
        f"- {row['metric']}: {row['value']:.2g}; {row['claim']}: {row['verdict']} ({row['model'] or 'all cases'})." for row in overall
    ]
    return "\n".join([*lines, "", *claims])


def _method(row: Row, error: str, unit: str) -> str:
    return f"{row['family']}, {row['setting']}: {row[error]:.2g}{unit}, {row['value']:.2g} x"


def _options(measured: Sequence[Row]) -> str:
    mine = dict.fromkeys(row["setting"] for row in measured if row["family"] == OURS)
    return "\n".join(["| setting | options |", "|---|---|", *(f"| {setting} | `{options(setting)}` |" for setting in mine)])


def options(setting: str) -> str:
    """The command-line options of a setting of this tracer."""
    return next(re.sub(pattern, option, setting) for pattern, option in OPTIONS.items() if re.fullmatch(pattern, setting))


def _default(speed: Sequence[Row]) -> str:
    heads = (
        "problem",
        "processor seconds per frame",
        "range profile",
        "signal",
        "distance from the front",
        "RF-Genesis as published",
        "error of RF-Genesis",
    )
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    scored = [row for row in speed if row["profile_error_db"] is not None]
    for name in dict.fromkeys(row["problem"] for row in scored):
        mine = [row for row in scored if row["problem"] == name]
        own = next(row for row in mine if not row["claim"] and (row["family"], row["setting"]) == (OURS, DEFAULT))
        naive = next((row for row in mine if row["claim"] and row["family"] == RFGENESIS), None)
        cells = [own["title"], f"{own['seconds_frame']:.2g}", f"{own['profile_error_db']:.2g} dB", f"{own['signal_error']:.2g}"]
        claims = [row for row in mine if row["claim"] and "front" in row["metric"]]
        cells.append("; ".join(f"{row['value']:.2f} by the {row['metric'].rpartition(' of the ')[2]}, {row['verdict']}" for row in claims))
        cells.append(f"{naive['value']:.3g} times its time; 500 times {naive['verdict']}" if naive else "not run")
        cells.append(f"{naive['profile_error_db']:.2g} dB, {naive['free_error_db']:.2g} dB after one gain" if naive else "")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _safe(stability: Sequence[Row]) -> str:
    lines = ["| sweep | this tracer is safe at | fails at | safe regions of other methods |", "|---|---|---|---|"]
    for mine in _sweeps(stability).values():
        own = next(row for row in mine if row["family"] == OURS)
        others = [f"{_family(row)}: {row['safe']}" for row in mine if row is not own and row["value"]]
        wider = "" if own["verdict"] == "holds" else " (not the largest)"
        lines.append(f"| {own['title']} | {own['safe']}{wider} | {own['fails at'] or 'nowhere'} | {'; '.join(others) or 'none'} |")
    return "\n".join(lines)


def _family(row: Row) -> str:
    return f"{row['family']} {row['setting']}" if row["family"] == RFGENESIS else row["family"]


def _kinds(stability: Sequence[Row]) -> str:
    parts = []
    for kind, words in KINDS.items():
        lines = [f"**{words}.**"]
        for mine in _sweeps(stability).values():
            own = next(row for row in mine if row["family"] == OURS)
            if own["kind"] != kind:
                continue
            lines.append(f"- {own['title'][0].upper()}{own['title'][1:]}: {own['why']}.{_shared(own, mine)}")
        if len(lines) > 1:
            parts.append("\n".join(lines[:1]) + "\n\n" + "\n".join(lines[1:]))
    return "\n\n".join(parts)


def _shared(own: Row, mine: Sequence[Row]) -> str:
    """A sentence on whether other methods fail on the sweep too."""
    others = [row for row in mine if row is not own and row["value"]]
    if not own["fails at"]:
        return " This tracer does not fail in this range."
    if not others:
        return " No other method is safe anywhere on this sweep."
    same = all(row["value"] == own["value"] for row in others)
    return " Every method with a safe region fails at the same value." if same else ""


def _sweeps(stability: Sequence[Row]) -> dict[str, list[Row]]:
    return {
        name: [row for row in stability if row["sweep"] == name] for name in dict.fromkeys(r["sweep"] for r in stability if r["family"])
    }


def main() -> None:
    from experiments.complexity import figure
    from experiments.speed import chart
    from experiments.stability import map

    speed, stability, complexity = (read(name) for name in NAMES)
    files.write_atomically(PAGE, text(speed, stability, complexity))
    drawn = {
        "speed_accuracy": lambda: chart.chart(speed, "profile_error_db"),
        "stability": lambda: map.map_of(stability),
        "complexity": lambda: figure.chart(complexity),
    }
    for name, draw in drawn.items():
        for path in style.save(draw, FIGURES / name):
            if path.suffix != ".png":
                path.unlink()
    print(PAGE)


if __name__ == "__main__":
    main()
