"""Start offsets: how many frames later the same motion happens in another recording.

A turntable starts at an unknown angle and a rover is set off by hand, so before two recordings are compared frame by frame their
target-gate energies E(f) are cross-correlated (paper, signal fidelity along trajectories). The correlation is Pearson's over the frames
that overlap, on amplitudes: the root of E weighs noise alike at every level, and on passes and approaches in noise it was off less than E
itself or its logarithm (0.2, 0.3 and 1.0 frames for a pass at 20 dB). A turntable is periodic, and there the correlation is circular.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radartwin.errors import InputError

LEAST_OVERLAP = 0.5  # of the shorter recording
_TIE = 1e-9  # in correlation


@dataclass(frozen=True)
class Offset:
    """`frames` is the whole number of frames by which the other recording is late (negative: early), `exact` a parabola's estimate of it
    between frames, and `correlation` what it gives, -1 to 1.
    """

    frames: int
    exact: float
    correlation: float


def start_offset(reference: np.ndarray, other: np.ndarray, max_frames: int | None = None, period: int | None = None) -> Offset:
    """By how much `other` is late, from target-gate energies per frame.

    Args:
        reference, other: (F,) and (G,), linear energies above or at zero.
        max_frames: the largest offset looked for, either way; None takes all that leave LEAST_OVERLAP of the shorter one.
        period: frames of one revolution; the offset is then circular, within half a revolution either way, and whole revolutions
            are averaged.
    Raises:
        InputError: energies that are negative, not finite, too few, or constant, so that nothing can be aligned.

    >>> pulse = np.exp(-((np.arange(50) - 20.0) ** 2) / 30)
    >>> start_offset(pulse, np.roll(pulse, 4)).frames
    4
    """
    first, second = (_amplitude(energy) for energy in (reference, other))
    if period is not None:
        first, second = _revolution(first, period), _revolution(second, period)
        reach = period // 2
        lags = np.arange(-reach, -reach + period)
        scores = np.array([_pearson(first, np.roll(second, -lag)) for lag in lags])
    else:
        shorter = min(len(first), len(second))
        need = max(3, int(np.ceil(LEAST_OVERLAP * shorter)))
        lags = np.arange(need - len(first), len(second) - need + 1)
        if max_frames is not None:
            lags = lags[np.abs(lags) <= max_frames]
        scores = np.array([_pearson(*overlap(first, second, int(lag))) for lag in lags])
    if not np.isfinite(scores).any():
        raise InputError("start offset: the target's energy does not vary, so there is nothing to align")
    best = int(min(np.flatnonzero(scores >= np.nanmax(scores) - _TIE), key=lambda i: abs(int(lags[i]))))  # of equals the smallest
    return Offset(int(lags[best]), float(lags[best] + _vertex(scores, best, circular=period is not None)), float(scores[best]))


def overlap(reference: np.ndarray, other: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """The frames of both in which the same happens, when `other` is late by `frames`; along the first axis.

    >>> overlap(np.arange(5), np.arange(5), 2)
    (array([0, 1, 2]), array([2, 3, 4]))
    """
    first, second = reference[max(0, -frames) :], other[max(0, frames) :]
    count = min(len(first), len(second))
    return first[:count], second[:count]


def _amplitude(energy: np.ndarray) -> np.ndarray:
    """Root of the energy; scale does not matter for a correlation."""
    energy = np.asarray(energy, dtype=np.float64)
    if energy.ndim != 1 or len(energy) < 3 or not (np.isfinite(energy).all() and (energy >= 0).all()):
        raise InputError("start offset: give the energy of three frames or more, finite and not negative")
    if not energy.max() > 0:
        raise InputError("start offset: the target has no energy in any frame")
    return np.sqrt(energy / energy.max())


def _revolution(amplitude: np.ndarray, period: int) -> np.ndarray:
    """(period,): the mean over whole revolutions."""
    if not 3 <= period <= len(amplitude):
        raise InputError(f"start offset: a revolution of {period} frames does not fit a recording of {len(amplitude)}")
    return amplitude[: len(amplitude) // period * period].reshape(-1, period).mean(axis=0)


def _pearson(first: np.ndarray, second: np.ndarray) -> float:
    first, second = first - first.mean(), second - second.mean()
    norm = float(np.sqrt(np.sum(first**2) * np.sum(second**2)))
    return float(np.sum(first * second)) / norm if norm > 1e-12 * len(first) else np.nan


def _vertex(scores: np.ndarray, best: int, circular: bool) -> float:
    """Where a parabola through the best score and its neighbours has its top, in frames from the best, -0.5 to 0.5."""
    if not circular and not 0 < best < len(scores) - 1:
        return 0.0
    left, middle, right = scores[best - 1], scores[best], scores[(best + 1) % len(scores)]
    bend = left - 2 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0 else 0.0
