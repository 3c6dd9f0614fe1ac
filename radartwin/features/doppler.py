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


def radial_velocity(processed: Processed, target_m: ArrayLike) -> NDArray[np.float64]:
    """Estimate the target's radial velocity in each frame in m/s, (F,).

    Raises:
        InputError: the recording was processed without Doppler spectra.
    """
    if processed.doppler is None:
        raise InputError("radial velocity: the recording was processed without Doppler; use process(recording, doppler=True)")
    limit = processed.radar.max_velocity_mps
    turn = np.exp(1j * np.pi * processed.velocity_mps / limit)
    target_m = np.broadcast_to(target_m, processed.num_frames)
    bins = range(len(processed.velocity_mps))
    spectrum = np.stack([gate_energies(processed.doppler[:, u], processed.range_m, target_m)[0] for u in bins], axis=1)
    return limit / np.pi * np.angle(spectrum @ turn)


def range_rate(track_m: NDArray, frame_rate_hz: float) -> NDArray[np.float64]:
    """Estimate the rate of change of the range in m/s, (F,), as the slope of a line fitted to SMOOTH_FRAMES ranges around each frame."""
    from scipy.signal import savgol_filter

    size = min(SMOOTH_FRAMES, len(track_m))
    size -= 1 - size % 2
    if size < 3:
        raise InputError(f"a range rate needs at least three frames, not {len(track_m)}")
    return np.asarray(savgol_filter(track_m, size, polyorder=1, deriv=1, delta=1 / frame_rate_hz))
