"""Draw the chart of speed against accuracy from the rows of the table `speed_accuracy`, and find the Pareto front."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure, place
from experiments.speed.methods import DEFAULT, FAMILIES, OURS

Row = Mapping[str, Any]
Point = tuple[float, float]  # run time and error
LOOKS = dict(zip(FAMILIES, (("o", PALETTE[0]), ("s", PALETTE[1]), ("^", PALETTE[2]), ("v", PALETTE[3]), ("D", "#595959")), strict=True))
AXES = {  # label, limits, and the column that marks the Pareto front
    "profile_error_db": ("error of the range profile (dB, rms)", 0.01, 60.0, "front"),
    "signal_error": ("error of the signal, |a - b| / |b|", 1e-3, 30.0, "front of the signal"),
}
SHORT = {
    "room by tubes, by the width rule": "room by tubes",
    " tubes per square wavelength": " tubes", "object and room uncoupled": "uncoupled", "planar elements": "planar", "tubes, ": "tubes ",
    " million": "M", "far-field table": "table", " x 128": "", " x 512": "", "shipped, 128": "shipped", "shipped,": "shipped",
    "corrected, 128": "corrected", "corrected,": "corrected", "in one place": "one place",
    "all of four bounces": "exact images", "no diffuse cloud": "no cloud",
}  # fmt: skip


def short(setting: str) -> str:
    """Return the short text that marks a method's setting on the chart."""
    for words, shorter in SHORT.items():
        setting = setting.replace(words, shorter)
    return setting


def chart(rows: Sequence[Row], error: str) -> Figure:
    """Draw seconds per frame against error with a panel per problem, a line along the Pareto front, and a star for the default."""
    measured = [row for row in rows if not row["claim"] and row[error] is not None]
    problems = {name: [row for row in measured if row["problem"] == name] for name in dict.fromkeys(row["problem"] for row in measured)}
    drawing, panels = figure(2, 3, width_in=PAGE_WIDTH_IN, height_in=5.6, sharex=True, sharey=True)
    label, low, high, front = AXES[error]
    seconds = [row["seconds_frame"] for row in measured]
    for panel, mine in zip(panels.flat, problems.values(), strict=False):
        panel.set(xscale="log", yscale="log", ylim=(low, high), xlim=(min(seconds) / 2, max(seconds) * 4))
        panel.set_title(mine[0]["title"].replace(" in the ", "\nin the ").replace(", moving", ",\nmoving"))
        truth = mine[0]["domain"].replace("tubes per square wavelength", "tubes").replace("this tracer", "this tracer's own run")
        words = "\n".join(textwrap.wrap(f"reference: {truth}", 36))
        answer = panel.text(0.02, 0.02, words, color="0.4", transform=panel.transAxes)
        answer.set_in_layout(False)
        _points(panel, mine, error, front, high, low)
    for panel in panels[:, 0]:
        panel.set_ylabel(label)
    for panel in panels.flat[:-1]:
        panel.set_xlabel("processor seconds per frame")
        panel.tick_params(labelbottom=True)
    _legend(panels.flat[-1], measured)
    drawing.draw_without_rendering()
    for panel, mine in zip(panels.flat, problems.values(), strict=False):
        # points with a text: the front, the default, RF-Genesis as published, and the most accurate of each family
        named = [row for row in mine if row[front] or row["setting"] in (DEFAULT, "as published")]
        families = dict.fromkeys(row["family"] for row in mine)
        named += [min((row for row in mine if row["family"] == family), key=lambda row: row[error]) for family in families]
        _labels(panel, mine, named, [float(np.clip(row[error], low, high)) for row in mine])
    return drawing


def campaign(rows: Sequence[Row]) -> Figure:
    """Draw seconds per frame for the campaign's recordings against feature error and against recognition error."""
    mine = [row for row in rows if not row["claim"] and row["feature_error"] is not None]
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=3.0, sharex=True)
    features, missed = ([row[error] for row in mine] for error in ("feature_error", "recognition_error"))
    for panel in panels:
        panel.set(xscale="log", xlabel="processor seconds per frame")
        panel.set_xlim(min(row["least_s_frame"] for row in mine) / 2, max(row["most_s_frame"] for row in mine) * 2)
    panels[0].set(yscale="log", ylim=(min(features) / 2, max(features) * 2), ylabel="feature error (std of the measured)")
    panels[1].set(ylim=(0, min(1.0, 2 * max(missed) + 0.1)), ylabel="symmetry not recognised (share)")
    _points(panels[0], mine, "feature_error", "front of features", max(features), 0.0)
    _points(panels[1], mine, "recognition_error", "front of recognition", max(missed), 0.0)
    drawing.draw_without_rendering()
    _labels(panels[0], mine, mine, features)
    _labels(panels[1], mine, mine, missed)
    return drawing


