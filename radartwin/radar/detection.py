"""From a recording to a point cloud: CFAR in range and Doppler, local maxima, sub-bin positions, an azimuth for each.

Powers are averaged over channels and frames before detection. A local maximum that the window sidelobes of a stronger
peak explain is dropped. Range, Doppler and azimuth are refined by a parabola through the decibels of three neighbours.
With complex sampling range is circular like Doppler: what lies just below zero, such as the skirt of the leakage from
transmitter to receiver, appears at the unambiguous range.
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
from radartwin.radar.maps import Chain, Maps, spectra, survey
from radartwin.radar.processing import azimuth_spectrum, window

if TYPE_CHECKING:
    import pandas as pd

Complex = NDArray[np.complexfloating]
Real = NDArray[np.float64]

_AZIMUTH_RAD = np.radians(np.arange(-90.0, 90.5, 0.5))
# A sidelobe's level is uncertain by the noise and the other sidelobes that add to it.
_SIDELOBE_MARGIN = 4.0  # 6 dB


@dataclass(frozen=True)
class Detector:
    """How peaks are told from noise. Cells are native bins: one range or velocity resolution, whatever the padding.

    Attributes:
        method: "ca" or "os".
        guard, training: cells on each side along (Doppler, range); fewer where a frame has too few chirps.
        false_alarm: probability per cell; 1e-7 makes one false peak in about a hundred frames.
        min_contrast_db: least power over the mean of the training cells. Over many frames the noise estimate is so good
            that false_alarm alone would pass every unevenness of the clutter.
        dynamic_range_db: peaks further below the strongest cell may be rounding: single precision keeps 140 dB, less
            what was removed as static.
        min_range_m: nearer peaks are the leakage from transmitter to receiver and are left out.
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
    """Detected echoes, strongest first; arrays of one length.

    Azimuth is atan2(y, x), positive to the left; velocity is positive when receding; power is in the square of the
    samples' unit.
    """

    range_m: Real
    velocity_mps: Real
    azimuth_rad: Real
    power: Real

    def __len__(self) -> int:
        return len(self.range_m)

    def points_m(self) -> Real:
        """Positions in the sensor frame at the radar's height, (N, 3)."""
        azimuth = self.azimuth_rad
        return np.stack([self.range_m * np.cos(azimuth), self.range_m * np.sin(azimuth), 0 * azimuth], axis=-1)

    def table(self) -> pd.DataFrame:
        """Columns range_m, doppler_mps, azimuth_deg, power_db."""
        import pandas as pd

        return pd.DataFrame(
            {
                "range_m": self.range_m,
                "doppler_mps": self.velocity_mps,
                "azimuth_deg": np.degrees(self.azimuth_rad),
                "power_db": 10 * np.log10(self.power),
            }
        )


def detect(iq: Complex, radar: Radar, detector: Detector | None = None, chain: Chain | None = None, *, maps: Maps | None = None) -> Peaks:
    """Peaks of a recording, or of one frame.

    Args:
        iq: (frame, chirp, tx, rx, sample); powers are averaged over frames.
        maps: what survey returned for the same iq and chain, to save its time.
    """
    detector, chain = detector or Detector(), chain or Chain()
    maps = maps or survey(iq, radar, chain)
    power = maps.range_doppler
    cells = _candidates(power, radar, detector, chain, frames=len(iq))
    cells = _without_sidelobes(cells, power, radar, chain)
    cells = cells[maps.range_m[cells[:, 1]] >= detector.min_range_m]
    if not len(cells):
        return Peaks(*(np.empty(0) for _ in fields(Peaks)))
    doppler_cell, range_cell = cells.T
    decibels = 10 * np.log10(np.maximum(power, np.finfo(np.float64).tiny))
    rows = [decibels[(doppler_cell + step) % len(power), range_cell] for step in (-1, 0, 1)]
    columns = [decibels[doppler_cell, _neighbour(range_cell, step, power.shape[1], radar)] for step in (-1, 0, 1)]
    doppler_shift, doppler_gain = _parabola(rows)
    range_shift, range_gain = _parabola(columns)
    velocity_step = 2 * radar.max_velocity_mps / len(power)
    peaks = Peaks(
        range_m=maps.range_m[range_cell] + range_shift * maps.range_m[1],
        velocity_mps=maps.velocity_mps[doppler_cell] + doppler_shift * velocity_step,
        azimuth_rad=_azimuths(iq, radar, chain, cells, doppler_shift * velocity_step),
        power=10 ** ((rows[1] + doppler_gain + range_gain) / 10),
    )
    order = np.argsort(-peaks.power, kind="stable")
    return Peaks(*(getattr(peaks, f.name)[order] for f in fields(Peaks)))


