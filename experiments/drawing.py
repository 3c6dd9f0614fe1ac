"""Parts of figures that several tables share: colours of measurement and simulation, range maps, error bars, legends, labels."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from radartwin.plotting.style import COLUMN_WIDTH_IN, PAGE_WIDTH_IN, PALETTE, TEXT_PT, figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
if not TYPE_CHECKING:
    Axes = Figure = Any  # no module imports Matplotlib before it draws

__all__ = [
    "COLUMN_WIDTH_IN", "PAGE_WIDTH_IN", "PALETTE", "Axes", "Figure", "error_bars", "figure", "legend_above", "panels_width_in", "place",
    "range_map",
]  # fmt: skip
OFFSETS = (  # (right, up) of a label from its point, in units of 1/72 inch; preferred offsets come first
    (5, 0), (5, 6), (5, -6), (-5, 0), (-5, 6), (-5, -6), (0, 8), (0, -8), (5, 11), (5, -11), (-5, 11), (-5, -11),
)  # fmt: skip
COVERED = 0.1  # largest share of a label that may cover other things
DOMAIN_STYLES = {"measured": (PALETTE[0], "o"), "twin": (PALETTE[1], "s")}  # colour and marker


def panels_width_in(panels: int) -> float:
    """Return the figure width in inches: the page width for three or more panels, less for one or two panels."""
    return PAGE_WIDTH_IN * min(1.0, 0.25 + 0.25 * panels)


def error_bars(rows: Iterable[Mapping[str, Any]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return error bars of table rows for matplotlib: values (N,), and distances (2, N) from each value to the ends of its interval."""
    value, low, high = np.array([[row[column] for column in ("value", "low", "high")] for row in rows], float).T
    return value, np.stack([value - low, high - value])


def range_map(axes: Axes, level_db: NDArray, extent: tuple[float, float, float, float], top_db: float, span_db: float) -> None:
    """Draw levels (X, B) in decibels with the range axis upwards. The colour scale reaches from top_db - span_db to top_db."""
    axes.imshow(
        level_db.T, origin="lower", aspect="auto", extent=extent, vmin=top_db - span_db, vmax=top_db, interpolation="nearest"
    )  # fmt: skip


def legend_above(drawing: Figure, axes: Axes, columns: int) -> None:
    """Put the legend of the panel `axes` above all panels of the figure."""
    drawing.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=columns)


def place(axes: Any, points: Sequence[tuple[float, float]], texts: Sequence[str], colours: Sequence[Any]) -> None:
    """Write `texts` beside `points` (data coordinates) at the best of OFFSETS, but none that would cover other things everywhere.

    Set the axis limits before, because the function compares text sizes in pixels.
    """
    from matplotlib.patheffects import withStroke

    scale = axes.figure.dpi / 72
    spots = axes.transData.transform(np.array(points))
    frame = axes.get_window_extent()
    occupied: list[tuple[float, float, float, float]] = [(x - 3 * scale, y - 3 * scale, x + 3 * scale, y + 3 * scale) for x, y in spots]
    for (x, y), point, text, colour in zip(spots, points, texts, colours, strict=True):
        if not text:
            continue
        width, height = 0.55 * TEXT_PT * len(text) * scale, 1.05 * TEXT_PT * scale
        best, best_box, offset = np.inf, occupied[0], OFFSETS[0]
        for rank, (right, up) in enumerate(OFFSETS):
            left = x + right * scale - (0.0 if right > 0 else width if right < 0 else width / 2)
            box = (left, y + up * scale - height / 2, left + width, y + up * scale + height / 2)
            outside = max(0.0, frame.x0 - box[0]) + max(0.0, box[2] - frame.x1) + max(0.0, frame.y0 - box[1]) + max(0.0, box[3] - frame.y1)
            cost = sum(_overlap(box, other) for other in occupied) + 200 * outside * height + 2 * rank
            if cost < best:
                best, best_box, offset = cost, box, (right, up)
        if best > COVERED * width * height:
            continue
        occupied.append(best_box)
        side = "left" if offset[0] > 0 else "right" if offset[0] < 0 else "center"
        label = axes.annotate(text, point, offset, textcoords="offset points", color=colour, ha=side, va="center_baseline")
        label.set(zorder=2.5, in_layout=False, path_effects=[withStroke(linewidth=1.8, foreground="white")])


def _overlap(first: tuple[float, float, float, float], second: tuple[float, float, float, float]) -> float:
    return max(0.0, min(first[2], second[2]) - max(first[0], second[0])) * max(0.0, min(first[3], second[3]) - max(first[1], second[1]))
