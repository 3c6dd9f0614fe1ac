"""Compute the errors of a simulation method's samples against reference samples: the error of the signal and that of the range profile.

Symbols: a -> samples of a method, b -> samples of the reference. A range profile is the power over range, computed with a Hann window.
Chirps are added coherently, and channels are averaged in power. Profiles are compared in decibels over the ranges that the study uses
(radartwin/features/profile.py), in the bins where the reference is within DYNAMIC_DB of its strongest bin. Levels more than DYNAMIC_DB
below the strongest bin are raised to this limit, so a method that returns no signal has an error of DYNAMIC_DB at the peak. The signal
error |a - b|/|b| covers all samples, or with a range gate the range spectra inside it. The error of the range profile is given twice:
without a gain, and after the common gain that minimises the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import decibels, range_fft

DYNAMIC_DB = 40.0
GAINS_DB = np.arange(-120.0, 120.5, 0.5)  # search grid of the common gain


@dataclass(frozen=True)
class Errors:
    """Errors of a method's samples over all recordings of a test problem."""

    signal: float  # norm of the difference over norm of the reference, |a - b|/|b|
    profile_db: float  # rms difference of the range profiles
    offset_db: float  # mean level of the profiles relative to the reference
    free_db: float  # rms difference of the profiles after the gain that minimises it
    gain_db: float  # gain in dB that minimises the rms difference of the profiles


Gate = tuple[float, float]  # nearest and farthest range in metres


def spectra(iq: np.ndarray, radar: Radar, gate_m: Gate) -> np.ndarray:
    """Return the complex range spectra (F, tx, rx, bins) inside a range gate, from samples (F, chirps, tx, rx, samples)."""
    spectrum, range_m = range_fft(iq.mean(axis=1), radar)
    return spectrum[..., (range_m >= gate_m[0]) & (range_m <= gate_m[1])]


def profiles(iq: np.ndarray, radar: Radar, gate_m: Gate = (NEAR_M, FAR_M)) -> np.ndarray:
    """Return range profiles (F, bins) in power inside a range gate, from samples (F, chirps, tx, rx, samples)."""
    return (np.abs(spectra(iq, radar, gate_m)) ** 2).mean(axis=(1, 2))


def compare(pairs: Sequence[tuple[np.ndarray, np.ndarray]], radar: Radar, gain_db: float = 0.0, gate_m: Gate | None = None) -> Errors:
    """Return the errors over pairs (samples of the method, samples of the reference). All pairs have equal weight.

    Args:
        gain_db: gain by which the method's samples are multiplied first.
        gate_m: ranges in which the reference is valid. The profiles are compared inside it, and the signal error is that of the complex
            range spectra inside it. None compares the profiles from NEAR_M to FAR_M and the signals over all samples.

    >>> tone = np.exp(2j * np.pi * 20 * np.arange(256) / 256)[None, None, None, None]
    >>> errors = compare([(0.5 * tone, tone)], Radar.iwr1843())
    >>> round(errors.signal, 6), round(errors.profile_db, 2), round(errors.free_db, 2), round(errors.gain_db, 1)
    (0.5, 6.02, 0.0, 6.0)
    """
    gain = 10 ** (gain_db / 20)
    signals = pairs if gate_m is None else [(spectra(a, radar, gate_m), spectra(b, radar, gate_m)) for a, b in pairs]
    signal = np.sqrt(np.mean([np.linalg.norm(gain * a - b) ** 2 / np.linalg.norm(b) ** 2 for a, b in signals]))
    gate_m = gate_m or (NEAR_M, FAR_M)
    both = [(gain**2 * profiles(a, radar, gate_m), profiles(b, radar, gate_m)) for a, b in pairs]
    offset = float(np.mean([decibels(a.sum() / b.sum()) for a, b in both]))
    rough = GAINS_DB[np.argmin([_rms(both, g) for g in GAINS_DB])]
    best = minimize_scalar(lambda g: _rms(both, g), bounds=(rough - 0.5, rough + 0.5), method="bounded")
    free, extra = min((_rms(both, g), g) for g in (float(best.x), 0.0))  # type: ignore[attr-defined]
    return Errors(float(signal), _rms(both, 0.0), offset, free, gain_db + extra)


def _rms(both: Sequence[tuple[np.ndarray, np.ndarray]], gain_db: float) -> float:
    squares = []
    for power, reference in both:
        floor = reference.max(axis=1, keepdims=True) * 10 ** (-DYNAMIC_DB / 10)
        apart = decibels(np.maximum(power * 10 ** (gain_db / 10), floor)) - decibels(np.maximum(reference, floor))
        squares.append(np.mean(apart[reference > floor] ** 2))
    return float(np.sqrt(np.mean(squares)))
