"""Compute the echo power of a recording over range and time, over range and Doppler, and over range and azimuth.

The module processes blocks of frames one after another to limit its memory.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.io import scratch
from radartwin.radar.angles import spectrum
from radartwin.radar.chirp import Radar
from radartwin.radar.covariance import Covariance
from radartwin.radar.processing import azimuth_row, doppler_fft, hann, range_axis, range_fft, unit_vectors, velocity_axis

Complex = NDArray[np.complexfloating]
Real = NDArray[np.float64]

PADDING = 2  # zero-padding factor: length of a Fourier transform divided by the number of samples or chirps
_BLOCK_BYTES = 128 << 20  # size of the zero-padded spectra of one block of frames in memory, in bytes


def range_bins(radar: Radar) -> int:
    return PADDING * radar.num_samples


def doppler_bins(radar: Radar) -> int:
    """Return the number of Doppler bins of a frame. A frame with a single chirp has one Doppler bin, at zero velocity."""
    return PADDING * radar.num_chirps if radar.num_chirps > 1 else 1


@dataclass(frozen=True)
class PowerMaps:
    """Hold three power maps of a recording with their axes. The unit of the power is the squared unit of the samples.

    The map range_time (time, range) is averaged over channels. The map range_doppler (Doppler, range) is averaged over channels and frames,
    and the map range_azimuth (azimuth, range) over frames. The time axis has one entry per frame, or one entry per chirp if the recording
    has a single frame. A constant echo of amplitude a at rest has the power a^2 in each map.
    """

    range_m: Real
    time_s: Real
    velocity_mps: Real
    azimuth_rad: Real
    range_time: Real
    range_doppler: Real
    range_azimuth: Real


def spectra(iq: Complex, radar: Radar, static_removed: bool) -> Iterator[tuple[slice, Complex, Complex]]:
    """Compute range profiles and Doppler spectra of a recording in blocks of frames.

    For each block, the function yields the slice of its frames, the range profiles (frame, chirp, tx, rx, range) and the Doppler spectra
    (frame, Doppler, tx, rx, range).
    """
    frame_bytes = 8 * PADDING**2 * int(np.prod(iq.shape[1:]))
    step = max(1, _BLOCK_BYTES // frame_bytes)
    static = _static(iq) if static_removed else None
    for start in range(0, len(iq), step):
        frames = slice(start, min(start + step, len(iq)))
        block = iq[frames] if static is None else iq[frames] - static
        profiles, _ = range_fft(block, radar, bins=range_bins(radar))
        doppler, _ = doppler_fft(profiles, radar, bins=doppler_bins(radar))
        yield frames, profiles, doppler
        scratch.release(iq)


def power_maps(iq: Complex, radar: Radar, static_removed: bool = False) -> PowerMaps:
    """Compute the three power maps of a recording, with azimuth in steps of one degree.

    Args:
        iq: samples (frame, chirp, tx, rx, sample).
        static_removed: whether to subtract the mean of each channel over all frames and chirps, so that only moving echoes remain.
    """
    azimuth_rad = np.radians(np.arange(-90.0, 91.0))
    range_m = range_axis(radar, range_bins(radar))
    velocity_mps = velocity_axis(radar, doppler_bins(radar))
    row = azimuth_row(radar)
    single = len(iq) == 1
    range_time = np.zeros((radar.num_chirps if single else len(iq), len(range_m)))
    range_doppler = np.zeros((len(velocity_mps), len(range_m)))
    covariance = np.zeros((len(range_m), len(row), len(row)), dtype=np.complex128)
    for frames, profiles, block in spectra(iq, radar, static_removed):
        power = channel_power(profiles).mean(axis=(2, 3))
        if single:
            range_time[:] = power[0]
        else:
            range_time[frames] = power.mean(axis=1)
        range_doppler += channel_power(block).mean(axis=(2, 3)).sum(axis=0)
        # The Bartlett power in any direction is a quadratic form of the covariance matrix of the channels, so only this matrix is summed.
        channels = block.reshape(-1, radar.num_tx * radar.num_rx, len(range_m))[:, row].transpose(2, 1, 0)
        covariance += channels @ channels.conj().transpose(0, 2, 1)
    beams = spectrum(Covariance(covariance, len(iq)), radar.virtual_positions[row], radar.center_frequency_hz)
    range_azimuth = beams(unit_vectors(azimuth_rad)).T
    # The energy is summed over the Doppler bins. By Parseval's theorem, after division by this number, a constant echo of amplitude a has
    # the power a^2 in the range-azimuth map.
    bins_of_energy = len(iq) * len(velocity_mps) * float((hann(radar.num_chirps) ** 2).sum())
    return PowerMaps(
        range_m=range_m,
        time_s=np.arange(len(range_time), dtype=np.float64) * (radar.loop_interval_s if single else 1 / radar.frame_rate_hz),
        velocity_mps=velocity_mps,
        azimuth_rad=azimuth_rad,
        range_time=range_time,
        range_doppler=range_doppler / len(iq),
        range_azimuth=range_azimuth / bins_of_energy,
    )


def channel_power(values: Complex) -> Real:
    """Return the squared magnitude of complex values of any shape in double precision."""
    return values.real.astype(np.float64) ** 2 + values.imag.astype(np.float64) ** 2


def _static(iq: Complex) -> Complex:
    """Return the mean (tx, rx, sample) of each channel and sample over all frames and chirps."""
    # The sum runs frame by frame, because a float64 copy of a long recording does not fit into memory.
    total = np.zeros(iq.shape[2:], dtype=np.complex128)
    for frame in iq:
        total += frame.mean(axis=0, dtype=np.complex128)
        scratch.release(iq)
    return (total / len(iq)).astype(iq.dtype)
