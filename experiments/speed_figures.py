"""The chart of speed against accuracy, drawn from the rows of its table alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.labels_on_axes import place
from experiments.methods import DEFAULT, FAMILIES, OURS
from radartwin.plotting import PAGE_WIDTH_IN, PALETTE, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]
LOOKS = dict(zip(FAMILIES, (("o", PALETTE[0]), ("s", PALETTE[1]), ("^", PALETTE[2]), ("v", PALETTE[3]), ("D", "0.35")), strict=True))
AXES = {
    "profile_error_db": ("error of the range profile (dB, rms)", 0.02, 60.0),
    "signal_error": ("error of the signal, |a - b| / |b|", 2e-3, 6.0),
}
SHORT = {
    " tubes per square wavelength": " tubes", "object and room uncoupled": "uncoupled", "planar elements": "planar", "tubes, ": "tubes ",
    " million": "M", "far-field table": "table", "shipped, ": "", " x 128": "", " x 512": "", "in one place": "Sionna",
    "3 cm apart": "apart", "all of four bounces": "exact images", "corrected, ": "mended ", "no diffuse cloud": "no cloud",
    "room by tubes, by the width rule": "room by tubes", "sphere": "sphere",
}  # fmt: skip


def short(setting: str) -> str:
    """A setting as its label on the chart."""
    for words, shorter in SHORT.items():
        setting = setting.replace(words, shorter)
    return setting


def chart(rows: Sequence[Row], error: str) -> Figure:
    """Seconds of a frame against error, a panel per problem; the front is a line, the default a star."""
    measured = [row for row in rows if not row["claim"]]
    names = list(dict.fromkeys(row["problem"] for row in measured))
    drawing, panels = figure(2, 3, width_in=PAGE_WIDTH_IN, height_in=5.6, sharex=True, sharey=True)
    label, low, high = AXES[error]
    seconds = [row["seconds_frame"] for row in measured]
    for panel, name in zip(panels.flat, names, strict=False):
        mine = [row for row in measured if row["problem"] == name]
        panel.set(xscale="log", yscale="log", ylim=(low, high), xlim=(min(seconds) / 2, max(seconds) * 4))
        panel.grid(which="major", color="0.92", lw=0.5)
        panel.set_axisbelow(True)
        panel.set_title(mine[0]["title"].replace(" in the ", "\nin the ").replace(", moving", ",\nmoving"), fontsize=7.5)
        _front(panel, [row for row in mine if row["front" if error == "profile_error_db" else "front of the signal"]], error, high)
        for row in mine:
            _point(panel, row, row[error], low)
    for panel in panels[:, 0]:
        panel.set_ylabel(label)
    for panel in [*panels[-1, :2], panels[0, 2]]:
        panel.set_xlabel("seconds a frame")
    panels[0, 2].tick_params(labelbottom=True)
    _legend(panels.flat[-1], measured)
    drawing.draw_without_rendering()
    for panel, name in zip(panels.flat, names, strict=False):
        mine = [row for row in measured if row["problem"] == name]
        places = [(row["seconds_frame"], float(np.clip(row[error], low, high))) for row in mine]
        place(panel, places, [short(row["setting"]) for row in mine], [LOOKS[row["family"]][1] for row in mine])
    return drawing


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


def _front(panel: Any, chosen: Sequence[Row], error: str, high: float) -> None:
    ordered = sorted((row["seconds_frame"], row[error]) for row in chosen)
    if ordered:
        x, y = zip(*ordered, strict=True)
        panel.step([x[0], *x, 1e6], [high * 10, *y, y[-1]], where="post", color="0.6", lw=1.0, zorder=1)


def _legend(panel: Any, measured: Sequence[Row]) -> None:
    from matplotlib.lines import Line2D

    panel.set_axis_off()
    present = {row["family"] for row in measured}
    lines = [Line2D([], [], color="none", marker="*", ms=11, mfc=PALETTE[0], mec="black", mew=0.7, label="this tracer, default")]
    for family, (marker, colour) in LOOKS.items():
        if family in present:
            face = "white" if family == "image sources" else colour
            words = {"RF-Genesis style": "RF-Genesis style, our synthesis", "image sources": "exact image sources, not on the front"}
            lines.append(Line2D([], [], color="none", marker=marker, ms=4.5, mfc=face, mec=colour, label=words.get(family, family)))
    marker, colour = LOOKS["RF-Genesis style"]
    lines.append(Line2D([], [], color="none", marker=marker, ms=4.5, mfc="white", mec=colour, label="RF-Genesis style, as published"))
    lines.append(Line2D([], [], color="0.6", lw=1.0, label="front: nothing is faster and more accurate"))
    panel.legend(handles=lines, loc="upper left", fontsize=6.5, borderaxespad=0)
    text = "Fast is left, accurate is down. Bars: least to most.\nWhat is off by more than 40 dB counts as 40 dB.\n"
    panel.text(
        0,
        0.02,
        text + measured[0]["machine"].replace("; ", "\n"),
        fontsize=5.8,
        color="0.35",
        va="bottom",
        transform=panel.transAxes,
        wrap=False,
    )
