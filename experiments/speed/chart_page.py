"""Write the chart of speed against accuracy as one interactive HTML page that works offline.

The user can choose the quantities of both axes, zoom, and read the values of each point.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.speed.chart import LOOKS
from experiments.speed.methods import DEFAULT, OURS
from experiments.speed.pareto import front

Row = Mapping[str, Any]
COSTS = {
    "seconds_frame": "processor seconds per frame", "wall_s_frame": "wall seconds per frame", "memory_mib": "memory above idle (MiB)",
    "rays": "rays per frame",
}  # fmt: skip
ERRORS = {
    "profile_error_db": "error of the range profile (dB)", "signal_error": "error of the signal",
    "free_error_db": "error of the range profile after a fitted gain (dB)", "feature_error": "error of the features (standard deviations)",
    "recognition_error": "share not recognised",
}  # fmt: skip
DETAILS = {"setup_s": "set-up (s)", "frames timed": "frames timed", "offset_db": "level offset (dB)", "n": "rounds"}
LOWEST = dict.fromkeys(COSTS, 1e-4) | dict.fromkeys(ERRORS, 1e-3)  # smaller values are drawn at this value; both axes are logarithmic
COLUMNS, PANEL_HEIGHT_PX = 2, 420
PLOT_ID = "chart"


def page(rows: Sequence[Row]) -> str:
    """Return the interactive HTML page, drawn from the rows of the table `speed_accuracy`."""
    measured = [row for row in rows if not row["claim"]]
    figure, series = _figure(measured)
    views = {f"{cost} {error}": _view(series, cost, error) for cost in COSTS for error in ERRORS}
    figure.update_layout(height=(2 + len(series)) * PANEL_HEIGHT_PX // COLUMNS)
    parts = {
        "MACHINE": html.escape(" and ".join(dict.fromkeys(row["machine"] for row in measured)) or "no machine"),
        "COSTS": _options(COSTS), "ERRORS": _options(ERRORS),
        "VIEWS": json.dumps(views).replace("<", "\\u003c"),
        "PLOT": figure.to_html(full_html=False, include_plotlyjs=True, div_id=PLOT_ID, config={"responsive": True, "displaylogo": False}),
    }  # fmt: skip
    text = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace(f"/*{name}*/", part, 1)
    return text


def _figure(measured: Sequence[Row]) -> tuple[Any, list[list[list[Row]]]]:
    """Return the figure and the table rows behind each of its curves.

    For each test problem, the first entry holds all rows (for the line of the Pareto front), and the next entries hold the rows of each
    family.
    """
    from plotly.subplots import make_subplots

    problems = list(dict.fromkeys(row["problem"] for row in measured))
    by_problem = [[row for row in measured if row["problem"] == problem] for problem in problems]
    titles = [f"{html.escape(mine[0]['title'])}<br><sub>answer: {html.escape(mine[0]['domain'])}</sub>" for mine in by_problem]
    figure = make_subplots(rows=-(-len(problems) // COLUMNS) or 1, cols=COLUMNS, subplot_titles=titles, vertical_spacing=0.12)
    series, named = [], set()
    for number, mine in enumerate(by_problem):
        place = {"row": number // COLUMNS + 1, "col": number % COLUMNS + 1}
        figure.add_scatter(mode="lines", line={"shape": "hv", "color": "#999"}, hoverinfo="skip", showlegend=False, **place)
        series.append([mine])
        for family in dict.fromkeys(row["family"] for row in mine):
            some = [row for row in mine if row["family"] == family]
            symbols = ["star" if _is_default(row) else "circle-open" if row["exact"] else "circle" for row in some]
            figure.add_scatter(
                mode="markers", name=family, legendgroup=family, showlegend=family not in named, hovertext=[_details(row) for row in some],
                hoverinfo="text", **place,
                marker={
                    "color": LOOKS[family][1], "symbol": symbols, "opacity": 1, "size": [14 if _is_default(row) else 9 for row in some],
                },
            )  # fmt: skip
            named.add(family)
            series[-1].append(some)
    figure.update_xaxes(type="log").update_yaxes(type="log")
    figure.update_layout(template="plotly_white", legend={"orientation": "h", "y": 1.08}, margin={"t": 110, "r": 20})
    return figure, series


def _view(series: Sequence[Sequence[Sequence[Row]]], cost: str, error: str) -> list[Any]:
    """Return the arguments of Plotly.update that show one pair of axes: the coordinates of every curve, and the axis titles."""
    coordinates = []
    for mine, *families in series:
        compared = sorted((row for row in mine if not row["exact"] and row[cost] and row[error] is not None), key=lambda row: row[cost])
        best = front([(row[cost], row[error]) for row in compared])
        coordinates.append(_places([row for row, on in zip(compared, best, strict=True) if on], cost, error))
        coordinates += [_places(some, cost, error) for some in families]
    axes = {f"{axis}axis{number or ''}.title.text": text for number in (0, *range(2, len(series) + 1)) for axis, text in
            (("x", COSTS[cost]), ("y", ERRORS[error]))}  # fmt: skip
    return [{"x": [x for x, _ in coordinates], "y": [y for _, y in coordinates]}, axes]


def _places(rows: Sequence[Row], cost: str, error: str) -> tuple[list[float | None], list[float | None]]:
    x, y = ([None if row[name] is None else max(row[name], LOWEST[name]) for row in rows] for name in (cost, error))
    return x, y


def _is_default(row: Row) -> bool:
    return (row["family"], row["setting"]) == (OURS, DEFAULT)


def _details(row: Row) -> str:
    """Return every value of a point as HTML text for the box that appears beside the point."""
    lines = [f"<b>{html.escape(row['family'])}, {html.escape(row['setting'])}</b>"]
    for name, words in (COSTS | ERRORS | DETAILS).items():
        lines.append(f"{words}: {'not measured' if row[name] is None else format(row[name], '.3g')}")
    return "<br>".join(lines)


def _options(names: Mapping[str, str]) -> str:
    return "".join(f'<option value="{name}">{html.escape(words)}</option>' for name, words in names.items())
