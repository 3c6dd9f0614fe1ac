"""Detect echoes in a recording: CFAR in range and Doppler, local maxima, positions between bins, and directions.

The function `detect` averages the power over channels and frames and gives the echoes of a whole recording. The function `point_clouds`
averages over channels only and gives the echoes of each frame.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.cell_directions import cell_directions
from radartwin.radar.chirp import Radar
from radartwin.radar.covariance import Covariance, covariance
from radartwin.radar.peak_cells import PeakCells, peak_cells
from radartwin.radar.power_maps import PowerMaps, channel_power, power_maps, spectra
from radartwin.radar.processing import decibels, unit_vectors

if TYPE_CHECKING:
    import pandas as pd

Complex = NDArray[np.complexfloating]
Real = NDArray[np.float64]


@dataclass(frozen=True)
class Peaks:
    """Hold N detected echoes as arrays (N,), sorted from the strongest to the weakest echo.

    The azimuth is atan2(y, x) in the sensor frame, positive to the left. The azimuth is NaN if the radar has a single channel or no
    horizontal aperture. The elevation is positive upwards. The elevation is NaN if it was not measured, and the azimuth is then that of a
    target at elevation 0. The radial velocity is positive for receding echoes, and NaN if a frame has a single chirp. The unit of the power
    and of the noise is the squared unit of the IQ samples. The noise is the mean power of the training cells of the CFAR.
    """

    range_m: Real
    velocity_mps: Real
    azimuth_rad: Real
    elevation_rad: Real
    power: Real
    noise: Real

    def __len__(self) -> int:
        return len(self.range_m)

    @property
    def snr_db(self) -> Real:
        """Return the ratio of power to noise in dB, (N,). The power includes the noise of the cell."""
        return decibels(self.power) - decibels(self.noise)

    @property
    def xyz_m(self) -> Real:
        """Return the positions (N, 3) in the sensor frame, x forward, y left, z up. A direction that was not measured counts as zero."""
        angles = (np.nan_to_num(angle) for angle in (self.azimuth_rad, self.elevation_rad))
        return self.range_m[:, None] * unit_vectors(*angles)

    def table(self) -> pd.DataFrame:
        """Return a table with the columns range_m, doppler_mps, azimuth_deg, power_db."""
        import pandas as pd

        columns = {"range_m": self.range_m, "doppler_mps": self.velocity_mps, "azimuth_deg": np.degrees(self.azimuth_rad)}
        return pd.DataFrame({**columns, "power_db": 10 * np.log10(self.power)})


def detect(iq: Complex, radar: Radar, *, static_removed: bool = False, maps: PowerMaps | None = None, angle: str = "bartlett") -> Peaks:
    """Detect the peaks of a recording, without elevation.

    Args:
        iq: samples (frame, chirp, tx, rx, sample); the detector averages the power over all frames.
        static_removed: whether to subtract the echoes at rest before the detection, as in `power_maps`.
        maps: result of `power_maps` for the same arguments; None computes the maps.
        angle: "bartlett", "capon" or "music" (see radartwin.radar.cell_directions); the last two can find two peaks in one cell.
    """
    maps = maps or power_maps(iq, radar, static_removed)
    cells = peak_cells(maps.range_doppler, radar, frames=len(iq))
    total = np.zeros((len(cells), radar.num_tx * radar.num_rx, radar.num_tx * radar.num_rx), dtype=np.complex128)
    if len(cells):
        for _, _, block in spectra(iq, radar, static_removed):
            signals = _covariance(block, cells, radar)
            total += signals.matrix * signals.count
    return _peaks(cells, Covariance(total / len(iq), len(iq)), radar, angle, elevation=False)


def point_clouds(iq: Complex, radar: Radar, *, static_removed: bool = False, angle: str = "bartlett") -> list[Peaks]:
    """Detect the peaks of each frame of a recording, with the elevation if the antennas of the radar have different heights.

    Args:
        iq: samples (frame, chirp, tx, rx, sample).
        static_removed: whether to subtract the mean of each channel over all frames and chirps before the detection.
        angle: "bartlett", "capon" or "music" (see radartwin.radar.cell_directions).
    Returns:
        One set of peaks per radar frame, in the sensor frame at the time of this radar frame. A radar frame without an echo has no peaks.
    """
    clouds = []
    for _, _, block in spectra(iq, radar, static_removed):
        for frame in block:
            cells = peak_cells(channel_power(frame).mean(axis=(1, 2)), radar, frames=1)
            clouds.append(_peaks(cells, _covariance(frame[None], cells, radar), radar, angle, elevation=True))
    return clouds


def _covariance(block: Complex, cells: PeakCells, radar: Radar) -> Covariance:
    """Return the covariance matrices (cell, channel, channel) over the frames of Doppler spectra (frame, Doppler, tx, rx, range)."""
    residual_hz = 2 * cells.residual_mps * radar.center_frequency_hz / SPEED_OF_LIGHT
    phasor = np.exp(-2j * np.pi * residual_hz[:, None] * radar.chirp_times()[0])
    snapshots = block[:, cells.doppler, :, :, cells.range]  # (cell, frame, tx, rx), NumPy's order for separated indices
    return covariance((snapshots * phasor[:, None, :, None]).reshape(len(cells), len(block), radar.num_tx * radar.num_rx))


def _peaks(cells: PeakCells, signals: Covariance, radar: Radar, angle: str, elevation: bool) -> Peaks:
    """Return the peaks of cells whose covariance matrices over the channels are given. A cell with two targets gives two peaks."""
    directions = cell_directions(signals, radar, angle, elevation)
    cell = directions.cell
    peaks = Peaks(
        range_m=cells.range_m[cell],
        velocity_mps=cells.velocity_mps[cell] if radar.num_chirps > 1 else np.full(len(cell), np.nan),
        azimuth_rad=directions.azimuth_rad,
        elevation_rad=directions.elevation_rad,
        power=cells.power[cell] * directions.share,
        noise=cells.noise[cell],
    )
    order = np.argsort(-peaks.power, kind="stable")
    return Peaks(*(getattr(peaks, f.name)[order] for f in fields(Peaks)))
