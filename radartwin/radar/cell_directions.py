"""Find the directions of the targets in a range-Doppler cell from the covariance matrix of its channels.

The azimuth comes from the azimuth row (`azimuth_row`), and the elevation from all virtual antennas if their heights differ. The azimuth row
measures the direction cosine u_y = sin(azimuth) cos(elevation). The azimuth at elevation 0 is therefore asin(u_y). If the elevation is
measured, the direction cosine u_z is found with the Bartlett beam of all antennas at this fixed u_y. The azimuth is then atan2(u_y, u_x).
Capon and MUSIC sort the row by y and average the channels whose antennas have equal y (`row_places`), because smoothing needs a uniform
linear array.

If the antennas of the azimuth row have the same y, the row does not measure u_y, and the azimuth is NaN. If all antennas have the same y,
the search over u_z uses u_y = 0, because the phases do not depend on u_y. If only the antennas of the row have the same y, the elevation is
NaN too, because the other antennas do not separate u_y from u_z.

Bartlett gives one target per cell, because a weaker maximum may be a sidelobe. Capon and MUSIC give up to TARGETS_PER_CELL targets. The
powers of several targets are the least-squares estimates diag(A+ R A+^H), where A+ is the pseudo-inverse of the responses A. A target is
dropped if it is more than DEPTH_DB weaker than the strongest target of the cell. A maximum is dropped if its response is nearly parallel to
the response of a higher maximum (PARALLEL).

A uniform row with the spacing d has equal responses in the directions u_y and u_y +- lambda_c/d, where lambda_c is the wavelength at the
middle of the sweep. A direction is therefore unambiguous if |u_y| < lambda_c/d - 1. The sector |u_y| <= lambda_c/(2d) contains one
direction of each pair of equal responses. Beyond the unambiguous sector, each method reports one of the two directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.radar.angles import BARTLETT, METHODS, AngleMethod, AngleSpectrum, spectrum
from radartwin.radar.chirp import Radar
from radartwin.radar.covariance import Covariance, uniform_step
from radartwin.radar.peak_cells import parabola
from radartwin.radar.processing import azimuth_row, decibels, response, row_places, unit_vectors

Real = NDArray[np.float64]

TARGETS_PER_CELL = 2
# A target that is weaker by this level than another target of its cell may come from errors of the channels. Phase errors of 20 degrees
# leave a remainder of 0.35 of the amplitude, which is 9 dB below the target.
DEPTH_DB = 10.0
# Two maxima with r = |a1^H a2|/M above this value count as one direction. A row of A+ has the squared length 1/(M (1 - r^2)), so that a
# target's power is at most 1/(1 - r^2) = 10 times the mean power of the channels. On a uniform line, directions 0.18 Rayleigh widths apart
# have this r. MUSIC at 20 dB needs 0.20 Rayleigh widths to resolve two targets (docs/concepts.md).
PARALLEL = 0.95
LOADING = 1e-3  # diagonal loading of Capon, in mean eigenvalues
_AZIMUTH_RAD = np.radians(np.arange(-90.0, 90.5, 0.5))
_UZ = np.linspace(-1.0, 1.0, 401)  # direction cosines of the elevation; the step is 0.005
_ZOOMS, _ZOOM_POINTS = 2, 41


@dataclass(frozen=True)
class Directions:
    """Hold the directions of T targets.

    Attributes:
        cell: index (T,) of the target's cell.
        azimuth_rad: azimuth (T,) atan2(y, x), positive to the left; NaN if the azimuth row has no horizontal aperture.
        elevation_rad: elevation (T,) asin(z), positive upwards; NaN if it was not measured, and the azimuth then is that at elevation 0.
        share: power (T,) of the target over the mean power of the channels of its cell; 1 in a cell with a single target.
    """

    cell: NDArray[np.intp]
    azimuth_rad: Real
    elevation_rad: Real
    share: Real


def standard_method(name: str, positions_m: Real) -> AngleMethod:
    """Return the settings of a method in `cell_directions`, for antennas at the positions (M, 3), sorted along their line.

    On a uniform line, Capon and MUSIC smooth forward and backward over sub-arrays of two thirds of the antennas, because the echoes of a
    cell are coherent. Because of the smoothing, the matrix has full rank even from a single snapshot.
    """
    if name not in METHODS:
        raise InputError(f"angle method {name!r} is unknown; use one of {', '.join(METHODS)}")
    antennas = len(positions_m)
    if name == "bartlett" or antennas < 3:
        return BARTLETT
    try:
        uniform_step(positions_m)
    except InputError:
        return AngleMethod(name, LOADING, sources=1)
    subarray = antennas - antennas // 3
    return AngleMethod(name, LOADING, subarray, True, min(TARGETS_PER_CELL, subarray - 1))


def has_elevation(radar: Radar) -> bool:
    """Return whether the virtual antennas have different heights."""
    return len(azimuth_row(radar)) < radar.num_tx * radar.num_rx


def _has_width(positions_m: Real, radar: Radar) -> bool:
    """Return whether antennas (M, 3) have different y, with the tolerance that `azimuth_row` has for heights."""
    return bool(np.ptp(positions_m[:, 1]) > 0.01 * radar.wavelength_m)


def cell_directions(signals: Covariance, radar: Radar, method: str, elevation: bool) -> Directions:
    """Find the directions of the targets in N cells.

    Args:
        signals: covariance matrices (N, V, V) of the V = num_tx * num_rx channels of each cell, with the TDM phase compensated.
        method: "bartlett", "capon" or "music".
        elevation: whether to measure the elevation, if the radar can.
    """
    row = azimuth_row(radar)
    positions, frequency_hz = radar.virtual_positions, radar.center_frequency_hz
    if not _has_width(positions[row], radar):
        cell, unknown = np.arange(len(signals.matrix)), np.full(len(signals.matrix), np.nan)
        measured = elevation and has_elevation(radar) and not _has_width(positions, radar)
        uz = _all_uz(signals, positions, frequency_hz, cell, np.zeros(len(cell))) if measured else unknown
        return Directions(cell, unknown, np.arcsin(uz), np.ones(len(cell)))
    of_row, at = Covariance(signals.matrix[:, row[:, None], row], signals.count), positions[row]
    if method != "bartlett":
        average = row_places(radar) == np.unique(row_places(radar))[:, None]
        average = average / average.sum(axis=1, keepdims=True)
        of_row, at = Covariance(average @ of_row.matrix @ average.T, signals.count), average @ at
    settings = standard_method(method, at)
    if settings is BARTLETT:
        cell = np.arange(len(of_row.matrix))
        azimuth_rad, share = _strongest(spectrum(of_row, at, frequency_hz)), np.ones(len(cell))
    else:
        targets = [_targets(Covariance(matrix, signals.count), at, frequency_hz, settings) for matrix in of_row.matrix]
        cell = np.repeat(np.arange(len(targets)), [len(angles) for angles, _ in targets])
        azimuth_rad, share = (
            (np.concatenate([np.empty(0), *parts]) for parts in zip(*targets, strict=True)) if targets else (np.empty(0),) * 2
        )
    if not (elevation and has_elevation(radar)):
        return Directions(cell, azimuth_rad, np.full(len(cell), np.nan), share)
    uy = np.sin(azimuth_rad)
    uz = _all_uz(signals, positions, frequency_hz, cell, uy)
    return Directions(cell, np.arctan2(uy, _ux(uy, uz)), np.arcsin(uz), share)


def _strongest(power_at: AngleSpectrum) -> Real:
    """Return the azimuths (N,) of the highest maxima of N spectra, interpolated by a parabola through the levels at three azimuths."""
    power = power_at(unit_vectors(_AZIMUTH_RAD))
    strongest = np.argmax(power, axis=1)
    inner = np.clip(strongest, 1, len(_AZIMUTH_RAD) - 2)
    level_db = decibels(power)
    shift, _ = parabola([level_db[np.arange(len(power)), inner + step] for step in (-1, 0, 1)])
    return np.where(strongest == inner, _AZIMUTH_RAD[inner] + shift * np.diff(_AZIMUTH_RAD[:2]), _AZIMUTH_RAD[strongest])


def _targets(signals: Covariance, positions_m: Real, frequency_hz: float, method: AngleMethod) -> tuple[Real, Real]:
    """Return the azimuths (T,) of a cell's targets and their powers over the mean power of the channels, strongest first."""
    power_at = spectrum(signals, positions_m, frequency_hz, method)
    level = power_at(unit_vectors(_AZIMUTH_RAD))
    azimuth_rad, waves = np.empty(0), np.empty((len(positions_m), 0))
    for n in maxima(level):
        angle = np.array([_zoom(power_at, n)])
        wave = response(positions_m, unit_vectors(angle), frequency_hz)
        if np.abs(waves.conj().T @ wave).max(initial=0) <= PARALLEL * len(positions_m):
            azimuth_rad, waves = np.append(azimuth_rad, angle), np.append(waves, wave, axis=1)
        if len(azimuth_rad) == (TARGETS_PER_CELL if method.name == "capon" else method.sources):
            break
    inverse = np.linalg.pinv(waves)
    power = np.einsum("ta,ab,tb->t", inverse, signals.matrix, inverse.conj(), optimize=True).real
    if len(azimuth_rad) == 1:
        return azimuth_rad, np.ones(1)
    order = np.argsort(-power, kind="stable")
    order = order[power[order] > power.max() * 10 ** (-DEPTH_DB / 10)]
    return azimuth_rad[order], power[order] / (np.trace(signals.matrix).real / len(positions_m)) if len(order) > 1 else np.ones(1)


