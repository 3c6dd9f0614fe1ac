"""The map of where methods fail, drawn from the rows of its table: one block per sweep, one line per method, one cell per value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.plotting.style import PAGE_WIDTH_IN, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]
COLUMNS = 2
STEPS_DB = (0.0, 0.5, 1.0, 3.0, 6.0, 12.0, 40.0)
COLOURS = ("#08519c", "#4292c6", "#9ecae1", "#fdd0a2", "#fd8d3c", "#a63603")  # blue is safe, brown is not; readable with colour blindness
NAMES = {"this tracer": "this tracer", "points": "points, RCS table", "Sionna RT": "Sionna RT"}


def map_of(rows: Sequence[Row]) -> Figure:
    """Draw the error of every method at every value, with the first unsafe value on the right."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    rows = [row for row in rows if row["family"]]
    names = list(dict.fromkeys(row["sweep"] for row in rows))
    lines = -(-len(names) // COLUMNS)
    drawing, panels = figure(lines, COLUMNS, width_in=PAGE_WIDTH_IN * 1.25, height_in=1.16 * lines + 0.5)
    colours, norm = ListedColormap(COLOURS), BoundaryNorm(STEPS_DB, len(COLOURS))
    for panel, name in zip(panels.T.flat, names, strict=False):
        _block(panel, [row for row in rows if row["sweep"] == name], colours, norm)
    for panel in panels.T.flat[len(names) :]:
        panel.set_axis_off()
    images = [panel.images[0] for panel in panels.flat if panel.images]
    free = panels.T.flat[len(names)] if len(names) < panels.size else None
    bar = drawing.colorbar(images[0], ax=free or panels, orientation="horizontal", fraction=0.5 if free else 0.02, pad=0.05, aspect=30)
    bar.set_label("error against the reference (dB); a safe region ends at the first error above 3 dB", fontsize=6.5)
    bar.ax.tick_params(labelsize=6)
    return drawing


def _block(panel: Any, mine: Sequence[Row], colours: Any, norm: Any) -> None:
    errors = np.array([[float(one) for one in row["errors_db"].split()] for row in mine])
    values = mine[0]["values"].split()
    panel.imshow(np.nan_to_num(errors, nan=40.0), cmap=colours, norm=norm, aspect="auto")
    panel.set_xticks(range(len(values)), values)
    panel.set_yticks(range(len(mine)), [NAMES.get(row["family"], f"{row['family'].split()[0]}, {row['setting']}") for row in mine])
    panel.tick_params(length=0, labelsize=5.8, pad=2)
    for side in panel.spines.values():
        side.set_visible(False)
    panel.set_title(f"{mine[0]['title']}, {mine[0]['unit']} ({mine[0]['kind']})", fontsize=7, pad=3, loc="left")
    for line, row in enumerate(errors):
        for column, one in enumerate(row):
            text = "40+" if one >= 40 else f"{one:.1f}" if one < 9.95 else f"{one:.0f}"
            panel.text(column, line, text, ha="center", va="center", fontsize=5.3, color="white" if one < 1 or one >= 12 else "black")
        words = mine[line]["fails at"]
        panel.text(len(row) - 0.42, line, verdict(mine[line]), fontsize=5.8, va="center")
        if words:
            first = words.split()[0]
            panel.add_patch(_frame(values.index(first), line))


def verdict(row: Row) -> str:
    """Return where a method fails, as text."""
    return "safe throughout" if not row["fails at"] else "never safe" if not row["value"] else f"fails at {row['fails at']}"


def _frame(column: int, line: int) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.48, line - 0.46), 0.96, 0.92, fill=False, ec="black", lw=0.9)
