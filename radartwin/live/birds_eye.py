"""Draw the range-azimuth map as a bird's-eye picture. Matplotlib draws the axes once, and each answer fills only the sector."""

from __future__ import annotations

import io
from functools import lru_cache

import numpy as np

from radartwin.live.echoes import Spectra, span_db

DYNAMIC_DB = 50.0  # range of levels in the map, below the strongest
DPI = 110
SIZE_IN = (4.8, 2.75)


def map_picture(spectra: Spectra, farthest_m: float) -> np.ndarray:
    """Draw the map of one frame up to a radius in metres as RGB (H, W, 3), uint8: seen from above, the boresight upwards."""
    frame, rows, columns, range_bin, azimuth_bin = _frame(farthest_m, spectra.range_m.tobytes(), spectra.azimuth_rad.tobytes())
    low, high = map_limits(spectra, farthest_m)
    picture = frame.copy()
    picture[rows, columns] = level_colours(spectra.map_db[azimuth_bin, range_bin], low, high)
    return picture


def map_limits(spectra: Spectra, farthest_m: float) -> tuple[float, float]:
    """Return the levels in decibels at both ends of the map's colour scale, for ranges up to `farthest_m` in metres."""
    return span_db(spectra.map_db[:, spectra.range_m <= farthest_m], DYNAMIC_DB)


def level_colours(levels_db: np.ndarray, low_db: float, high_db: float) -> np.ndarray:
    """Return the RGB colours (N, 3) uint8 of levels (N,) on the scale of the map."""
    from matplotlib import colormaps

    return colormaps["viridis"]((levels_db - low_db) / (high_db - low_db), bytes=True)[..., :3]


@lru_cache(maxsize=4)
def _frame(farthest_m: float, ranges: bytes, azimuths: bytes) -> tuple[np.ndarray, ...]:
    """Draw axes and colour bar. Return the picture (H, W, 3), and rows, columns, range bins and azimuth bins of the sector's pixels."""
    import matplotlib
    from matplotlib.figure import Figure

    from radartwin.plotting.style import style

    range_m, azimuth_rad = np.frombuffer(ranges), np.frombuffer(azimuths)
    settings = style()
    settings["figure.constrained_layout.use"] = False  # the pixels of the sector need axes at a fixed place
    with matplotlib.rc_context(settings):
        drawing = Figure(figsize=SIZE_IN, dpi=DPI)
        axes = drawing.add_axes((0.09, 0.16, 0.76, 0.8))
        axes.set(xlim=(farthest_m, -farthest_m), ylim=(0, farthest_m), xlabel="left of the boresight (m)", ylabel="along the boresight (m)")
        axes.set_aspect("equal", anchor="SW")
        axes.spines[["left", "bottom"]].set_color("#888888")
        bar = drawing.add_axes((0.88, 0.16, 0.025, 0.7))
        bar.imshow(np.linspace(1, 0, 256)[:, None], aspect="auto", cmap="viridis", extent=(0, 1, -DYNAMIC_DB, 0))
        bar.yaxis.tick_right()
        bar.set(xticks=[], title="dB")
        stream = io.BytesIO()
        drawing.savefig(stream, format="rgba", dpi=DPI)
    height, width = round(SIZE_IN[1] * DPI), round(SIZE_IN[0] * DPI)
    picture = np.frombuffer(stream.getvalue(), np.uint8).reshape(height, width, 4)[..., :3].copy()
    row, column = np.mgrid[:height, :width]
    display = np.column_stack([column.ravel() + 0.5, height - row.ravel() - 0.5])
    left, forward = axes.transData.inverted().transform(display).T
    distance, angle = np.hypot(left, forward), np.arctan2(left, forward)
    inside = np.flatnonzero((distance <= farthest_m) & (forward > 0) & (distance >= range_m[1]))
    range_bin = np.clip(np.round(distance[inside] / range_m[1]).astype(int), 0, len(range_m) - 1)
    step = azimuth_rad[1] - azimuth_rad[0]
    azimuth_bin = np.clip(np.round((angle[inside] - azimuth_rad[0]) / step).astype(int), 0, len(azimuth_rad) - 1)
    return picture, row.ravel()[inside], column.ravel()[inside], range_bin, azimuth_bin
