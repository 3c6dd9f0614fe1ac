"""Power over range and time, Doppler or azimuth of a whole recording, averaged over frames in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import azimuth_row, doppler_fft, range_axis, range_fft, steering, velocity_axis, window

Complex = NDArray[np.complexfloating]
Real = NDArray[np.float64]

_BLOCK_BYTES = 128 << 20  # of padded spectra held at once


@dataclass(frozen=True)
class Chain:
    """How samples become spectra.

    Attributes:
        taper: window over samples and over chirps.
        padding: length of both transforms over the number of samples and of chirps.
        static_removed: subtract each channel's mean over all frames and chirps, which leaves what moves.
    """

    taper: str = "hann"
    padding: int = 2
    static_removed: bool = False

    def __post_init__(self) -> None:
        if self.padding < 1:
            raise InputError(f"padding {self.padding} must be at least 1, which is none")


@dataclass(frozen=True)
class Maps:
    """Mean powers over channels and frames, in the square of the samples' unit, with their axes.

    range_time is (time, range), range_doppler (doppler, range), range_azimuth (azimuth, range). Time runs over frames,
    or over the chirps of a single frame. A steady echo of amplitude a at rest reads a^2 in each.
    """

    range_m: Real
    time_s: Real
    velocity_mps: Real
    azimuth_rad: Real
    range_time: Real
    range_doppler: Real
    range_azimuth: Real


def spectra(iq: Complex, radar: Radar, chain: Chain) -> Iterator[tuple[slice, Complex, Complex]]:
    """Per block of frames: which, profiles (frame, chirp, tx, rx, range), spectra (frame, doppler, tx, rx, range)."""
    frame_bytes = 8 * chain.padding**2 * int(np.prod(iq.shape[1:]))
    step = max(1, _BLOCK_BYTES // frame_bytes)
    static = _static(iq) if chain.static_removed else None
    for start in range(0, len(iq), step):
        frames = slice(start, min(start + step, len(iq)))
        block = iq[frames] if static is None else iq[frames] - static
        profiles, _ = range_fft(block, radar, taper=chain.taper, bins=chain.padding * radar.num_samples)
        doppler, _ = doppler_fft(profiles, radar, taper=chain.taper, bins=chain.padding * radar.num_chirps)
        yield frames, profiles, doppler


def survey(iq: Complex, radar: Radar, chain: Chain | None = None, *, azimuth_rad: Real | None = None) -> Maps:
    """The three maps of a recording.

    Args:
        iq: (frame, chirp, tx, rx, sample).
        azimuth_rad: directions, positive to the left; None takes every degree from -90 to 90.
    """
    chain = chain or Chain()
    azimuth_rad = np.radians(np.arange(-90.0, 91.0)) if azimuth_rad is None else azimuth_rad
    range_m = range_axis(radar, chain.padding * radar.num_samples)
    velocity_mps = velocity_axis(radar, chain.padding * radar.num_chirps)
    row = azimuth_row(radar)
    single = len(iq) == 1
    range_time = np.zeros((radar.num_chirps if single else len(iq), len(range_m)))
    range_doppler = np.zeros((len(velocity_mps), len(range_m)))
    covariance = np.zeros((len(range_m), len(row), len(row)), dtype=np.complex128)
    for frames, profiles, block in spectra(iq, radar, chain):
        power = _power(profiles).mean(axis=(2, 3))
        if single:
            range_time[:] = power[0]
        else:
            range_time[frames] = power.mean(axis=1)
        range_doppler += _power(block).mean(axis=(2, 3)).sum(axis=0)
        # Bartlett power is a quadratic form, so the channels' covariance carries every direction.
        channels = block.reshape(-1, radar.num_tx * radar.num_rx, len(range_m))[:, row].transpose(2, 1, 0)
        covariance += channels @ channels.conj().transpose(0, 2, 1)
    weights = steering(radar, azimuth_rad)
    range_azimuth = np.einsum("ca,rcd,da->ar", weights, covariance, weights.conj(), optimize=True).real
    # Parseval over the Doppler bins, so that a steady echo reads its power here too.
    bins_of_energy = len(iq) * len(velocity_mps) * float((window(chain.taper, radar.num_chirps) ** 2).sum())
    return Maps(
        range_m=range_m,
        time_s=np.arange(len(range_time), dtype=np.float64) * (radar.loop_interval_s if single else 1 / radar.frame_rate_hz),
        velocity_mps=velocity_mps,
        azimuth_rad=azimuth_rad,
        range_time=range_time,
        range_doppler=range_doppler / len(iq),
        range_azimuth=range_azimuth / bins_of_energy,
    )


def _power(values: Complex) -> Real:
    return values.real.astype(np.float64) ** 2 + values.imag.astype(np.float64) ** 2


def _static(iq: Complex) -> Complex:
    """Each channel's and sample's mean over frames and chirps, (tx, rx, sample)."""
    # Frame by frame, since a float64 copy of a long recording would not fit.
    total = np.zeros(iq.shape[2:], dtype=np.complex128)
    for frame in iq:
        total += frame.mean(axis=0, dtype=np.complex128)
    return (total / len(iq)).astype(iq.dtype)
