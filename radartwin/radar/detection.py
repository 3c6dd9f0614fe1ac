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
from radartwin.errors import InputError
from radartwin.radar.cfar import ca_cfar, os_cfar
from radartwin.radar.chirp import Radar
from radartwin.radar.power_maps import FftSettings, PowerMaps, power_maps, spectra
from radartwin.radar.processing import azimuth_spectrum, window_weights

if TYPE_CHECKING:
    import pandas as pd

Complex = NDArray[np.complexfloating]
Real = NDArray[np.float64]

_AZIMUTH_RAD = np.radians(np.arange(-90.0, 90.5, 0.5))
_SIDELOBE_MARGIN = 4.0  # power factor (6 dB) above the window's sidelobe, because noise and other sidelobes add to a sidelobe


@dataclass(frozen=True)
class Detector:
    """Hold the settings of the detection. A cell is an unpadded bin, one range or velocity resolution wide.

    Attributes:
        method: CFAR method, "ca" or "os".
        guard, training: number of cells on each side along (Doppler, range); reduced if a frame has too few chirps.
        false_alarm: false-alarm probability per cell; 1e-7 gives one false peak in about a hundred frames.
        min_contrast_db: minimum ratio of a peak to the mean of its training cells. With many frames the noise estimate is so
            exact that `false_alarm` alone would detect every small variation of the clutter.
        dynamic_range_db: peaks weaker than the strongest cell by more are ignored, because they may be rounding errors. Single
            precision covers 140 dB below the strongest echo, which may be a static echo that was removed before the detection.
        min_range_m: peaks at shorter range are ignored, because they are leakage from transmitter to receiver.
    """

    method: str = "ca"
    guard: tuple[int, int] = (3, 3)
    training: tuple[int, int] = (4, 4)
    false_alarm: float = 1e-7
    min_contrast_db: float = 3.0
    dynamic_range_db: float = 100.0
    min_range_m: float = 0.2

    def __post_init__(self) -> None:
        if self.method not in ("ca", "os"):
            raise InputError(f"detection method {self.method!r} is unknown; use ca or os")


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


def detect(
    iq: Complex, radar: Radar, detector: Detector | None = None, settings: FftSettings | None = None, *, maps: PowerMaps | None = None
) -> Peaks:
    """Detect the peaks of a recording.

    Args:
        iq: (frame, chirp, tx, rx, sample); powers are averaged over frames.
        maps: the result of power_maps for the same iq and settings, if it is already computed.
    """
    detector, settings = detector or Detector(), settings or FftSettings()
    maps = maps or power_maps(iq, radar, settings)
    power = maps.range_doppler
    cells = _candidates(power, radar, detector, settings, frames=len(iq))
    cells = _without_sidelobes(cells, power, radar, settings)
    cells = cells[maps.range_m[cells[:, 1]] >= detector.min_range_m]
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
        azimuth_rad=_azimuths(iq, radar, settings, cells, residual_mps),
        power=10 ** ((rows[1] + doppler_gain + range_gain) / 10),
    )
    order = np.argsort(-peaks.power, kind="stable")
    return Peaks(*(getattr(peaks, f.name)[order] for f in fields(Peaks)))


def _candidates(power: Real, radar: Radar, detector: Detector, settings: FftSettings, frames: int) -> NDArray[np.intp]:
    """Return the (doppler, range) indices of local maxima above the CFAR threshold, (N, 2)."""
    from scipy.ndimage import maximum_filter1d

    guard, training = [], []
    for cells, g, t in zip((radar.num_chirps, radar.num_samples), detector.guard, detector.training, strict=True):
        reach = (cells - 1) // 2
        guarded = min(g, reach // 2)
        guard.append(guarded * settings.padding)
        training.append(min(t, reach - guarded) * settings.padding)
    circular = (True, not radar.real_sampling)
    hits, _ = (ca_cfar if detector.method == "ca" else os_cfar)(
        power,
        guard=tuple(guard),
        training=tuple(training),
        false_alarm=detector.false_alarm,
        looks=frames * radar.num_tx * radar.num_rx,
        min_factor=10 ** (detector.min_contrast_db / 10),
        wrap=circular,
    )
    neighbourhood = 2 * settings.padding + 1
    local_maximum = power
    for axis, wraps in enumerate(circular):
        size = min(neighbourhood, power.shape[axis])
        local_maximum = maximum_filter1d(local_maximum, size, axis=axis, mode="wrap" if wraps else "nearest")
    floor = power.max() * 10 ** (-detector.dynamic_range_db / 10)
    return np.argwhere(hits & (power == local_maximum) & (power > floor))


def _without_sidelobes(cells: NDArray[np.intp], power: Real, radar: Radar, settings: FftSettings) -> NDArray[np.intp]:
    """Return the cells that are not sidelobes of a stronger cell, the strongest first, (N, 2)."""
    order = np.argsort(-power[tuple(cells.T)], kind="stable")
    doppler_skirt, range_skirt = (
        _skirt(settings, size, bins) for size, bins in ((radar.num_chirps, len(power)), (radar.num_samples, power.shape[1]))
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


def _skirt(settings: FftSettings, size: int, bins: int) -> Real:
    """Return, for each distance in bins, the highest sidelobe of the window at or beyond it, as power over the main peak, (bins,)."""
    fine = 8
    response = np.abs(np.fft.fft(window_weights(settings.window, size), settings.padding * size * fine)) ** 2
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


def _azimuths(iq: Complex, radar: Radar, settings: FftSettings, cells: NDArray[np.intp], residual_mps: Real) -> Real:
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
    for _, _, block in spectra(iq, radar, settings):
        snapshots = block[:, doppler_cell, :, :, range_cell]  # (cell, frame, tx, rx), NumPy's order for separated indices
        power += azimuth_spectrum(snapshots * turn[:, None, :, None], radar, _AZIMUTH_RAD).sum(axis=1)
    strongest = np.argmax(power, axis=1)
    inner = np.clip(strongest, 1, len(_AZIMUTH_RAD) - 2)
    decibels = 10 * np.log10(np.maximum(power, np.finfo(np.float64).tiny))
    shift, _ = _parabola([decibels[np.arange(len(cells)), inner + step] for step in (-1, 0, 1)])
    return np.where(strongest == inner, _AZIMUTH_RAD[inner] + shift * np.diff(_AZIMUTH_RAD[:2]), _AZIMUTH_RAD[strongest])
