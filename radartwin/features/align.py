"""Estimate the start offset between two recordings of the same motion: the number of frames by which the second recording is late.

A turntable starts at an unknown angle and a rover is started by hand. Two recordings must therefore be aligned before a comparison frame by
frame. The offset maximises the Pearson correlation of sqrt(E(f)) over the overlapping frames, where E(f) is the energy in the target gate
(paper, signal fidelity along trajectories). The square root has equal noise at every signal level. For a pass at 20 dB
signal-to-noise ratio, the offset error was 0.2 frames with sqrt(E), 0.3 frames with E and 1.0 frame with log(E). A turntable is periodic,
so its correlation is circular.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radartwin.errors import InputError

MIN_OVERLAP = 0.5  # smallest overlap, as a fraction of the frames of the shorter recording
_TIE = 1e-9  # correlations that differ by less count as equal


@dataclass(frozen=True)
class Offset:
    """Start offset of a recording.

    Attributes:
        frames: whole number of frames by which the other recording is late; negative if it is early.
        exact: offset in fractions of a frame, from a parabola through the correlation peak.
        correlation: Pearson correlation at the offset `frames`, -1 to 1.
    """

    frames: int
    exact: float
    correlation: float


def start_offset(reference: np.ndarray, other: np.ndarray, max_frames: int | None = None, period: int | None = None) -> Offset:
    """Estimate the delay of the recording `other` against `reference` from their target-gate energies per frame.

    Args:
        reference, other: (F,) and (G,), linear energies, at least zero.
        max_frames: largest offset in either direction; None tries all offsets with an overlap of at least MIN_OVERLAP.
        period: frames per revolution, for a turntable. The function then averages whole revolutions, and the offset is circular: at most
            half a revolution in either direction.
    Raises:
        InputError: energies are negative, not finite, too few, or constant.

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
        need = max(3, int(np.ceil(MIN_OVERLAP * shorter)))
        lags = np.arange(need - len(first), len(second) - need + 1)
        if max_frames is not None:
            lags = lags[np.abs(lags) <= max_frames]
        scores = np.array([_pearson(*overlap(first, second, int(lag))) for lag in lags])
    if not np.isfinite(scores).any():
        raise InputError("start offset: the energy of the target is constant; give recordings of a motion that changes it")
    best = int(min(np.flatnonzero(scores >= np.nanmax(scores) - _TIE), key=lambda i: abs(int(lags[i]))))  # the smallest of equal offsets
    return Offset(int(lags[best]), float(lags[best] + _vertex(scores, best, circular=period is not None)), float(scores[best]))


def overlap(reference: np.ndarray, other: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the overlapping frames (first axis) of both recordings, if `other` is late by `frames` frames.

    >>> overlap(np.arange(5), np.arange(5), 2)
    (array([0, 1, 2]), array([2, 3, 4]))
    """
    first, second = reference[max(0, -frames) :], other[max(0, frames) :]
    count = min(len(first), len(second))
    return first[:count], second[:count]


def _amplitude(energy: np.ndarray) -> np.ndarray:
    """Return the square root of the energy, scaled; the scale has no effect on a correlation."""
    energy = np.asarray(energy, dtype=np.float64)
    if energy.ndim != 1 or len(energy) < 3 or not (np.isfinite(energy).all() and (energy >= 0).all()):
        raise InputError("start offset: give the energies of three frames or more, finite and not negative")
    if not energy.max() > 0:
        raise InputError("start offset: the target has no energy in any frame; check that it is in its gate")
    return np.sqrt(energy / energy.max())


def _revolution(amplitude: np.ndarray, period: int) -> np.ndarray:
    """Average the amplitude over whole revolutions, (period,)."""
    if not 3 <= period <= len(amplitude):
        raise InputError(f"start offset: a revolution of {period} frames does not fit a recording of {len(amplitude)} frames")
    return amplitude[: len(amplitude) // period * period].reshape(-1, period).mean(axis=0)


def _pearson(first: np.ndarray, second: np.ndarray) -> float:
    first, second = first - first.mean(), second - second.mean()
    norm = float(np.sqrt(np.sum(first**2) * np.sum(second**2)))
    return float(np.sum(first * second)) / norm if norm > 1e-12 * len(first) else np.nan


def _vertex(scores: np.ndarray, best: int, circular: bool) -> float:
    """Return the position of the parabola's maximum through the largest correlation and its two neighbours.

    The position is in frames from the largest correlation, -0.5 to 0.5.
    """
    if not circular and not 0 < best < len(scores) - 1:
        return 0.0
    left, middle, right = scores[best - 1], scores[best], scores[(best + 1) % len(scores)]
    bend = left - 2 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0 else 0.0
