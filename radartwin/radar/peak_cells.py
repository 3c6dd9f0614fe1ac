"""Find the cells of a range-Doppler power map that hold peaks: CFAR, local maxima, window sidelobes, and positions between bins.

The detector drops a local maximum that may be a window sidelobe of a stronger peak. To find the position of a peak between bins, the
detector fits a parabola to the levels (dB) of three neighbouring bins in range and Doppler. With complex sampling, the range axis is
circular like the Doppler axis. Energy just below zero range, such as the edge of the leakage from transmitter to receiver, therefore
appears at the unambiguous range.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.radar.cfar import ca_cfar, training_mean
from radartwin.radar.chirp import Radar
from radartwin.radar.power_maps import PADDING, doppler_bins, range_bins
from radartwin.radar.processing import decibels, hann, range_axis, velocity_axis

Real = NDArray[np.float64]

# Number of guard bins and of training bins on each side of the cell under test, along (Doppler, range), counted without zero padding. The
# detector uses fewer bins if a frame has too few chirps.
GUARD, TRAINING = (3, 3), (4, 4)
FALSE_ALARM = 1e-7  # probability of a false alarm per cell; this value gives one false peak in about a hundred frames
# Smallest ratio of a detected peak's power to the mean power of its training cells. With many frames, the noise estimate is so exact that
# FALSE_ALARM alone would detect every small variation of the clutter.
MIN_CONTRAST_DB = 3.0
# The detector ignores peaks that are weaker than the strongest cell by more than this level, because they may be rounding errors. Single
# precision covers 140 dB below the strongest echo, but this echo may be a static echo that was removed before the detection.
DYNAMIC_RANGE_DB = 100.0
MIN_RANGE_M = 0.2  # peaks at a shorter range are leakage from transmitter to receiver and are ignored
# Factor by which the power of a peak must exceed the window sidelobe of a stronger peak (6 dB), because noise and the sidelobes of other
# peaks add to this sidelobe.
_SIDELOBE_MARGIN = 4.0


@dataclass(frozen=True)
class PeakCells:
    """Hold the cells of N peaks of a range-Doppler map, in the order of descending power of the cells.

    Attributes:
        doppler, range: indices (N,) of the cells.
        range_m, velocity_mps: positions (N,) between the bins; receding velocities are positive.
        residual_mps: velocity (N,) minus the velocity of the Doppler bin.
        power: power (N,) at the position between the bins.
        noise: mean power (N,) of the training cells of the CFAR.
    """

    doppler: NDArray[np.intp]
    range: NDArray[np.intp]
    range_m: Real
    velocity_mps: Real
    residual_mps: Real
    power: Real
    noise: Real

    def __len__(self) -> int:
        return len(self.range)


def peak_cells(power: Real, radar: Radar, frames: int) -> PeakCells:
    """Find the peaks of a range-Doppler map.

    Args:
        power: power (Doppler, range) averaged over channels and frames, with the zero padding of radartwin.radar.power_maps.
        frames: number of frames that were averaged.
    """
    cells, noise = _candidates(power, radar, frames)
    cells = _without_sidelobes(cells, power, radar)
    range_m, velocity_mps = range_axis(radar, range_bins(radar)), velocity_axis(radar, doppler_bins(radar))
    cells = cells[range_m[cells[:, 1]] >= MIN_RANGE_M]
    doppler_cell, range_cell = cells.T
    level_db = decibels(power)
    steps, bins = np.array([[-1], [0], [1]]), power.shape[1]
    rows = level_db[(doppler_cell + steps) % len(power), range_cell]
    beside = (range_cell + steps).clip(0, bins - 1) if radar.real_sampling else (range_cell + steps) % bins
    doppler_shift, doppler_gain = parabola(rows)
    range_shift, range_gain = parabola(level_db[doppler_cell, beside])
    residual_mps = doppler_shift * (2 * radar.max_velocity_mps / len(power))
    return PeakCells(
        doppler=doppler_cell,
        range=range_cell,
        range_m=range_m[range_cell] + range_shift * range_m[1],
        velocity_mps=velocity_mps[doppler_cell] + residual_mps,
        residual_mps=residual_mps,
        power=10 ** ((rows[1] + doppler_gain + range_gain) / 10),
        noise=noise[doppler_cell, range_cell],
    )


def _candidates(power: Real, radar: Radar, frames: int) -> tuple[NDArray[np.intp], Real]:
    """Return the (Doppler, range) bin indices (N, 2) of the local maxima above the CFAR threshold, and the noise power of every cell."""
    from scipy.ndimage import maximum_filter1d

    guard, training = [], []
    for cells, g, t in zip((radar.num_chirps, radar.num_samples), GUARD, TRAINING, strict=True):
        reach = (cells - 1) // 2
        guarded = min(g, reach // 2)
        guard.append(guarded * PADDING)
        training.append(min(t, reach - guarded) * PADDING)
    circular = (True, not radar.real_sampling)
    window = {"guard": tuple(guard), "training": tuple(training), "wrap": circular}
    hits, _ = ca_cfar(
        power, **window, false_alarm=FALSE_ALARM, looks=frames * radar.num_tx * radar.num_rx, min_factor=10 ** (MIN_CONTRAST_DB / 10)
    )
    neighbourhood = 2 * PADDING + 1
    local_maximum = power
    for axis, wraps in enumerate(circular):
        size = min(neighbourhood, power.shape[axis])
        local_maximum = maximum_filter1d(local_maximum, size, axis=axis, mode="wrap" if wraps else "nearest")
    floor = power.max() * 10 ** (-DYNAMIC_RANGE_DB / 10)
    return np.argwhere(hits & (power == local_maximum) & (power > floor)), training_mean(power, **window)[0]


def _without_sidelobes(cells: NDArray[np.intp], power: Real, radar: Radar) -> NDArray[np.intp]:
    """Return the (Doppler, range) indices (N, 2) of the cells that are not sidelobes of a stronger cell, sorted by descending power."""
    order = np.argsort(-power[tuple(cells.T)], kind="stable")
    doppler_skirt, range_skirt = (
        _skirt(size, bins) for size, bins in ((radar.num_chirps, len(power)), (radar.num_samples, power.shape[1]))
    )
    peaks: list[NDArray[np.intp]] = []
    for cell in cells[order]:
        if peaks:
            stronger = np.array(peaks)
            apart = np.abs(stronger - cell)
            apart[:, 0] = np.minimum(apart[:, 0], len(power) - apart[:, 0])
            if not radar.real_sampling:
                apart[:, 1] = np.minimum(apart[:, 1], power.shape[1] - apart[:, 1])
            leaked = power[tuple(stronger.T)] * doppler_skirt[apart[:, 0]] * range_skirt[apart[:, 1]]
            if power[tuple(cell)] < _SIDELOBE_MARGIN * leaked.max():
                continue
        peaks.append(cell)
    return np.array(peaks, dtype=np.intp).reshape(-1, 2)


def _skirt(size: int, bins: int) -> Real:
    """Return the highest window sidelobe at or beyond each distance of 0 to bins - 1 bins from a peak, (bins,)."""
    fine = 8
    response = np.abs(np.fft.fft(hann(size), PADDING * size * fine)) ** 2
    response = response[: response.size // 2 + 1]
    envelope = np.maximum.accumulate(response[::-1])[::-1]
    # A peak may lie half a bin from its cell, so the distance is reduced by half a bin.
    index = np.maximum(np.arange(bins) * fine - fine // 2, 0)
    return envelope[np.minimum(index, envelope.size - 1)]


def parabola(levels_db: Iterable[Real]) -> tuple[Real, Real]:
    """Fit a parabola through three equally spaced values.

    Returns:
        shift: position of the vertex, in steps from the middle value.
        height: height of the vertex above the middle value.
    """
    left, middle, right = levels_db
    curvature = left - 2 * middle + right
    slope = 0.5 * (right - left)
    flat = curvature >= 0
    shift = np.clip(np.where(flat, 0.0, -slope / np.where(flat, -1.0, curvature)), -0.5, 0.5)
    return shift, slope * shift + 0.5 * curvature * shift**2
