"""Parts of figures that several tables share: colours of measurement and simulation, range maps, error bars, legends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
