"""Estimate the radial velocity of the echoes in the target gate (the range bins around the target), and the rate of change of a range.

The velocity in frame f is v(f) = v_max / pi * arg sum_u D(u) exp(j pi v_u / v_max). Here D(u) is the power in Doppler bin u, summed over
the target gate, v_u is the velocity of the bin, and v_max is the radar's maximum unambiguous velocity. This estimate is the phase of the
autocorrelation between successive chirps (pulse pair; D. S. Zrnic, Spectral moment estimates from correlated pulse pairs, IEEE Trans. AES
13(4), 1977). For a single echo, the estimate is exact. White noise does not bias the estimate. An echo at rest in the same target gate
shifts the estimate towards zero. The velocity of a receding target is positive. The RadarTwin paper uses this velocity as a check of
Doppler consistency: the phase progression from chirp to chirp at the target bin must agree with the motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.features.profile import gate_energies

SMOOTH_FRAMES = 9  # number of successive frames through whose ranges `range_rate` fits a line
# Change of the rate between two successive frames that counts as a turn: half of the change at the turn of a drive at 0.2 m/s. In a drive
# past the target at 0.24 m/s, at a distance of 0.5 m and with three frames per second, the rate changes by less than 0.04 m/s from frame to
# frame.
TURN_MPS = 0.2


def radial_velocity(processed: Processed, target_m: ArrayLike) -> NDArray[np.float64]:
    """Estimate the target's radial velocity in each frame in m/s, (F,).

    Raises:
        InputError: the recording was processed without Doppler spectra.
    """
    if processed.doppler is None:
        raise InputError("radial velocity: the recording was processed without Doppler; use process(recording, doppler=True)")
    limit = processed.radar.max_velocity_mps
    phasor = np.exp(1j * np.pi * processed.velocity_mps / limit)
    target_m = np.broadcast_to(target_m, processed.num_frames)
    bins = range(len(processed.velocity_mps))
    spectrum = np.stack([gate_energies(processed.doppler[:, u], processed.range_m, target_m)[0] for u in bins], axis=1)
    return limit / np.pi * np.angle(spectrum @ phasor)


def range_rate(track_m: NDArray, frame_rate_hz: float) -> NDArray[np.float64]:
    """Estimate the rate of change of the range in m/s, (F,), as the slope of a line fitted to SMOOTH_FRAMES ranges around each frame.

    No line uses frames on both sides of a turn. A turn is a change of the rate by more than TURN_MPS from one frame to the next. The rate
    in the frame of the turn is the rate after the turn. A turn is ignored if it is one frame away from another turn, from the first frame
    or from the last frame.

    >>> range_rate(np.abs(np.arange(-8, 9)) * 0.06, 10 / 3).round(9).tolist()[6:10]
    [-0.2, -0.2, 0.2, 0.2]
    """
    from scipy.signal import savgol_filter

    last = len(track_m) - 1
    if last < 2:
        raise InputError(f"a range rate needs at least three frames, not {len(track_m)}")
    ends = [0]
    for turn in 1 + np.flatnonzero(np.abs(np.diff(track_m, n=2)) * frame_rate_hz > TURN_MPS):
        if min(turn - ends[-1], last - turn) >= 2:  # a line needs three frames
            ends.append(int(turn))
    rate = np.empty(len(track_m))
    for low, high in zip(ends, [*ends[1:], last], strict=True):
        size = min(SMOOTH_FRAMES, high - low + 1)
        size -= 1 - size % 2
        rate[low : high + 1] = savgol_filter(track_m[low : high + 1], size, polyorder=1, deriv=1, delta=1 / frame_rate_hz)
    return rate
