"""The chosen model of each case as a map, beside the run time that it saves; drawn from the rows of the complexity table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.adaptive.model import LADDER
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADS = {
    "parts": "room", "max_bounces": "bounces", "rays_per_wavelength2": "tubes\nper λ²", "coupling": "ways over\nthe room",
    "elements": "elements", "diffuse": "diffuse\ncloud",
}  # fmt: skip
TICKS = [factor * 10.0**power for power in range(-3, 3) for factor in (1, 3)]
WORDS = {True: "yes", False: "no"}


def chart(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw a map with one row per case and feature set and one column per setting of the model; dark cells take more run time.

    The bars beside the map are the run times of auto and of the shipped default, divided by that of the fixed default.
    """
    cases = [row for row in rows if row["metric"] == "cost of the fixed default over auto's"]
    level = np.array([[_level(row, name) for name in HEADS] for row in cases])
    drawing, (table, bars) = figure(
        1, 2, width_in=PAGE_WIDTH_IN, height_in=1.2 + 0.24 * len(cases), sharey=True, gridspec_kw={"width_ratios": (2, 1)}
    )
    table.imshow(level, cmap="Blues", vmin=0, vmax=1.6, aspect="auto")
    for y, row in enumerate(cases):
        for x, name in enumerate(HEADS):
            value = row[name]
            words = WORDS[value] if isinstance(value, bool) else f"{value:g}" if isinstance(value, (int, float)) else str(value)
            if name == "coupling" and row["parts"] == "none":
                words = "–"
            table.text(x, y, words, ha="center", va="center", fontsize=7)
    table.set_xticks(range(len(HEADS)), HEADS.values(), fontsize=6.5)
    table.xaxis.tick_top()
    table.set_yticks(range(len(cases)), [f"{row['case']}: {row['features']}" for row in cases], fontsize=6.5)
    table.tick_params(length=0)
    auto, shipped = ([row[f"{who} (s/frame)"] / row["fixed (s/frame)"] for row in cases] for who in ("auto", "shipped"))
    bars.barh(range(len(cases)), auto, color=PALETTE[0], height=0.6, label="auto")
    bars.plot(shipped, range(len(cases)), "k|", ms=7, label="shipped default")
    bars.axvline(1.0, color="0.5", lw=0.8)
    bars.set(xscale="log", xlabel="cost over the\nfixed default's")
    low, high = min(*auto, *shipped) / 1.5, max(*auto, *shipped) * 1.5
    ticks = [tick for tick in TICKS if low <= tick <= high]
    bars.set_xlim(low, high)
    bars.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    bars.minorticks_off()
    bars.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=6.5, ncols=2)
    return drawing


def _level(row: Mapping[str, Any], name: str) -> float:
    """Return 0 for the cheapest value of a setting and 1 for the most expensive. Without a room, paths between object and room count 0."""
    if name == "coupling" and row["parts"] == "none":
        return 0.0
    values = LADDER[name]
    return values.index(row[name]) / (len(values) - 1)
