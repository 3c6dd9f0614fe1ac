"""Write the chart of speed against accuracy as one interactive HTML page that works offline.

The user can choose the quantities of both axes, zoom, and read the values of each point.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.speed.chart import LOOKS, front
from experiments.speed.methods import DEFAULT, OURS

if TYPE_CHECKING:
    from pandas import DataFrame
    from plotly.graph_objects import Figure

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
MARKS = {DEFAULT: "star", "knows the answer": "circle-open", "compared": "circle"}
COLUMNS, PANEL_HEIGHT_PX = 2, 420


def page(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the interactive HTML page, drawn from the rows of the table `speed_accuracy`."""
    import pandas as pd
    from plotly.offline import get_plotlyjs

    measured = pd.DataFrame([row for row in rows if not row["claim"]])
    views = {f"{cost} {error}": json.loads(str(figure(measured, cost, error).to_json())) for cost in COSTS for error in ERRORS}
    parts = {
        "MACHINE": html.escape(" and ".join(measured.machine.unique())), "COSTS": _options(COSTS), "ERRORS": _options(ERRORS),
        "PLOTLY": get_plotlyjs(), "VIEWS": json.dumps(views).replace("<", "\\u003c"),
    }  # fmt: skip
    text = Path(__file__).with_suffix(".html").read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace(f"/*{name}*/", part, 1)
    return text


def figure(measured: DataFrame, cost: str, error: str) -> Figure:
    """Draw the rows that have both quantities, with one panel per test problem and a line through the methods on the Pareto front."""
    import plotly.express as px

    rows = measured.dropna(subset=[cost, error]).astype({cost: float, error: float})
    rows["panel"] = rows.title.map(html.escape) + "<br><sub>answer: " + rows.domain.map(html.escape) + "</sub>"
    rows["method"], rows["mark"] = rows.family + ", " + rows.setting, np.where(rows.exact.astype(bool), "knows the answer", "compared")
    rows.loc[rows.method == f"{OURS}, {DEFAULT}", "mark"] = DEFAULT
    left_out = rows.exact.astype(bool) | (rows[cost] <= 0)
    on_front = ~left_out
    for _, mine in rows[~left_out].groupby("panel"):
        on_front[mine.index] = front(list(zip(mine[cost], mine[error], strict=True)))
    rows[cost], rows[error] = rows[cost].clip(LOWEST[cost]), rows[error].clip(LOWEST[error])
    panels: dict[str, Any] = {
        "x": cost, "y": error, "log_x": True, "log_y": True, "facet_col": "panel", "facet_col_wrap": COLUMNS, "facet_row_spacing": 0.12,
        "category_orders": {"panel": list(rows.panel.unique())}, "labels": COSTS | ERRORS | DETAILS, "template": "plotly_white",
    }  # fmt: skip
    drawing = px.scatter(
        rows, color="family", symbol="mark", color_discrete_map={name: colour for name, (_, colour) in LOOKS.items()}, symbol_map=MARKS,
        hover_name="method",
        hover_data=dict.fromkeys((*COSTS, *ERRORS, *DETAILS), ":.3g") | dict.fromkeys(("panel", "family", "mark"), False),
        height=(2 + rows.panel.nunique()) * PANEL_HEIGHT_PX // COLUMNS, **panels,
    ).update_traces(marker_size=10)  # fmt: skip
    line = px.line(rows.assign(**{error: rows[error].where(on_front)}).sort_values(cost), line_shape="hv", **panels)
    drawing.add_traces(line.update_traces(line_color="#999", connectgaps=True, hoverinfo="skip", hovertemplate=None).data)
    drawing.for_each_annotation(lambda title: title.update(text=title.text.partition("=")[2]))
    return drawing.update_layout(legend={"orientation": "h", "y": 1.08, "title": ""}, modebar={"orientation": "v"}, margin={"t": 110})


def _options(names: Mapping[str, str]) -> str:
    return "".join(f'<option value="{name}">{html.escape(words)}</option>' for name, words in names.items())