def _candidates(power: Real, radar: Radar, detector: Detector, chain: Chain, frames: int) -> NDArray[np.intp]:
    """(doppler, range) indices of local maxima above the CFAR threshold, (N, 2)."""
    from scipy.ndimage import maximum_filter1d

    guard, training = [], []
    for cells, g, t in zip((radar.num_chirps, radar.num_samples), detector.guard, detector.training, strict=True):
        reach = (cells - 1) // 2
        guarded = min(g, reach // 2)
        guard.append(guarded * chain.padding)
        training.append(min(t, reach - guarded) * chain.padding)
    circular = (True, not radar.real_sampling)
    hits, _ = (ca_cfar if detector.method == "ca" else os_cfar)(
        power,
        guard=tuple(guard),
        training=tuple(training),
        false_alarm=detector.false_alarm,
        looks=frames * radar.num_tx * radar.num_rx,
        least_factor=10 ** (detector.min_contrast_db / 10),
        wrap=circular,
    )
    around = 2 * chain.padding + 1
    tops = power
    for axis, wraps in enumerate(circular):
        size = min(around, power.shape[axis])
        tops = maximum_filter1d(tops, size, axis=axis, mode="wrap" if wraps else "nearest")
    floor = power.max() * 10 ** (-detector.dynamic_range_db / 10)
    return np.argwhere(hits & (power == tops) & (power > floor))


def _without_sidelobes(cells: NDArray[np.intp], power: Real, radar: Radar, chain: Chain) -> NDArray[np.intp]:
    """The cells, strongest first, that are not sidelobes of a stronger one."""
    order = np.argsort(-power[tuple(cells.T)], kind="stable")
    doppler_skirt, range_skirt = (
        _skirt(chain, size, bins) for size, bins in ((radar.num_chirps, len(power)), (radar.num_samples, power.shape[1]))
    )
    kept: list[NDArray[np.intp]] = []
    for cell in cells[order]:
        if kept:
            stronger = np.array(kept)
            apart = np.abs(stronger - cell)
            apart[:, 0] = np.minimum(apart[:, 0], len(power) - apart[:, 0])
            if not radar.real_sampling:
                apart[:, 1] = np.minimum(apart[:, 1], power.shape[1] - apart[:, 1])
            leaked = power[tuple(stronger.T)] * doppler_skirt[apart[:, 0]] * range_skirt[apart[:, 1]]
            if power[tuple(cell)] < _SIDELOBE_MARGIN * leaked.max():
                continue
        kept.append(cell)
    return np.array(kept, dtype=np.intp).reshape(-1, 2)


def _neighbour(cell: NDArray[np.intp], step: int, size: int, radar: Radar) -> NDArray[np.intp]:
    return np.clip(cell + step, 0, size - 1) if radar.real_sampling else (cell + step) % size


def _skirt(chain: Chain, size: int, bins: int) -> Real:
    """Highest power response of the window at each distance in bins or beyond, over its peak, (bins,)."""
    fine = 8
    response = np.abs(np.fft.fft(window(chain.taper, size), chain.padding * size * fine)) ** 2
    response = response[: response.size // 2 + 1]
    held = np.maximum.accumulate(response[::-1])[::-1]
    # Half a bin nearer: neither peak lies on a bin's centre.
    index = np.maximum(np.arange(bins) * fine - fine // 2, 0)
    return held[np.minimum(index, held.size - 1)]


def _parabola(decibels: list[Real]) -> tuple[Real, Real]:
    """Vertex of the parabola through three equally spaced values: shift from the middle in steps, height above it."""
    left, middle, right = decibels
    curvature = left - 2 * middle + right
    slope = 0.5 * (right - left)
    flat = curvature >= 0
    shift = np.clip(np.where(flat, 0.0, -slope / np.where(flat, -1.0, curvature)), -0.5, 0.5)
    return shift, slope * shift + 0.5 * curvature * shift**2


def _azimuths(iq: Complex, radar: Radar, chain: Chain, cells: NDArray[np.intp], residual_mps: Real) -> Real:
    """Direction of the strongest Bartlett response of each cell, averaged over frames; NaN for a single channel.

    Args:
        residual_mps: velocity beyond the Doppler bin's own, whose turn between transmitters is still in the bin.
    """
    if radar.num_tx * radar.num_rx == 1:
        return np.full(len(cells), np.nan)
    doppler_cell, range_cell = cells.T
    residual_hz = 2 * residual_mps * radar.center_frequency_hz / SPEED_OF_LIGHT
    turn = np.exp(-2j * np.pi * residual_hz[:, None] * radar.chirp_times()[0])
    power = np.zeros((len(cells), len(_AZIMUTH_RAD)))
    for _, _, block in spectra(iq, radar, chain):
        snapshots = block[:, doppler_cell, :, :, range_cell]  # (cell, frame, tx, rx), as NumPy orders split indices
        power += azimuth_spectrum(snapshots * turn[:, None, :, None], radar, _AZIMUTH_RAD).sum(axis=1)
    top = np.argmax(power, axis=1)
    inner = np.clip(top, 1, len(_AZIMUTH_RAD) - 2)
    decibels = 10 * np.log10(np.maximum(power, np.finfo(np.float64).tiny))
    shift, _ = _parabola([decibels[np.arange(len(cells)), inner + step] for step in (-1, 0, 1)])
    return np.where(top == inner, _AZIMUTH_RAD[inner] + shift * np.diff(_AZIMUTH_RAD[:2]), _AZIMUTH_RAD[top])
