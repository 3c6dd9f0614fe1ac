"""The target's energy over a motion, and what its modulation tells of the shape.

Symbols: E(f) -> energy, linear target-gate power of frame f less the noise floor; E(theta) -> envelope, its mean over whole revolutions
(N,) or the pass itself (F,); P_m = sum_n E_n exp(-j 2 pi m n / N), m >= 0, the one-sided DFT without doubling.

- harmonics |P_m| / |P_0|, m = 1..6, and the angular harmonic ratio sum_{m=1..6} |P_m|^2 / |P_0|^2 (paper, disentangled fidelity, shape:
  the 1-6 cycles per rotation band normalised by DC; the paper does not say whether amplitudes or powers are summed). A body of revolution
  reads 0, a single glint 6. Scale, start angle and, in the far field, distance drop out.
- the same over a pass-by (paper, motion-specific feature design, lateral): m counts cycles over the slice that the pass shows.
- crest factor max(E) / rms(E), 1 for a flat envelope; entropy -sum p ln p / ln N with p = E / sum E, 1 for a flat one (both of the
  normalised envelope, and both finer with more frames in a revolution: compare equal numbers).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.gate import gate_energies
from radartwin.features.processed import Processed
from radartwin.features.profile import GATE_BINS

HARMONICS = 6  # the paper's band; above lies the ripple of facets
Real = NDArray[np.floating]


def target_energy(processed: Processed, target_m: ArrayLike, bins: int = GATE_BINS) -> Real:
    """E(f): power in the target gate less the noise in it, (F,); noise alone scatters about zero.

    Args:
        target_m: range of the gate's centre, one or (F,).
    """
    target_m = np.asarray(target_m, dtype=np.float64)
    inside, _ = gate_energies(processed.power, processed.range_m, target_m, bins)
    floor = np.broadcast_to(processed.noise_floor, (*target_m.shape, len(processed.range_m)))
    return inside - gate_energies(floor, processed.range_m, target_m, bins)[0]


def frames_per_revolution(angle_rad: Real) -> int:
    """Of a turntable at constant nominal speed. Raises InputError for fewer than three frames, or less than one revolution."""
    step = np.abs(np.diff(angle_rad))
    period = round(2 * np.pi / float(np.median(step))) if len(step) and np.median(step) > 0 else 0
    if not 3 <= period <= len(angle_rad):
        raise InputError(f"{len(angle_rad)} frames over {np.rad2deg(np.sum(step)):.0f} degrees are not a revolution; record at least one")
    return period


def revolution(energy: Real, angle_rad: Real) -> Real:
    """E(theta): mean over whole revolutions at equal steps from the first frame's angle, (N,); between frames it is interpolated."""
    period = frames_per_revolution(angle_rad)
    turned = np.abs(angle_rad - angle_rad[0])
    if (np.diff(turned) <= 0).any():
        raise InputError("the turntable's angle must go one way; give the nominal angle without folding it at 360 degrees")
    # A revolution ends one step before it starts again.
    count = int(np.floor((turned[-1] / (2 * np.pi) * period + 1) / period + 1e-6))
    wanted = 2 * np.pi * np.arange(max(count, 1) * period) / period
    return np.interp(wanted, turned, energy).reshape(-1, period).mean(axis=0)


def harmonics(envelope: Real, count: int = HARMONICS) -> Real:
    """|P_m| / |P_0| for m = 1..count, (count,).

    Raises:
        InputError: an envelope too short for `count` cycles, or without energy above the noise.

    >>> np.round(harmonics(1 + np.cos(2 * np.pi * 3 * np.arange(64) / 64)), 6).tolist()
    [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]
    """
    if len(envelope) <= 2 * count:
        raise InputError(f"{len(envelope)} frames do not show {count} cycles; give more than {2 * count}")
    spectrum = np.fft.rfft(_checked(envelope))
    return np.abs(spectrum[1 : count + 1]) / np.abs(spectrum[0])


def harmonic_ratio(envelope: Real, low: int = 1, high: int = HARMONICS) -> float:
    """Sum over m = low..high of |P_m|^2 / |P_0|^2; another band than 1..6 shows what lies outside it, such as facet ripple."""
    return float(np.sum(harmonics(envelope, high)[low - 1 :] ** 2))


def crest_factor(envelope: Real) -> float:
    """max(E) / rms(E).

    >>> crest_factor(np.ones(10))
    1.0
    """
    envelope = _checked(envelope)
    return float(envelope.max() / np.sqrt(np.mean(envelope**2)))


def entropy(envelope: Real) -> float:
    """-sum p ln p / ln N with p = E / sum E; frames at or below the noise count as zero.

    >>> round(entropy(np.ones(10)), 9), entropy(np.eye(1, 10)[0])
    (1.0, 0.0)
    """
    share = np.maximum(_checked(envelope), 0.0)
    share = share[share > 0] / share.sum()
    return float(abs(np.sum(share * np.log(share))) / np.log(len(envelope)))


def _checked(envelope: Real) -> Real:
    envelope = np.asarray(envelope, dtype=np.float64)
    if envelope.ndim != 1 or len(envelope) < 2 or not np.isfinite(envelope).all() or not envelope.sum() > 0:
        raise InputError("the envelope must be two or more finite energies whose mean is above the noise; is the target in its gate?")
    return envelope / envelope.mean()
