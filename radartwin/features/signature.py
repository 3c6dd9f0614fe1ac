"""Range-Doppler signature of a revolution: power over range and slow-time Doppler frequency.

G(u, r) = mean over channels and whole revolutions of |FFT over the N frames of a revolution of A(f, r)|^2 (paper, turntable fidelity:
range-Doppler signatures of simulation and measurement are compared by SSIM). The frames of a whole revolution need no window, and the
start angle has no effect. At 10 frames per second the Doppler band is +-5 Hz or 9.5 mm/s, so the rim of a turning object folds, in the same
way in both domains. Echoes at rest are at 0 Hz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features.envelope import frames_per_revolution
from radartwin.features.processed import Processed

SPAN_M = 1.0  # width of the range window around the target
FLOOR_DB = 40.0  # dynamic range below the strongest cell; weaker cells have the level 0


@dataclass(frozen=True, eq=False)
class Signature:
    """Level (N, R) from 0 (FLOOR_DB below the strongest cell) to 1, over doppler_hz (N,), ascending and receding positive, and range_m."""

    level: NDArray[np.float64]
    doppler_hz: NDArray[np.float64]
    range_m: NDArray[np.float64]


def signature(processed: Processed, angle_rad: NDArray, frame_rate_hz: float, target_m: float, span_m: float = SPAN_M) -> Signature:
    """The signature of a turntable recording within span_m / 2 of the target.

    Args:
        angle_rad: (F,) nominal angle in one direction.
    Raises:
        InputError: the recording is shorter than a revolution, or has no energy near the target.
    """
    period = frames_per_revolution(angle_rad)
    near = np.abs(processed.range_m - target_m) <= span_m / 2
    # A revolution may be a fraction of a frame longer; each starts at the nearest frame.
    step = 2 * np.pi / float(np.median(np.abs(np.diff(angle_rad))))
    starts = [round(k * step) for k in range(int(len(angle_rad) / step + 1e-6) or 1)]
    power = np.zeros((period, int(near.sum())))
    turns = [start for start in starts if start + period <= processed.num_frames]
    for start in turns:
        slow = np.fft.fft(processed.channels[start : start + period][..., near], axis=0) / period
        power += np.mean(np.abs(slow) ** 2, axis=1)
    if not power.max() > 0:
        raise InputError(f"signature: there is no energy within {span_m / 2:g} m of {target_m:g} m; check the target's distance")
    decibels = 10 * np.log10(np.maximum(power / power.max(), 10 ** (-FLOOR_DB / 10)))
    level = np.fft.fftshift(1 + decibels / FLOOR_DB, axes=0)
    doppler_hz = (np.arange(period, dtype=np.float64) - period // 2) * frame_rate_hz / period
    return Signature(level, doppler_hz, processed.range_m[near])
