"""Write the page docs/choosing.md and its pictures from the committed tables in docs/results only.

These commands renew the tables and the page:

radartwin tables --profile paper --only speed_accuracy --only stability --only complexity
cp outputs/tables/{speed_accuracy,stability,complexity}.csv docs/results/ && python -m analysis.pages
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from analysis.pages.filled import RESULTS, ROOT, rows_of, wrapped
from experiments.complexity import rows as complexity_rows
from experiments.speed import chart
from experiments.speed.methods import DEFAULT, OURS, RFGENESIS
from experiments.stability import stability as stability_table
from radartwin.io import files
from radartwin.plotting import style

PAGE, FIGURES = ROOT / "docs" / "choosing.md", ROOT / "docs" / "figures"
TEMPLATE = Path(__file__).with_name("choosing_template.md")
NAMES = ("speed_accuracy", "stability", "complexity")
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
    "tubes, ([0-9.]+) million": lambda found: f"simulator.room=tubes simulator.rays={1e6 * float(found[1]):.0f}",
    "room by tubes.*": "simulator.room=tubes",
}
Row = Mapping[str, Any]


def read(name: str, folder: Path = RESULTS) -> list[dict[str, Any]]:
    """Read the rows of a committed CSV table. Numbers become floats and empty cells become None; text columns keep their text."""
    return [{key: _value(key, text) for key, text in row.items()} for row in rows_of(name, folder)]


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
    """Return the page docs/choosing.md as Markdown: the template, filled from the rows of the three tables named in the arguments."""
    measured = [row for row in speed if not row["claim"] and row["profile_error_db"] is not None]
    machines = " and of ".join(dict.fromkeys(row["machine"].replace("; ", ", ") for row in measured))
    origin = (
        "`python -m analysis.pages` writes this page from the committed tables `speed_accuracy.csv`, `stability.csv` and "
        f"`complexity.csv` in `docs/results/`. Run times are processor seconds of {machines}. "
        "Compare only ratios of run times, because the load of the machine changes seconds."
    )
    settings = dict.fromkeys(row["setting"] for row in measured if row["family"] == OURS)
    parts = {
        "origin": wrapped(origin),
        "goals": _goals(measured),
        "options": _lines((setting, f"`{options(setting)}`") for setting in settings),
        "needed": _needed(complexity),
        "claims": _claims(complexity),
        "default": _default(speed),
        "campaign": _campaign(speed),
        "campaign_claims": _campaign_claims(speed),
        "safe": _safe(stability),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], TEMPLATE.read_text(encoding="utf-8"))


def _lines(rows: Iterable[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def _goals(measured: Sequence[Row]) -> str:
    rows = []
    for name in dict.fromkeys(row["problem"] for row in measured):
        mine = [row for row in measured if row["problem"] == name and not row["exact"]]
        default = next(row for row in mine if (row["family"], row["setting"]) == (OURS, DEFAULT))
        mine = [row for row in mine if row is default or not _same(row, default)]
        cells = [mine[0]["title"]]
        for error, goal, unit in GOALS:
            enough = [row for row in mine if row[error] <= goal]
            best = min(enough or mine, key=lambda row: row["seconds_frame" if enough else error])
            text = f"{best['family']}, {best['setting']}: {best[error]:.2g}{unit}, {best['value']:.2g} x"
            cells.append(text if enough else f"none; nearest is {text}")
        rows.append(cells)
    return _lines(rows)


def _same(row: Row, default: Row) -> bool:
    """Return whether a setting of our tracer computed the same as the default: signal errors and numbers of ray tubes are equal."""
    return row["family"] == OURS and row["rays"] == default["rays"] and row["signal_error"] == default["signal_error"]


def options(setting: str) -> str:
    """Return the command-line options that select one setting of the ray tracer RadarTwin, given the name of the setting."""
    return next(re.sub(pattern, option, setting) for pattern, option in OPTIONS.items() if re.fullmatch(pattern, setting))


def _needed(complexity: Sequence[Row]) -> str:
    return _lines(
        (
            row["case"], row["features"], row["model"], f"{row['between']:.2f}", f"{row['value']:.2g} x", _pays_after(row),
            "yes" if row["without layers"] > 1 else "no",
        )
        for row in complexity if row["metric"] == complexity_rows.SAVED
    )  # fmt: skip


def _pays_after(row: Row) -> str:
    frames = row["pays after (frames)"]
    return "never" if frames is None else f"{frames:.0f}"


def _claims(complexity: Sequence[Row]) -> str:
    claims = [row for row in complexity if row["case"] == "all"]
    return _lines((row["metric"], f"{row['value']:.2g}", row["model"] or "all cases", row["claim"], row["verdict"]) for row in claims)


def _default(speed: Sequence[Row]) -> str:
    rows = []
    scored = [row for row in speed if row["profile_error_db"] is not None]
    for name in dict.fromkeys(row["problem"] for row in scored):
        mine = [row for row in scored if row["problem"] == name]
        own = next(row for row in mine if not row["claim"] and (row["family"], row["setting"]) == (OURS, DEFAULT))
        naive = next((row for row in mine if row["claim"] and row["family"] == RFGENESIS), None)
        claims = [row for row in mine if row["claim"] and "front" in row["metric"]]
        words = (f"{row['value']:.2f} by the {row['metric'].rpartition(' of the ')[2]} error, limit {row['verdict']}" for row in claims)
        rows.append((
            own["title"], f"{own['seconds_frame']:.2g}", f"{own['profile_error_db']:.2g} dB", f"{own['signal_error']:.2g}",
            "; ".join(words),
            f"{naive['value']:.3g} x, limit {naive['verdict']}" if naive else "not run",
            f"{naive['profile_error_db']:.2g} dB, {naive['free_error_db']:.2g} dB after the best gain" if naive else "",
        ))  # fmt: skip
    return _lines(rows)


def _campaign(speed: Sequence[Row]) -> str:
    rows = [row for row in speed if row["feature_error"] is not None and not row["claim"]]
    return _lines(
        (
            f"{row['family']}, {row['setting']}", f"{row['seconds_frame']:.2g}", f"{row['value']:.2g} x", f"{row['feature_error']:.3g}",
            f"{row['recognition_error']:.2g}",
        )
        for row in rows
    )  # fmt: skip


def _campaign_claims(speed: Sequence[Row]) -> str:
    rows = [row for row in speed if row["feature_error"] is not None and row["claim"]]
    return _lines((row["claim"], row["metric"], f"{row['value']:.2g}", row["verdict"]) for row in rows)


def _safe(stability: Sequence[Row]) -> str:
    rows = []
    for own, others in _sweeps(stability):
        found = [f"{_family(row)}: {row['safe']}" for row in others]
        wider = "" if own["verdict"] == "holds" else " (not the largest)"
        rows.append((own["title"], f"{own['safe']}{wider}", own["fails at"] or "nowhere", "; ".join(found) or "none"))
    return _lines(rows)


def _family(row: Row) -> str:
    return f"{row['family']} {row['setting']}" if row["family"] == RFGENESIS else row["family"]


def _sweeps(stability: Sequence[Row]) -> list[tuple[Row, list[Row]]]:
    """Group the rows of the table `stability` by parameter sweep (series of scenes or settings of increasing difficulty).

    Returns for each sweep the row of RadarTwin's ray tracer, and the rows of those other simulation methods that are accurate in a part of
    the sweep.
    """
    return [
        (own, [row for row in stability if row["sweep"] == own["sweep"] and row is not own and row["value"]])
        for own in stability
        if own["family"] == OURS
    ]


def write() -> None:
    """Write the page and its pictures."""
    speed, stability, complexity = (read(name) for name in NAMES)
    files.write_atomically(PAGE, text(speed, stability, complexity))
    drawn = {
        "speed_accuracy": lambda: chart.chart(speed, "profile_error_db"),
        "stability": lambda: stability_table.map_of(stability),
        "complexity": lambda: complexity_rows.chart(complexity),
    }
    for name, draw in drawn.items():
        for path in style.save(draw, FIGURES / name):
            if path.suffix != ".png":
                path.unlink()