def _points(panel: Any, mine: Sequence[Row], error: str, front: str, high: float, low: float) -> None:
    """Draw the points of one panel, and a line through the points on the Pareto front (the rows with a mark in the column `front`)."""
    panel.grid(which="major", color="0.92", lw=0.5)
    panel.set_axisbelow(True)
    ordered = sorted((row["seconds_frame"], row[error]) for row in mine if row[front])
    if ordered:
        x, y = zip(*ordered, strict=True)
        panel.step([x[0], *x, 1e6], [high * 10, *y, y[-1]], where="post", color="0.6", lw=1.0, zorder=1)
    for row in mine:
        _point(panel, row, row[error], low)


def _labels(panel: Any, mine: Sequence[Row], named: Sequence[Row], values: Sequence[float]) -> None:
    """Write the settings beside their points: first the default, which must have a label, then those of the other families."""
    order = sorted(zip(mine, values, strict=True), key=lambda pair: (pair[0]["setting"] != DEFAULT, pair[0]["family"] == OURS))
    texts = {row["setting"]: short(row["setting"]) for row in named}
    texts |= {row["setting"]: f"published ({row['value']:.0f} x)" for row in named if row["setting"] == "as published"}
    labels = [texts[row["setting"]] if row in named else "" for row, _ in order]
    place(panel, [(row["seconds_frame"], value) for row, value in order], labels, [LOOKS[row["family"]][1] for row, _ in order])


def _point(panel: Any, row: Row, value: float, low: float) -> None:
    marker, colour = LOOKS[row["family"]]
    spread = [[row["seconds_frame"] - row["least_s_frame"]], [row["most_s_frame"] - row["seconds_frame"]]]
    default = (row["family"], row["setting"]) == (OURS, DEFAULT)
    at = max(value, low * 1.1)
    face = "white" if row["exact"] or row["setting"] == "as published" else colour
    panel.errorbar(row["seconds_frame"], at, xerr=spread, color=colour, lw=0.7, zorder=2)
    panel.plot(
        row["seconds_frame"], at, "*" if default else marker, ms=11 if default else 4.5, mfc=face, mec="black" if default else colour,
        mew=0.7, zorder=4 if default else 3,
    )  # fmt: skip


def _legend(panel: Any, measured: Sequence[Row]) -> None:
    from matplotlib.lines import Line2D

    panel.set_axis_off()
    present = {row["family"] for row in measured}
    handles = [Line2D([], [], color="none", marker="*", ms=11, mfc=PALETTE[0], mec="black", mew=0.7, label="this tracer, default")]
    for family, (marker, colour) in LOOKS.items():
        if family in present:
            face = "white" if family == "image sources" else colour
            words = {"RF-Genesis style": "RF-Genesis style, our synthesis", "image sources": "exact image sources, not on the front"}
            handles.append(Line2D([], [], color="none", marker=marker, ms=4.5, mfc=face, mec=colour, label=words.get(family, family)))
    marker, colour = LOOKS["RF-Genesis style"]
    handles.append(Line2D([], [], color="none", marker=marker, ms=4.5, mfc="white", mec=colour, label="RF-Genesis style, as published"))
    handles.append(Line2D([], [], color="0.6", lw=1.0, label="front: no method is better in time and error"))
    panel.legend(handles=handles, loc="upper left", borderaxespad=0)
    lines = [
        "Left is fast, low is accurate. Bars: range over rounds.",
        "Error of profiles: within 40 dB of their peak.",
        "(n x): time relative to the default.",
        "Without a label: other settings; the table lists all.",
        *(textwrap.fill(machine, 44) for machine in dict.fromkeys(row["machine"] for row in measured)),
    ]
    panel.text(0, 0.0, "\n".join(lines), color="0.35", va="bottom", transform=panel.transAxes)


def front(points: Sequence[Point]) -> list[bool]:
    """Return for each point whether it is on the Pareto front.

    A point is on the front if no other point is at least as good (as small) in both coordinates and better in one coordinate.

    >>> front([(1, 3), (2, 2), (2, 3), (3, 1)])
    [True, True, False, True]
    """
    return [not any(other[0] <= point[0] and other[1] <= point[1] and other != point for other in points) for point in points]


def shortfall(point: Point, others: Sequence[Point]) -> float:
    """Return the largest factor by which another point is better in both coordinates: 1 on the Pareto front, 1.1 if another is 10 % better.

    >>> shortfall((2.0, 2.0), [(1.0, 1.9), (4.0, 0.1)])
    1.0526315789473684
    """
    better = [min(point[0] / other[0], point[1] / max(other[1], 1e-12)) for other in others]
    return float(np.max([1.0, *better]))
