"""Transform IQ samples to range, Doppler and azimuth spectra, with Hann windows, zero padding and axes in SI units.

A path of length L has the phase factor exp(+j 2 pi f L / c). Echoes therefore have positive beat frequencies, receding targets have
positive Doppler frequencies, and the phase is smaller at an antenna nearer to the target. The spectra are divided by the sum of the window.
An echo of amplitude a in the centre of a bin therefore has the value a for every number of samples and every length of the transform.

The phase of a range bin is the phase at the middle frequency of the sampled sweep, so Doppler and azimuth are computed with
Radar.center_frequency_hz. At 77 GHz with 3.44 GHz of bandwidth, the start frequency would give speeds that are 2.2 % too high.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar

Complex = NDArray[np.complexfloating]
Real = NDArray[np.float64]


def decibels(power: ArrayLike) -> Real:
    """Convert power to decibels. A power of zero gives -3077 dB instead of minus infinity.

    >>> decibels([0.01, 10.0]).tolist()
    [-20.0, 10.0]
    """
    return 10 * np.log10(np.maximum(power, np.finfo(np.float64).tiny))


def hann(size: int) -> Real:
    """Return a periodic Hann window of unit sum, shape (size,). A window of one or two samples has equal weights."""
    if size <= 2:
        return np.full(size, 1 / size)  # because the formula gives the first sample a weight of zero
    taps = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / size)
    return taps / taps.sum()


def range_axis(radar: Radar, bins: int) -> Real:
    """Return the centres of the range bins of range_fft in metres, shape (bins,), or (bins // 2,) for real sampling."""
    count = bins // 2 if radar.real_sampling else bins
    fold_m = radar.sample_rate_hz * SPEED_OF_LIGHT / (2 * radar.slope_hz_per_s)
    return fold_m / bins * np.arange(count, dtype=np.float64)


def velocity_axis(radar: Radar, bins: int) -> Real:
    """Return the velocities of the Doppler bins of doppler_fft in m/s, ascending, receding positive, shape (bins,)."""
    return 2 * radar.max_velocity_mps / bins * (np.arange(bins, dtype=np.float64) - bins // 2)


def range_fft(iq: Complex, radar: Radar, *, bins: int | None = None) -> tuple[Complex, Real]:
    """Compute range profiles.

    Args:
        iq: samples (..., sample).
        bins: length of the Fourier transform, at least num_samples; None takes num_samples, without zero padding.
    Returns:
        profiles: range profiles (..., range) in the unit of iq; for real sampling, twice the positive half of the spectrum.
        axis: range axis in metres.

    >>> radar = Radar.iwr1843()
    >>> echo = np.exp(2j * np.pi * 20 * np.arange(256) / 256)
    >>> profile, range_m = range_fft(echo, radar)
    >>> round(float(range_m[np.argmax(np.abs(profile))] / radar.range_resolution_m), 6)
    20.0
    """
    _check(iq, -1, radar.num_samples, "sample")
    bins = _bins(bins, radar.num_samples)
    profile = np.fft.fft(iq * hann(radar.num_samples).astype(np.float32), bins, axis=-1)
    if radar.real_sampling:
        profile = 2 * profile[..., : bins // 2]
    return profile, range_axis(radar, bins)


def doppler_fft(profiles: Complex, radar: Radar, *, bins: int | None = None) -> tuple[Complex, Real]:
    """Compute Doppler spectra and compensate the TDM phase.

    Transmitter t sends its chirp t chirp intervals Tc after the first transmitter. In this time, the phase of a target at Doppler frequency
    f changes by 2 pi f t Tc. The function removes this phase from each Doppler bin, so that the phase differences between the channels
    depend only on the target's angle.

    Args:
        profiles: range profiles (..., chirp, tx, rx, range).
        bins: length of the Fourier transform, at least num_chirps; None takes num_chirps, without zero padding.
    Returns:
        spectra: Doppler spectra (..., Doppler, tx, rx, range).
        axis: velocity axis in m/s.
    """
    _check(profiles, -4, radar.num_chirps, "chirp")
    _check(profiles, -3, radar.num_tx, "tx")
    bins = _bins(bins, radar.num_chirps)
    taps = hann(radar.num_chirps).astype(np.float32)
    spectra = np.fft.fftshift(np.fft.fft(profiles * taps[:, None, None, None], bins, axis=-4), axes=-4)
    velocity_mps = velocity_axis(radar, bins)
    doppler_hz = 2 * velocity_mps * radar.center_frequency_hz / SPEED_OF_LIGHT
    delay_s = radar.chirp_times()[0]
    phasor = np.exp(-2j * np.pi * doppler_hz[:, None] * delay_s).astype(spectra.dtype)
    return spectra * phasor[:, :, None, None], velocity_mps


def azimuth_row(radar: Radar) -> NDArray[np.intp]:
    """Return the channel indices of the azimuth row, which is the largest group of virtual antennas at one height.

    The channels are numbered by transmitter first, then by receiver.
    """
    height = np.round(radar.virtual_positions[:, 2] / (0.01 * radar.wavelength_m))
    values, counts = np.unique(height, return_counts=True)
    return np.flatnonzero(height == values[np.argmax(counts)])


def row_places(radar: Radar) -> NDArray[np.intp]:
    """Return the place of each channel of `azimuth_row`, which is the rank of its antenna in ascending y, counted from 0.

    Antennas that are at most 1 % of a wavelength apart share a place.

    >>> row_places(Radar.iwr1843()).tolist()
    [0, 1, 2, 3, 4, 5, 6, 7]
    """
    positions = radar.virtual_positions[azimuth_row(radar)]
    order = np.lexsort((positions[:, 0], positions[:, 1]))
    apart = np.linalg.norm(np.diff(positions[order], axis=0), axis=1) > 0.01 * radar.wavelength_m
    places = np.empty(len(order), dtype=np.intp)
    places[order] = np.concatenate([[0], np.cumsum(apart)])
    return places


def unit_vectors(azimuth_rad: ArrayLike, elevation_rad: ArrayLike = 0.0) -> Real:
    """Return the unit vectors (..., 3) in the sensor frame of directions with azimuth atan2(y, x) and elevation asin(z) in radians."""
    azimuth, elevation = np.broadcast_arrays(*(np.asarray(angle, dtype=np.float64) for angle in (azimuth_rad, elevation_rad)))
    return np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1)


def response(positions_m: NDArray[np.floating], directions: NDArray[np.floating], frequency_hz: float) -> Complex:
    """Compute the array response: the signals of a plane wave of unit amplitude on each virtual antenna, relative to the origin.

    Args:
        positions_m: positions (M, 3) of the virtual antennas in metres.
        directions: D unit vectors (D, 3) from the radar to the targets, in the sensor frame.
        frequency_hz: frequency that sets the phase, for a range bin Radar.center_frequency_hz.
    Returns:
        Complex signals (M, D) of magnitude 1.
    """
    wavenumber = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    # The path to an antenna displaced towards the target is shorter by the displacement.
    phase: Complex = -1j * wavenumber * positions_m @ directions.T
    return np.exp(phase)


def steering(radar: Radar, azimuth_rad: ArrayLike) -> Complex:
    """Compute beamforming weights over the azimuth row for horizontal directions.

    Args:
        azimuth_rad: A azimuth angles atan2(y, x) in radians, positive to the left, shape (A,).
    Returns:
        Weights (channels of azimuth_row, A), whose magnitudes add up to 1 over the channels. The sum over channels of weight times signal
        is the beam signal.
    """
    row = radar.virtual_positions[azimuth_row(radar)]
    return 1 / len(row) * response(row, unit_vectors(azimuth_rad), radar.center_frequency_hz).conj()


def _bins(bins: int | None, size: int) -> int:
    if bins is None:
        return size
    if bins < size:
        raise InputError(f"a transform of {bins} bins would cut off {size} samples; use {size} or more")
    return int(bins)


def _check(array: Complex, axis: int, size: int, name: str) -> None:
    if array.ndim < -axis or array.shape[axis] != size:
        raise InputError(f"axis {axis} must hold the radar's {size} {name} entries; the shape is {array.shape}")
