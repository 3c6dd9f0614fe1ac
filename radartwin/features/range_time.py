"""Show a turntable revolution as a picture of two channels for a convolutional network: range over time, and range over Doppler frequency.

P(f, r) is the power of frame f at range bin r, averaged over the azimuth channels and over the whole revolutions of the recording.

- Channel 0 is the level of P over time. Row h of H rows stands for the turntable angle 2 pi h / H after the first frame. The power of the
  row is the average of the frames around this angle. The weights are triangular and reach one row spacing to either side, so that a flash
  of a flat panel cannot fall between two rows. If the revolution has fewer than H frames, the weights reach one frame spacing. The rows are
  circular: the first row follows the last row.
- Channel 1 is the range-Doppler signature (signature.py). Row H // 2 has the Doppler frequency 0 Hz, and neighbouring rows differ by one
  cycle per revolution. If a revolution has more than H frames, only the H lowest Doppler frequencies remain. If it has fewer frames, the
  level of the missing rows is 0.

Each channel holds levels from 0 to 1 that are linear in dB: the strongest cell has 1, cells signature.FLOOR_DB or more below it have 0. The
picture therefore does not depend on the gain of the radar. If the revolution starts later, the rows of channel 0 shift cyclically, and
channel 1 does not change. The columns are range bins, with the bin nearest to the target in column W // 2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.features.signature import doppler_power, levels, revolutions

# Default numbers of rows H and columns W. 24 rows are the fewest frames per revolution of a campaign profile. 23 range bins of 4.4 cm, the
# bin spacing of the radar in the RadarTwin paper, span 1 m, as the signature does.
ROWS, COLUMNS = 24, 23
SHAPE = (2, ROWS, COLUMNS)


def picture(processed: Processed, angle_rad: NDArray, target_m: float, rows: int = ROWS, columns: int = COLUMNS) -> NDArray[np.float32]:
    """Compute the picture (2, rows, columns) of a turntable recording, with levels from 0 to 1 as the module's docstring defines them.

    Columns beyond the first or the last range bin of the recording have the level 0.

    Args:
        processed: processed turntable recording of F frames.
        angle_rad: (F,) nominal turntable angle of each frame in radians, which must rise in all frames or fall in all frames.
        target_m: range of the target in metres.
        rows: number H of rows, at least 2.
        columns: number W of range bins, at least 1.
    Raises:
        InputError: the recording is shorter than one revolution, or it has no energy near the target.
    """
    if rows < 2 or columns < 1:
        raise InputError(f"picture: {rows} rows and {columns} columns are too few; give at least 2 rows and 1 column")
    bins, inside = _bins(processed, target_m, columns)
    over_time = np.mean([_power(processed, turn, bins) for turn in revolutions(angle_rad)], axis=0)
    if not over_time.max() > 0:
        raise InputError(f"picture: there is no energy in the {columns} range bins around {target_m:g} m; check the target's distance")
    out = np.zeros((2, rows, columns), np.float32)
    out[0][:, inside] = levels(sector_weights(len(over_time), rows) @ over_time)
    spectrum = np.fft.fftshift(levels(doppler_power(processed, angle_rad, bins)), axes=0)
    kept = min(rows, len(spectrum))
    first, place = len(spectrum) // 2 - kept // 2, rows // 2 - kept // 2
    out[1, place : place + kept, inside] = spectrum[first : first + kept].T
    return out


def sector_weights(frames: int, rows: int) -> NDArray[np.float64]:
    """Return the weights (rows, frames) that average the frames of a revolution around each of `rows` equally spaced angles.

    The weights of a row sum to 1 and fall linearly to 0 at one row spacing, or at one frame spacing if there are fewer frames than rows.

    >>> sector_weights(4, 2).tolist()
    [[0.5, 0.25, 0.0, 0.25], [0.0, 0.25, 0.5, 0.25]]
    """
    width = max(1.0, frames / rows)
    apart = np.abs(np.arange(rows)[:, None] * frames / rows - np.arange(frames))
    weights = np.maximum(0.0, 1 - np.minimum(apart, frames - apart) / width)
    return weights / weights.sum(axis=1, keepdims=True)


def flattened(picture: NDArray) -> tuple[list[str], NDArray[np.float64]]:
    """Return names and values (2 * H * W,) of a picture's cells in the order (channel, row, column), as a feature row for Samples."""
    channels = ("time", "doppler")
    names = [f"{channels[c]} {h} bin {w - picture.shape[2] // 2:+d}" for c, h, w in np.ndindex(*picture.shape)]
    return names, picture.astype(np.float64).ravel()


def _bins(processed: Processed, target_m: float, columns: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the range bins of the picture that the recording has, and the mask (columns,) of their columns."""
    bins = int(np.abs(processed.range_m - target_m).argmin()) + np.arange(columns) - columns // 2
    inside = (bins >= 0) & (bins < len(processed.range_m))
    return bins[inside], inside


def _power(processed: Processed, turn: slice, bins: NDArray[np.intp]) -> NDArray[np.float64]:
    return np.asarray(np.mean(np.abs(processed.channels[turn][..., bins]) ** 2, axis=1, dtype=np.float64))
