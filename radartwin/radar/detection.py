"""Detect the point cloud of a recording: CFAR in range and Doppler, local maxima, sub-bin positions and azimuths.

Powers are averaged over channels and frames before detection. A local maximum is dropped if it may be a window sidelobe of a
stronger peak. A parabola through the levels (dB) of three neighbouring bins refines range, Doppler and azimuth. With complex
sampling, range is circular like Doppler: energy just below zero range, such as the edge of the leakage from transmitter to
receiver, appears at the unambiguous range.
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
GUARD, TRAINING = (3, 3), (4, 4)  # unpadded bins on each side along (Doppler, range); reduced if a frame has too few chirps
FALSE_ALARM = 1e-7  # false-alarm probability per cell: one false peak in about a hundred frames
# Minimum ratio of a peak to the mean of its training cells. With many frames the noise estimate is so exact that FALSE_ALARM alone would
# detect every small variation of the clutter.
MIN_CONTRAST_DB = 3.0
# Peaks weaker than the strongest cell by more are ignored, because they may be rounding errors. Single precision covers 140 dB below the
# strongest echo, which may be a static echo that was removed before the detection.
DYNAMIC_RANGE_DB = 100.0
MIN_RANGE_M = 0.2  # peaks at shorter range are leakage from transmitter to receiver
_SIDELOBE_MARGIN = 4.0  # power factor (6 dB) above the window's sidelobe, because noise and other sidelobes add to a sidelobe


@dataclass(frozen=True)
class Peaks:
    """Hold detected echoes, strongest first, as arrays (N,).

    Azimuth is atan2(y, x), positive to the left, and NaN if the radar has a single channel. Velocity is positive for receding
    echoes, and NaN if a frame has one chirp. Power is in the square of the unit of the samples.
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
        iq: (frame, chirp, tx, rx, sample); powers are averaged over frames.
        static_removed: as for power_maps.
        maps: the result of power_maps for the same arguments, if it is already computed.
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
    """Return the (doppler, range) indices of local maxima above the CFAR threshold, (N, 2)."""
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
    """Return the cells that are not sidelobes of a stronger cell, the strongest first, (N, 2)."""
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
    """Return, for each distance in bins, the highest sidelobe of the window at or beyond it, as power over the main peak, (bins,)."""
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
    """Estimate the azimuth of each cell from the maximum of its Bartlett spectrum over all frames; NaN for a single channel.

    Args:
        residual_mps: velocity of the peak minus velocity of its Doppler bin; the TDM phase of this difference is not yet compensated.
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
