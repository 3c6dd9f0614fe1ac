"""Labels beside points of a chart, each placed where it covers the fewest points and other labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

OFFSETS = (  # (right, up) of the label from its point, in units of 1/72 inch; preferred offsets come first
    (5, 0), (5, 6), (5, -6), (-5, 0), (-5, 6), (-5, -6), (0, 8), (0, -8), (5, 13), (5, -13), (-5, 13), (-5, -13), (0, 16), (0, -16),
)  # fmt: skip
SIZE = 5.5  # font size


def place(axes: Any, points: Sequence[tuple[float, float]], texts: Sequence[str], colours: Sequence[Any]) -> None:
    """Write `texts` beside `points` (data coordinates) at the best of OFFSETS; an empty text writes nothing.

    Set the limits of the axes before the call, because label sizes are compared in pixels.
    """
    from matplotlib.patheffects import withStroke

    scale = axes.figure.dpi / 72
    spots = axes.transData.transform(np.array(points))
    frame = axes.get_window_extent()
    occupied: list[tuple[float, float, float, float]] = [(x - 3 * scale, y - 3 * scale, x + 3 * scale, y + 3 * scale) for x, y in spots]
    for (x, y), point, text, colour in zip(spots, points, texts, colours, strict=True):
        if not text:
            continue
        width, height = 0.5 * SIZE * len(text) * scale, 1.05 * SIZE * scale
        best, chosen, offset = np.inf, occupied[0], OFFSETS[0]
        for rank, (right, up) in enumerate(OFFSETS):
            left = x + right * scale - (0.0 if right > 0 else width if right < 0 else width / 2)
            box = (left, y + up * scale - height / 2, left + width, y + up * scale + height / 2)
            outside = max(0.0, frame.x0 - box[0]) + max(0.0, box[2] - frame.x1) + max(0.0, frame.y0 - box[1]) + max(0.0, box[3] - frame.y1)
            cost = sum(_overlap(box, other) for other in occupied) + 200 * outside * height + 0.4 * rank
            if cost < best:
                best, chosen, offset = cost, box, (right, up)
        occupied.append(chosen)
        side = "left" if offset[0] > 0 else "right" if offset[0] < 0 else "center"
        label = axes.annotate(text, point, offset, textcoords="offset points", fontsize=SIZE, color=colour, ha=side, va="center_baseline")
        label.set(zorder=2.5, in_layout=False, path_effects=[withStroke(linewidth=1.8, foreground="white")])


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> float:
    return max(0.0, min(one[2], other[2]) - max(one[0], other[0])) * max(0.0, min(one[3], other[3]) - max(one[1], other[1]))
