"""Process a recording for the command `radartwin process`: write the peaks, the point clouds and up to three pictures.

The file peaks.csv holds the peaks of the whole recording. The file points.npz holds the points of each frame, in the arrays that
radartwin.radar.point_messages.arrays describes: x, y, z, velocity and intensity of the points, and the first point of each frame.

The three pictures show the echo power in decibels over range and time, over range and Doppler, and over range and azimuth. Each picture
shows the highest 60 dB of its power.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.io import files
from radartwin.plotting import style
from radartwin.radar.captures import capture_name, load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.detection import Peaks, detect, point_clouds
from radartwin.radar.point_messages import arrays
from radartwin.radar.power_maps import PowerMaps, power_maps
from radartwin.radar.processing import decibels

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PEAKS_FILE, POINTS_FILE = "peaks.csv", "points.npz"
_DYNAMIC_RANGE_DB = 60.0


def process_capture(
    path: str | Path,
    out: str | Path | None = None,
    radar: Radar | str | Path | None = None,
    *,
    static_removed: bool = False,
    angle: str = "bartlett",
    **options: Any,
) -> pd.DataFrame:
    """Detect the peaks of a recording, and write a table of the peaks, the point clouds and pictures of the recording.

    Args:
        path: path of a recording of this package (without suffix, or with .bin or .json), of a mmWave Studio .bin file, or of a .npy file
            with an array of samples.
        out: folder for peaks.csv, points.npz, range_time.png, range_doppler.png and range_azimuth.png; None writes no files. If frames
            have a single chirp, there is no range_doppler.png. If the radar has a single channel, there is no range_azimuth.png.
        radar: a Radar or the path of a radar file; a cube and a capture of the cascade require this argument.
        angle: method for the directions of peaks and points, "bartlett", "capon" or "music".
        options: board, iq_swapped, cut, frames and say, as for `load_capture`.
    Returns:
        Table of the peaks, sorted from the strongest to the weakest, with the columns range_m, doppler_mps, azimuth_deg and power_db.
        doppler_mps is NaN if a frame has a single chirp, and azimuth_deg is NaN if the radar has a single channel. power_db is relative to
        the transmitted power, or relative to one squared ADC count in a capture of another tool.
    Raises:
        UserError: the errors of `load_capture`, or OutputError if the function cannot write to `out`; `out` then has no new file,
            unless the last step, the renaming of the files, fails.
    """
    recording = load_capture(path, radar, **options)
    radar = recording.radar
    maps = power_maps(recording.iq, radar, static_removed)
    peaks = detect(recording.iq, radar, static_removed=static_removed, maps=maps, angle=angle)
    table = peaks.table()
    if out is None:
        return table
    unit = "dB of one squared ADC count" if recording.in_counts else "dB of transmitted power"
    has_map = {"range_time": True, "range_doppler": radar.num_chirps > 1, "range_azimuth": radar.num_tx * radar.num_rx > 1}
    pictures = {name: Path(out) / f"{name}.png" for name, possible in has_map.items() if possible}
    points_file, peaks_file = Path(out) / POINTS_FILE, Path(out) / PEAKS_FILE
    with files.replacing_together([*pictures.values(), points_file, peaks_file]) as temporary:
        for name, picture in pictures.items():
            figure = _draw(maps, name, peaks, unit, title=f"{capture_name(path)}: {name.replace('_', '-')}")
            # Leave the version of matplotlib out of the picture file, so that every run writes the same bytes.
            figure.savefig(temporary[picture], format="png", dpi=150, metadata={"Software": None})
        clouds = point_clouds(recording.iq, radar, static_removed=static_removed, angle=angle)
        with temporary[points_file].open("wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays(clouds, radar.frame_rate_hz))
        table.to_csv(temporary[peaks_file], index=False, float_format="%.6g", lineterminator="\n")
    return table


def _draw(maps: PowerMaps, name: str, peaks: Peaks, unit: str, title: str) -> Figure:
    """Draw one power map with range as the vertical axis, and mark the detected peaks in the maps over Doppler and azimuth."""
    import matplotlib

    marks = None
    if name == "range_time":
        in_seconds = maps.time_s[-1] >= 1
        across, label = maps.time_s * (1 if in_seconds else 1e3), f"time ({'s' if in_seconds else 'ms'})"
        power = maps.range_time
    elif name == "range_doppler":
        across, label, power = maps.velocity_mps, "radial velocity (m/s), receding positive", maps.range_doppler
        marks = peaks.velocity_mps
    else:
        # Positive azimuth is drawn on the left, because it is to the left of the radar.
        across, label, power = np.degrees(maps.azimuth_rad[::-1]), "azimuth (degrees), left positive", maps.range_azimuth[::-1]
        marks = np.degrees(peaks.azimuth_rad)
    level_db = decibels(power)
    top = float(level_db.max()) if power.any() else 0.0  # a silent recording has no level
    with matplotlib.rc_context(style.style()):
        figure, axes = style.figure(height_in=4.6)
        xlim, ylim = style.pixel_edges(across), style.pixel_edges(maps.range_m)
        options = {"origin": "lower", "aspect": "auto", "interpolation": "nearest", "cmap": style.SEQUENTIAL}
        image = axes.imshow(level_db.T, extent=(*xlim, *ylim), vmin=top - _DYNAMIC_RANGE_DB, vmax=top, **options)
        if marks is not None and len(peaks):
            axes.plot(marks, peaks.range_m, "o", mfc="none", mec="white", ms=6, mew=0.9, alpha=0.8)
        axes.set(xlabel=label, ylabel="range (m)", title=title, xlim=xlim, ylim=ylim)
        figure.colorbar(image, ax=axes, label=f"power ({unit})")
    return figure
