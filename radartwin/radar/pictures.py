"""Range-time, range-Doppler and range-azimuth pictures, in decibels over a fixed span below the strongest cell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from radartwin.plotting import style
from radartwin.radar.detection import Peaks
from radartwin.radar.maps import Maps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Real = NDArray[np.float64]

DYNAMIC_RANGE_DB = 60.0
PICTURES = ("range_time", "range_doppler", "range_azimuth")


def draw(maps: Maps, name: str, *, peaks: Peaks | None = None, unit: str = "dB", title: str = "") -> Figure:
    """One of PICTURES as a matplotlib figure, range upwards.

    Args:
        peaks: marked in range-Doppler and range-azimuth.
        unit: of the colour bar, such as "dB of transmitted power".
    """
    import matplotlib

    across, label, power = {
        "range_time": _time(maps),
        "range_doppler": (maps.velocity_mps, "radial velocity (m/s), receding positive", maps.range_doppler),
        # Left of the radar is drawn on the left, so positive azimuth is too.
        "range_azimuth": (
            np.degrees(maps.azimuth_rad[::-1]),
            "azimuth (degrees), left positive",
            maps.range_azimuth[::-1],
        ),
    }[name]
    decibels, top = in_decibels(power)
    with matplotlib.rc_context(style.style()):
        figure, axes = style.figure(height_in=4.6)
        image = axes.imshow(
            decibels.T,
            origin="lower",
            aspect="auto",
            interpolation="nearest",
            extent=(*_edges(across), *_edges(maps.range_m)),
            vmin=top - DYNAMIC_RANGE_DB,
            vmax=top,
            cmap=style.SEQUENTIAL,
        )
        marks = {"range_doppler": peaks.velocity_mps, "range_azimuth": np.degrees(peaks.azimuth_rad)} if peaks else {}
        if peaks and name in marks:
            axes.plot(marks[name], peaks.range_m, "o", mfc="none", mec="white", ms=6, mew=0.9, alpha=0.8)
        axes.set(xlabel=label, ylabel="range (m)", title=title, xlim=_edges(across), ylim=_edges(maps.range_m))
        figure.colorbar(image, ax=axes, label=f"power ({unit})")
    return figure


def in_decibels(power: Real) -> tuple[Real, float]:
    """Power in decibels, clipped at DYNAMIC_RANGE_DB below its maximum, and that maximum."""
    strongest = float(power.max())
    if strongest <= 0:
        return np.full(power.shape, -DYNAMIC_RANGE_DB), 0.0
    top = 10 * np.log10(strongest)
    return 10 * np.log10(np.maximum(power, strongest * 10 ** (-DYNAMIC_RANGE_DB / 10))), float(top)


def write(figure: Figure, path: Path) -> None:
    """Save a PNG that is the same byte for byte on every run."""
    figure.savefig(path, format="png", dpi=150, metadata={"Software": None})


def _time(maps: Maps) -> tuple[Real, str, Real]:
    span = maps.time_s[-1] if len(maps.time_s) > 1 else 0.0
    return (maps.time_s, "time (s)", maps.range_time) if span >= 1 else (maps.time_s * 1e3, "time (ms)", maps.range_time)


def _edges(axis: Real) -> tuple[float, float]:
    """Outer edges of the first and last pixel of an evenly spaced axis, in its own direction."""
    half = (axis[1] - axis[0]) / 2 if len(axis) > 1 else 0.5
    return float(axis[0] - half), float(axis[-1] + half)
