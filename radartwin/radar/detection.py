"""Detect echoes in a recording: CFAR in range and Doppler, local maxima, positions between bins, and azimuths.

The detector averages the power over channels and frames before it applies the CFAR threshold. It drops a local maximum that may be a window
sidelobe of a stronger peak. To find the position of a peak between bins, it fits a parabola to the levels (dB) of three neighbouring bins
in range, Doppler and azimuth. With complex sampling, the range axis is circular like the Doppler axis. Energy just below zero range, such
as the edge of the leakage from transmitter to receiver, therefore appears at the unambiguous range.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.cfar import ca_cfar
from radartwin.radar.chirp import Radar
from radartwin.radar.power_maps import PADDING, PowerMaps, power_maps, spectra
from radartwin.radar.processing import azimuth_spectrum, hann

if TYPE_CHECKING:
    import pandas as pd

Complex = NDArray[np.complexfloating]
Real = NDArray[np.float64]

_AZIMUTH_RAD = np.radians(np.arange(-90.0, 90.5, 0.5))
# Number of guard bins and of training bins on each side of the cell under test, along (Doppler, range), counted without zero padding. The
# detector uses fewer bins if a frame has too few chirps.
GUARD, TRAINING = (3, 3), (4, 4)
FALSE_ALARM = 1e-7  # probability of a false alarm per cell, which gives one false peak in about a hundred frames
# Smallest ratio of a detected peak's power to the mean power of its training cells. With many frames, the noise estimate is so exact that
# FALSE_ALARM alone would detect every small variation of the clutter.
MIN_CONTRAST_DB = 3.0
# The detector ignores peaks that are weaker than the strongest cell by more than this level, because they may be rounding errors. Single
# precision covers 140 dB below the strongest echo, but this echo may be a static echo that was removed before the detection.
DYNAMIC_RANGE_DB = 100.0
MIN_RANGE_M = 0.2  # peaks at a shorter range are leakage from transmitter to receiver and are ignored
# Factor by which the power of a peak must exceed the window sidelobe of a stronger peak (6 dB), because noise and sidelobes of further
# peaks add to a sidelobe.
_SIDELOBE_MARGIN = 4.0


@dataclass(frozen=True)
class Peaks:
    """Hold N detected echoes as arrays (N,), sorted from the strongest to the weakest echo.

    The azimuth is atan2(y, x) in the sensor frame, positive to the left. The azimuth is NaN if the radar has a single channel. The radial
    velocity is positive for receding echoes, and NaN if a frame has a single chirp. The unit of the power is the squared unit of the IQ
    samples.
    """

    range_m: Real
    velocity_mps: Real
    azimuth_rad: Real
    power: Real

    def __len__(self) -> int:
        return len(self.range_m)

    def table(self) -> pd.DataFrame:
        """Return a table with the columns range_m, doppler_mps, azimuth_deg, power_db."""
        import pandas as pd

        return pd.DataFrame(
            {
                "range_m": self.range_m,
                "doppler_mps": self.velocity_mps,
                "azimuth_deg": np.degrees(self.azimuth_rad),
                "power_db": 10 * np.log10(self.power),
            }
        )


def detect(iq: Complex, radar: Radar, *, static_removed: bool = False, maps: PowerMaps | None = None) -> Peaks:
    """Detect the peaks of a recording.

    Args:
        iq: samples (frame, chirp, tx, rx, sample); the detector averages the power over all frames.
        radar: radar that recorded the samples.
        static_removed: whether to subtract the echoes at rest before the detection, as in `power_maps`.
        maps: result of `power_maps` for the same arguments; None computes it.
    """
    maps = maps or power_maps(iq, radar, static_removed)
    power = maps.range_doppler
    cells = _candidates(power, radar, frames=len(iq))
    cells = _without_sidelobes(cells, power, radar)
    cells = cells[maps.range_m[cells[:, 1]] >= MIN_RANGE_M]
    if not len(cells):
        return Peaks(*(np.empty(0) for _ in fields(Peaks)))
    doppler_cell, range_cell = cells.T
    decibels = 10 * np.log10(np.maximum(power, np.finfo(np.float64).tiny))
    rows = [decibels[(doppler_cell + step) % len(power), range_cell] for step in (-1, 0, 1)]
    columns = [decibels[doppler_cell, _neighbour(range_cell, step, power.shape[1], radar)] for step in (-1, 0, 1)]
    doppler_shift, doppler_gain = _parabola(rows)
    range_shift, range_gain = _parabola(columns)
    residual_mps = doppler_shift * (2 * radar.max_velocity_mps / len(power))
    measures_speed = radar.num_chirps > 1
    peaks = Peaks(
        range_m=maps.range_m[range_cell] + range_shift * maps.range_m[1],
        velocity_mps=maps.velocity_mps[doppler_cell] + residual_mps if measures_speed else np.full(len(cells), np.nan),
        azimuth_rad=_azimuths(iq, radar, static_removed, cells, residual_mps),
        power=10 ** ((rows[1] + doppler_gain + range_gain) / 10),
    )
    order = np.argsort(-peaks.power, kind="stable")
    return Peaks(*(getattr(peaks, f.name)[order] for f in fields(Peaks)))


def _candidates(power: Real, radar: Radar, frames: int) -> NDArray[np.intp]:
    """Return the (Doppler, range) bin indices of the N local power maxima above the CFAR threshold, (N, 2)."""
    from scipy.ndimage import maximum_filter1d

    guard, training = [], []
    for cells, g, t in zip((radar.num_chirps, radar.num_samples), GUARD, TRAINING, strict=True):
        reach = (cells - 1) // 2
        guarded = min(g, reach // 2)
        guard.append(guarded * PADDING)
        training.append(min(t, reach - guarded) * PADDING)
    circular = (True, not radar.real_sampling)
    hits, _ = ca_cfar(
        power,
        guard=tuple(guard),
        training=tuple(training),
        false_alarm=FALSE_ALARM,
        looks=frames * radar.num_tx * radar.num_rx,
        min_factor=10 ** (MIN_CONTRAST_DB / 10),
        wrap=circular,
    )
    neighbourhood = 2 * PADDING + 1
    local_maximum = power
    for axis, wraps in enumerate(circular):
        size = min(neighbourhood, power.shape[axis])
        local_maximum = maximum_filter1d(local_maximum, size, axis=axis, mode="wrap" if wraps else "nearest")
    floor = power.max() * 10 ** (-DYNAMIC_RANGE_DB / 10)
    return np.argwhere(hits & (power == local_maximum) & (power > floor))


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


def _neighbour(cell: NDArray[np.intp], step: int, size: int, radar: Radar) -> NDArray[np.intp]:
    return np.clip(cell + step, 0, size - 1) if radar.real_sampling else (cell + step) % size


def _skirt(size: int, bins: int) -> Real:
    """Return the highest window sidelobe at or beyond each distance of 0 to bins - 1 bins from a peak, (bins,).

    The sidelobes are given as power divided by the power of the peak.
    """
    fine = 8
    response = np.abs(np.fft.fft(hann(size), PADDING * size * fine)) ** 2
    response = response[: response.size // 2 + 1]
    envelope = np.maximum.accumulate(response[::-1])[::-1]
    # A peak may lie half a bin from its cell, so the distance is reduced by half a bin.
    index = np.maximum(np.arange(bins) * fine - fine // 2, 0)
    return envelope[np.minimum(index, envelope.size - 1)]


def _parabola(decibels: list[Real]) -> tuple[Real, Real]:
    """Fit a parabola through three equally spaced values.

    Returns:
        shift: position of the vertex, in steps from the middle value.
        height: height of the vertex above the middle value.
    """
    left, middle, right = decibels
    curvature = left - 2 * middle + right
    slope = 0.5 * (right - left)
    flat = curvature >= 0
    shift = np.clip(np.where(flat, 0.0, -slope / np.where(flat, -1.0, curvature)), -0.5, 0.5)
    return shift, slope * shift + 0.5 * curvature * shift**2


def _azimuths(iq: Complex, radar: Radar, static_removed: bool, cells: NDArray[np.intp], residual_mps: Real) -> Real:
    """Estimate the azimuth of each detected cell in radians, from the maximum of its Bartlett spectrum averaged over all frames.

    The azimuth is NaN for a radar with a single channel.

    Args:
        iq: samples (frame, chirp, tx, rx, sample).
        radar: radar that recorded the samples.
        static_removed: whether to subtract the echoes at rest.
        cells: (Doppler, range) indices (N, 2) of the detected cells.
        residual_mps: velocity of each peak minus the velocity of its Doppler bin, in m/s. `doppler_fft` has compensated the TDM phase only
            for the velocity of the bin, so this function compensates the phase of the difference.
    """
    if radar.num_tx * radar.num_rx == 1:
        return np.full(len(cells), np.nan)
    doppler_cell, range_cell = cells.T
    residual_hz = 2 * residual_mps * radar.center_frequency_hz / SPEED_OF_LIGHT
    turn = np.exp(-2j * np.pi * residual_hz[:, None] * radar.chirp_times()[0])
    power = np.zeros((len(cells), len(_AZIMUTH_RAD)))
    for _, _, block in spectra(iq, radar, static_removed):
        snapshots = block[:, doppler_cell, :, :, range_cell]  # (cell, frame, tx, rx), NumPy's order for separated indices
        power += azimuth_spectrum(snapshots * turn[:, None, :, None], radar, _AZIMUTH_RAD).sum(axis=1)
    strongest = np.argmax(power, axis=1)
    inner = np.clip(strongest, 1, len(_AZIMUTH_RAD) - 2)
    decibels = 10 * np.log10(np.maximum(power, np.finfo(np.float64).tiny))
    shift, _ = _parabola([decibels[np.arange(len(cells)), inner + step] for step in (-1, 0, 1)])
    return np.where(strongest == inner, _AZIMUTH_RAD[inner] + shift * np.diff(_AZIMUTH_RAD[:2]), _AZIMUTH_RAD[strongest])
