"""Range-Doppler signature of a revolution: how fast what turns, at which range.

G(u, r) = mean over channels and whole revolutions of |FFT over the N frames of a revolution of A(f, r)|^2 (paper, turntable fidelity:
range-Doppler signatures of simulation and measurement are compared by SSIM). Frames of one whole revolution need no window, and the start
angle drops out. At 10 frames per second Doppler reaches +-5 Hz, 9.5 mm/s: the rim of a turning object folds, and identically so in both
domains. What stands still lies at 0 Hz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features.envelope import frames_per_revolution
from radartwin.features.processed import Processed

SPAN_M = 1.0  # of range, about the target
FLOOR_DB = 40.0  # below the strongest cell; what is darker reads 0


@dataclass(frozen=True, eq=False)
class Signature:
    """level (N, R) from 0 (FLOOR_DB below the strongest cell) to 1, over doppler_hz (N,), ascending and receding positive, and range_m."""

    level: NDArray[np.float64]
    doppler_hz: NDArray[np.float64]
    range_m: NDArray[np.float64]


def signature(processed: Processed, angle_rad: NDArray, frame_rate_hz: float, target_m: float, span_m: float = SPAN_M) -> Signature:
    """The signature of a turntable recording within span_m / 2 of the target.

    Args:
        angle_rad: (F,) nominal angle, going one way.
    Raises:
        InputError: less than one revolution, or a recording without energy there.
    """
    period = frames_per_revolution(angle_rad)
    near = np.abs(processed.range_m - target_m) <= span_m / 2
    # Revolutions that are no whole number of frames long start at the nearest one.
    step = 2 * np.pi / float(np.median(np.abs(np.diff(angle_rad))))
    starts = [round(k * step) for k in range(int(len(angle_rad) / step + 1e-6) or 1)]
    power = np.zeros((period, int(near.sum())))
    turns = [start for start in starts if start + period <= processed.num_frames]
    for start in turns:
        slow = np.fft.fft(processed.channels[start : start + period][..., near], axis=0) / period
        power += np.mean(np.abs(slow) ** 2, axis=1)
    if not power.max() > 0:
        raise InputError(f"signature: there is no energy within {span_m / 2:g} m of {target_m:g} m")
    decibels = 10 * np.log10(np.maximum(power / power.max(), 10 ** (-FLOOR_DB / 10)))
    level = np.fft.fftshift(1 + decibels / FLOOR_DB, axes=0)
    doppler_hz = (np.arange(period, dtype=np.float64) - period // 2) * frame_rate_hz / period
    return Signature(level, doppler_hz, processed.range_m[near])
