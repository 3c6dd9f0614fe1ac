"""Estimate the radial velocity of the echoes in the target gate, and compare it with the rate of change of the tracked range.

Symbols: D(f, u, r) -> doppler, summed over the gate; velocity v(f) = v_max / pi * arg sum_u D(u) exp(j pi v_u / v_max). This is the phase
of the lag-one autocorrelation of the chirps (pulse pair; D. S. Zrnic, Spectral moment estimates from correlated pulse pairs, IEEE Trans.
AES 13(4), 1977). For a single echo the estimate is exact. White noise does not bias the estimate. An echo at rest in the same gate shifts
the estimate towards zero. The velocity of a receding target is positive. Ref: paper, signal fidelity along trajectories (Doppler
consistency: the chirp-to-chirp phase progression at the target bin reproduces the kinematics of the sweep).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.gate import gate_energies
from radartwin.features.processed import Processed
from radartwin.features.profile import GATE_BINS

SMOOTH_FRAMES = 9  # number of frames in the line fit whose slope is the range rate


@dataclass(frozen=True)
class Consistency:
    """Compare velocity with range rate: rms difference in m/s, and Pearson correlation over frames (NaN if either is constant)."""

    rms_mps: float
    correlation: float


def radial_velocity(processed: Processed, target_m: ArrayLike, bins: int = GATE_BINS) -> NDArray[np.float64]:
    """Estimate the radial velocity of each frame in m/s, (F,). Raises InputError if the recording was processed without Doppler."""
    if processed.doppler is None:
        raise InputError("radial velocity: the recording was processed without Doppler; use process(recording, doppler=True)")
    limit = processed.radar.max_velocity_mps
    turn = np.exp(1j * np.pi * processed.velocity_mps / limit)
    target_m = np.broadcast_to(target_m, processed.num_frames)
    spectrum = np.stack(
        [gate_energies(processed.doppler[:, u], processed.range_m, target_m, bins)[0] for u in range(len(processed.velocity_mps))], axis=1
    )
    return limit / np.pi * np.angle(spectrum @ turn)


def range_rate(track_m: NDArray, frame_rate_hz: float, frames: int = SMOOTH_FRAMES) -> NDArray[np.float64]:
    """Estimate the range rate in m/s, (F,): the slope of a line fitted to the `frames` tracked ranges around each frame."""
    from scipy.signal import savgol_filter

    size = min(frames, len(track_m)) - (1 - min(frames, len(track_m)) % 2)
    if size < 3:
        raise InputError(f"a range rate needs at least three frames, not {len(track_m)}")
    return np.asarray(savgol_filter(track_m, size, polyorder=1, deriv=1, delta=1 / frame_rate_hz))


def consistency(velocity_mps: NDArray, rate_mps: NDArray) -> Consistency:
    """Compute rms difference and correlation of the velocity and the range rate (both (F,), m/s)."""
    varies = np.ptp(velocity_mps) > 0 and np.ptp(rate_mps) > 0
    correlation = float(np.corrcoef(velocity_mps, rate_mps)[0, 1]) if varies else float("nan")
    return Consistency(float(np.sqrt(np.mean((velocity_mps - rate_mps) ** 2))), correlation)
