"""Write the page docs/choosing.md and its pictures from the committed tables in docs/results only.

These commands renew the tables and the page:

radartwin tables --profile paper --only speed_accuracy --only stability --only complexity
cp outputs/tables/{speed_accuracy,stability,complexity}.csv docs/results/ && python -m analysis.pages
"""

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.pages.template import RESULTS, ROOT, filled
from experiments.complexity import rows as complexity_rows
from experiments.speed import chart
from experiments.speed.methods import DEFAULT, OURS, RFGENESIS
from experiments.stability import stability as stability_table
from radartwin.plotting import style

PAGE, FIGURES = ROOT / "docs" / "choosing.md", ROOT / "docs" / "figures"
TEMPLATE = Path(__file__).with_name("choosing_template.md")
GOALS = (("profile_error_db", 3.0, " dB"), ("profile_error_db", 1.0, " dB"), ("signal_error", 0.1, ""), ("signal_error", 0.03, ""))
OPTIONS: dict[str, Any] = {
    "default": "simulator=mitsuba",
    "([0-9.]+) tubes per square wavelength": r"simulator.rays_per_wavelength2=\1",
    "([0-9]+) bounces?": r"simulator.max_bounces=\1",
    "planar elements": "simulator.elements=planar",
    "1 diffraction, pruned at ([0-9.]+)": r"simulator.diffractions=1 simulator.prune=\1",
    "1 diffraction": "simulator.diffractions=1",
    "pruned at ([0-9.e-]+)": r"simulator.prune=\1",
    "object and room uncoupled": "simulator.coupling=false",
    "no diffuse cloud": "simulator.diffuse=false",
    "tubes, ([0-9.]+) million": lambda match: f"simulator.room=tubes simulator.rays={1e6 * float(match[1]):.0f}",
    "room by tubes.*": "simulator.room=tubes",
}
Row = dict[str, Any]


def read(name: str) -> list[Row]:
    """Read the rows of a committed table with numbers as numbers, and None for empty cells."""
    table = pd.read_csv(RESULTS / f"{name}.csv", keep_default_na=False, na_values=[""], dtype={"values": str, "fails at": str})
    return table.astype(object).where(table.notna(), None).to_dict("records")


def text() -> str:
    """Return the page docs/choosing.md as Markdown."""
    speed = read("speed_accuracy")
    scored = [row for row in speed if row["profile_error_db"] is not None]
    measured = [row for row in scored if not row["claim"]]
    tracers = list(defaults(scored))
    turntables = [row for row in speed if row["feature_error"] is not None]
    features = {row["setting"]: row for row in turntables if row["family"] == OURS and not row["claim"]}
    autos = {row["metric"]: row for row in read("complexity") if row["case"] == "all"}
    shipped, fixed = (
        autos[f"error of the {name} default between the frames of the choice, worst of all (limits)"] for name in ("shipped", "fixed")
    )
    return filled(
        TEMPLATE.read_text(encoding="utf-8"),
        machines=" and of ".join(dict.fromkeys(row["machine"].replace("; ", ", ") for row in measured)),
        goals=dict(goals(measured)),
        defaults=tracers,
        fronts=[claim for _, claims, _ in tracers for claim in claims],
        naives=[naive for *_, naive in tracers if naive],
        whole=features[DEFAULT],
        alone=features["no room"],
        cheapest=[row for row in turntables if row["claim"]],
        auto=autos[f"{complexity_rows.SAVED}, median"],
        shipped=shipped,
        fixed=fixed,
        sweeps=sweeps(read("stability")),
    )


def goals(measured: Sequence[Row]) -> Iterator[tuple[str, list[str]]]:
    """Yield the title of each test problem, and a text for each goal: the fastest setting whose error is at most that of the goal."""
    for rows in _by_problem(measured):
        inexact = [row for row in rows if not row["exact"]]
        default = _default(inexact)
        # settings of our tracer that computed the same as the default are left out
        same = {(OURS, default["rays"], default["signal_error"])}
        tried = [row for row in inexact if row is default or (row["family"], row["rays"], row["signal_error"]) not in same]
        cells = []
        for error, goal, unit in GOALS:
            enough = [row for row in tried if row[error] <= goal]
            best = min(enough or tried, key=lambda row: row["seconds_frame" if enough else error])
            name = f"`{options(best['setting'])}`" if best["family"] == OURS else f"{best['family']}, {best['setting']}"
            cell = f"{name}: {best[error]:.2g}{unit}, {best['value']:.2g} x"
            cells.append(cell if enough else f"none; nearest is {cell}")
        yield default["title"], cells


def _by_problem(rows: Sequence[Row]) -> list[list[Row]]:
    return [[row for row in rows if row["problem"] == name] for name in dict.fromkeys(row["problem"] for row in rows)]


def _default(rows: Sequence[Row]) -> Row:
    return next(row for row in rows if not row["claim"] and (row["family"], row["setting"]) == (OURS, DEFAULT))


def options(setting: str) -> str:
    """Return the command-line options that select one setting of the ray tracer RadarTwin, given the name of the setting."""
    return next(re.sub(pattern, option, setting) for pattern, option in OPTIONS.items() if re.fullmatch(pattern, setting))


def defaults(scored: Sequence[Row]) -> Iterator[tuple[Row, list[Row], Row | None]]:
    """Yield for each test problem the row of RadarTwin's default, its claims, and the claim about RF-Genesis, if RF-Genesis was run."""
    for rows in _by_problem(scored):
        claims = [row for row in rows if row["claim"]]
        naive = next((row for row in claims if row["family"] == RFGENESIS), None)
        yield _default(rows), [row for row in claims if "front" in row["metric"]], naive


def sweeps(stability: Sequence[Row]) -> list[tuple[Row, list[str]]]:
    """Return for each sweep the row of RadarTwin's ray tracer, and the safe regions of the other methods that have one."""

    def safe(row: Row) -> str:
        return f"{row['family']}{' ' + row['setting'] if row['family'] == RFGENESIS else ''}: {row['safe']}"

    return [
        (tracer, [safe(row) for row in stability if row["sweep"] == tracer["sweep"] and row is not tracer and row["value"]])
        for tracer in stability
        if tracer["family"] == OURS
    ]


def draw() -> None:
    """Write the pictures of the page."""
    drawn: dict[str, Callable[[], Any]] = {
        "speed_accuracy": lambda: chart.chart(read("speed_accuracy"), "profile_error_db"),
        "stability": lambda: stability_table.map_of(read("stability")),
        "complexity": lambda: complexity_rows.chart(read("complexity")),
    }
    for name, figure in drawn.items():
        png, pdf = style.save(figure, FIGURES / name)
        pdf.unlink()
        png.write_bytes(style.fewer_colours(png.read_bytes(), 64))