def maxima(level: Real) -> NDArray[np.intp]:
    """Return the indices of the local maxima of a spectrum (A,), the highest first. An end of the grid can be a maximum."""
    padded = np.concatenate([[-np.inf], level, [-np.inf]])
    at = np.flatnonzero((level > padded[:-2]) & (level >= padded[2:]))
    return at[np.argsort(-level[at], kind="stable")]


def _zoom(power_at: AngleSpectrum, index: int) -> float:
    """Refine the azimuth of a maximum on the grid to 0.002 degrees, because the peaks of MUSIC can be very narrow."""
    low, high = _AZIMUTH_RAD[max(index - 1, 0)], _AZIMUTH_RAD[min(index + 1, len(_AZIMUTH_RAD) - 1)]
    fine = np.linspace(low, high, _ZOOM_POINTS)
    for _ in range(_ZOOMS):
        best = int(np.argmax(power_at(unit_vectors(fine))))
        middle = fine[best]
        fine = np.linspace(fine[max(best - 1, 0)], fine[min(best + 1, _ZOOM_POINTS - 1)], _ZOOM_POINTS)
    return float(middle)


def _ux(uy: Real, uz: Real) -> Real:
    return np.sqrt(np.maximum(1 - uy**2 - uz**2, 0.0))


def _all_uz(signals: Covariance, positions_m: Real, frequency_hz: float, cell: NDArray[np.intp], uy: Real) -> Real:
    """Return the direction cosines u_z (T,) of targets with the given cells (T,) and direction cosines u_y (T,)."""
    matrices = (Covariance(signals.matrix[n], signals.count) for n in cell)
    return np.array([_uz(matrix, positions_m, frequency_hz, u) for matrix, u in zip(matrices, uy, strict=True)], dtype=np.float64)


def _uz(signals: Covariance, positions_m: Real, frequency_hz: float, uy: float) -> float:
    """Return the direction cosine u_z of the strongest Bartlett beam of all antennas among the directions with the given u_y."""
    uz = _UZ * np.sqrt(max(1 - uy**2, 0.0))
    level = spectrum(signals, positions_m, frequency_hz)(np.column_stack([_ux(np.full_like(uz, uy), uz), np.full_like(uz, uy), uz]))
    best = int(np.clip(np.argmax(level), 1, len(uz) - 2))
    shift, _ = parabola([decibels(level[best + step : best + step + 1]) for step in (-1, 0, 1)])
    return float(uz[best] + shift[0] * (uz[1] - uz[0]))
