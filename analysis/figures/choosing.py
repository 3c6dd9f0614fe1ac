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
    """Read the rows of a committed table. Numbers become floats and empty cells None, except in text columns."""
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
    """Return the page docs/choosing.md as Markdown, from the rows of the three tables."""
    measured = [row for row in speed if not row["claim"] and row["profile_error_db"] is not None]
    parts = [
        "# Choosing a method and its settings",
        _paragraph(
            "`python -m analysis.figures.choosing` writes this page from `speed_accuracy.csv`, `stability.csv` and `complexity.csv` in "
            "`docs/results/`. Every value comes from these tables. Times are processor seconds of "
            f"{measured[0]['machine'].replace('; ', ', ')}. Times change with the load of the machine, so compare ratios of times."
        ),
        "## Run time against accuracy",
        "![Seconds per frame against error of the range profile, one panel per problem](figures/speed_accuracy.png)",
        _paragraph(
            "In the figure, methods on the left are fast and methods at the bottom are accurate. For each tolerance, the table gives "
            "the fastest setting whose error stays within the tolerance, then its error, then its time divided by the default's time "
            "(x). The profile error is the rms difference of the range profiles in dB, down to 40 dB below the peak. The signal error "
            "is the norm of the difference of the samples, divided by the norm of the reference. Simulators that know the exact "
            "answer are left out, because they work for one scene only. The problems in furnished rooms have no exact reference: there, "
            "an error is the difference from a run of this tracer with finer settings."
        ),
        _goals(measured),
        _paragraph(
            "The command-line options of these settings follow. A tube is a ray together with the part of the wavefront that it represents."
        ),
        _options(measured),
        "## Which model parts the features need",
        "![Models that simulator=auto chose, and their run times](figures/complexity.png)",
        _paragraph(
            "`simulator=auto` leaves out the parts of the model that the features in `features` do not need. The error that this adds "
            "to a feature must stay below the feature's repeatability limit: the difference between recordings of the same object "
            "after a new set-up. `simulator.tolerance=0.5` halves the allowed error. `simulator=auto` chooses the model on a few "
            "frames, prints its reasons and stores the choice. It does not change settings that you give (for instance "
            "`simulator.max_bounces=3`). The table shows the chosen models. The held-out error is that of the worst feature, divided "
            "by its repeatability limit, on frames that the choice did not use. The next column is the run time of the cheapest "
            "single setting that works for all cases (the fixed default), divided by the run time of the chosen model. Layers are "
            "needed if the shipped default without layered materials has an error above 1. In the column of the chosen model, `uncoupled` "
            "means without paths between object and room, `no cloud` without diffuse scatter, `0.25 tubes` with 0.25 tubes per square "
            "wavelength, and `planar` with plane waves across the array."
        ),
        _needed(complexity),
        "## The default",
        _paragraph(
            "The table gives the run time and the errors of the default on each problem. The factor from the Pareto front says by how "
            "much another method beats the default in both time and error: 1 means that no method does. The claim is a factor of at "
            "most 1.1. The last two columns are of RF-Genesis with the signal generator of its published program. Its time is divided by "
            "the default's time (x). The claim is a ratio of at least 500, with a larger error of RF-Genesis."
        ),
        _default(speed),
        "## Where methods fail",
        "![Error of each method along each sweep](figures/stability.png)",
        _paragraph(
            "Each sweep makes a scene harder, or a setting coarser, from value to value. The safe region of a method starts at the easiest "
            "value and ends before the first value with an error above 3 dB."
        ),
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
        "| case | feature set | chosen model | held-out error (repeatability limits) | fixed default's time over its own | layers needed |",
        "|---|---|---|---|---|---|",
    ]
    for row in complexity:
        if row["metric"] == "cost of the fixed default over auto's":
            layers = "yes" if row["without layers"] > 1 else "no"
            cells = [row["case"], row["features"], row["model"], f"{row['between']:.2g}", f"{row['value']:.2g} x", layers]
            lines.append(f"| {' | '.join(cells)} |")
    overall = [row for row in complexity if row["case"] == "all"]
    claims = [
        f'- {row["metric"]}: {row["value"]:.2g} ({row["model"] or "all cases"}). The claim "{row["claim"]}" {row["verdict"]}.'
        for row in overall
    ]
    names = _paragraph(
        "The results over all cases follow. The shipped default is `simulator=mitsuba` without other options. Errors are in repeatability "
        "limits, for the worst feature of the worst case, on the held-out frames, which lie between the frames of the choice."
    )
    return "\n".join([*lines, "", names, "", *claims])


def _method(row: Row, error: str, unit: str) -> str:
    return f"{row['family']}, {row['setting']}: {row[error]:.2g}{unit}, {row['value']:.2g} x"


def _options(measured: Sequence[Row]) -> str:
    mine = dict.fromkeys(row["setting"] for row in measured if row["family"] == OURS)
    return "\n".join(["| setting | options |", "|---|---|", *(f"| {setting} | `{options(setting)}` |" for setting in mine)])


def options(setting: str) -> str:
    """Return the command-line options that select a setting of this tracer."""
    return next(re.sub(pattern, option, setting) for pattern, option in OPTIONS.items() if re.fullmatch(pattern, setting))


def _default(speed: Sequence[Row]) -> str:
    heads = (
        "problem",
        "processor seconds per frame",
        "profile error",
        "signal error",
        "factor from the Pareto front",
        "time of RF-Genesis as published",
        "profile error of RF-Genesis",
    )
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    scored = [row for row in speed if row["profile_error_db"] is not None]
    for name in dict.fromkeys(row["problem"] for row in scored):
        mine = [row for row in scored if row["problem"] == name]
        own = next(row for row in mine if not row["claim"] and (row["family"], row["setting"]) == (OURS, DEFAULT))
        naive = next((row for row in mine if row["claim"] and row["family"] == RFGENESIS), None)
        cells = [own["title"], f"{own['seconds_frame']:.2g}", f"{own['profile_error_db']:.2g} dB", f"{own['signal_error']:.2g}"]
        claims = [row for row in mine if row["claim"] and "front" in row["metric"]]
        words = (f"{row['value']:.2f} by the {row['metric'].rpartition(' of the ')[2]} error, claim {row['verdict']}" for row in claims)
        cells.append("; ".join(words))
        cells.append(f"{naive['value']:.3g} x, claim {naive['verdict']}" if naive else "not run")
        cells.append(f"{naive['profile_error_db']:.2g} dB, {naive['free_error_db']:.2g} dB after the best gain" if naive else "")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _safe(stability: Sequence[Row]) -> str:
    lines = ["| sweep | safe region of this tracer | this tracer fails at | safe regions of other methods |", "|---|---|---|---|"]
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
    """Return a sentence that says whether other methods fail on the sweep too."""
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
