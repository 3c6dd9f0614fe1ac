"""Compute the range-Doppler signature of a target on a turntable: its echo power over range and over frame-to-frame Doppler frequency.

The signature is G(u, r) = |FFT of A(f, r) over the N frames f of a revolution|^2, summed over channels and whole revolutions, where A is
the range profile of a frame. The RadarTwin paper compares the signatures of simulation and measurement by their structural similarity
(SSIM). The FFT needs no window because it covers a whole revolution, and the start angle of the revolution has no effect on the signature.
At 10 frames per second, the Doppler band is +-5 Hz, which corresponds to +-9.5 mm/s. The rim of a turning object is faster, so its Doppler
frequency folds, in simulation as in measurement. Echoes at rest have the Doppler frequency 0 Hz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features.envelope import frames_per_revolution
from radartwin.features.processed import Processed

SPAN_M = 1.0  # width of the range window around the target, in metres
FLOOR_DB = 40.0  # dynamic range of a signature in dB; cells that are more than FLOOR_DB weaker than the strongest cell have the level 0


def signature(processed: Processed, angle_rad: NDArray, target_m: float) -> NDArray[np.float64]:
    """Compute the signature of a turntable recording at ranges within SPAN_M / 2 of the target.

    Args:
        processed: processed turntable recording of F frames.
        angle_rad: (F,) nominal turntable angle of each frame in radians, which must rise in all frames or fall in all frames.
        target_m: range of the target in metres.
    Returns:
        Levels (N, R) at N Doppler frequencies and R ranges, from 0 (FLOOR_DB below the strongest cell) to 1 (strongest cell). The Doppler
        frequency ascends over the N rows, with 0 Hz in row N // 2. Receding echoes have positive Doppler frequencies.
    Raises:
        InputError: the recording is shorter than one revolution, or it has no energy near the target.
    """
    near = np.abs(processed.range_m - target_m) <= SPAN_M / 2
    power = doppler_power(processed, angle_rad, near)
    if not power.max() > 0:
        raise InputError(f"signature: there is no energy within {SPAN_M / 2:g} m of {target_m:g} m; check the target's distance")
    return np.fft.fftshift(levels(power), axes=0)


def revolutions(angle_rad: NDArray) -> list[slice]:
    """Return the frames of each whole revolution in a recording with the turntable angles `angle_rad` (F,).

    All revolutions have the same number of frames.
    """
    period = frames_per_revolution(angle_rad)
    # A revolution need not take a whole number of frames, so each slice starts at the frame nearest to the start of its revolution.
    step = 2 * np.pi / float(np.median(np.abs(np.diff(angle_rad))))
    starts = [round(k * step) for k in range(int(len(angle_rad) / step + 1e-6) or 1)]
    return [slice(start, start + period) for start in starts if start + period <= len(angle_rad)]


def doppler_power(processed: Processed, angle_rad: NDArray, bins: NDArray) -> NDArray[np.float64]:
    """Return the echo power (N, R) at N Doppler frequencies, in the order of the FFT, and at the R range bins that `bins` selects.

    The power is the mean over the channels and the sum over the whole revolutions.
    """
    turns = revolutions(angle_rad)
    power = np.zeros((turns[0].stop - turns[0].start, processed.channels[..., bins].shape[-1]))
    for turn in turns:
        slow = np.fft.fft(processed.channels[turn][..., bins], axis=0) / len(power)
        power += np.mean(np.abs(slow) ** 2, axis=1)
    return power


def levels(power: NDArray) -> NDArray[np.float64]:
    """Return the levels of powers in any shape, from 0 (FLOOR_DB or more below the largest power) to 1 (largest power)."""
    return 1 + 10 * np.log10(np.maximum(power / power.max(), 10 ** (-FLOOR_DB / 10))) / FLOOR_DB
