"""Compute the energy in the target gate and the energy shares outside of it, and compare range profiles.

The power P(f, r) of frame f and range bin r is `Processed.power`, (F, bins). The target gate consists of the range bin of the target and
GATE_BINS range bins (0.13 m) on either side. All sums are over ranges from NEAR_M to FAR_M. The multipath share is the energy outside the
target gate divided by all energy: sum_{r outside gate} P / sum P. The RadarTwin paper compares range profiles of a simulation in free space
and of a simulation in the scanned room.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from radartwin.errors import InputError

# Limits in metres of all sums over range. The lower limit excludes the leakage between the antennas. The upper limit excludes distant
# walls.
NEAR_M, FAR_M = 0.3, 5.5
GATE_BINS = 3  # number of range bins in the target gate on either side of the target's range bin


def gate(range_m: np.ndarray, target_m: ArrayLike) -> np.ndarray:
    """Return the mask of the target gate: the bin nearest to the target and GATE_BINS bins on either side.

    Args:
        range_m: (bins,) in metres.
        target_m: range of the target in metres, one value or one per frame (F,).
    Returns:
        (bins,) for one target range, or (F, bins).

    >>> np.flatnonzero(gate(np.arange(20.0), 9.2)).tolist()
    [6, 7, 8, 9, 10, 11, 12]
    """
    centre = np.abs(range_m - np.asarray(target_m)[..., None]).argmin(axis=-1)
    return np.abs(np.arange(len(range_m)) - centre[..., None]) <= GATE_BINS


def gate_energies(power: np.ndarray, range_m: np.ndarray, target_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Compute the energy inside the target gate and the energy at all ranges from NEAR_M to FAR_M, for each frame.

    Args:
        power: (F, bins) power of F range profiles, or (bins,) power of a single range profile.
        range_m: (bins,) centres of the range bins in metres.
        target_m: range of the target in metres, one value or one per frame (F,).
    Returns:
        inside: energy inside the target gate, (F,), or a scalar for a single range profile.
        all: energy at all ranges from NEAR_M to FAR_M, (F,), or a scalar for a single range profile.
    Raises:
        InputError: the shapes of the arguments do not fit together, or the target is not between NEAR_M and FAR_M.
    """
    power, target = np.asarray(power, dtype=np.float64), np.asarray(target_m, dtype=np.float64)
    if power.shape[-1:] != range_m.shape or target.shape not in ((), power.shape[:-1]):
        raise InputError(
            f"power {power.shape}, range {range_m.shape} and target {target.shape} do not fit; give (F, bins), (bins,) and (F,)"
        )
    if not np.all((target >= NEAR_M) & (target <= FAR_M)):
        raise InputError(
            f"a target at {float(target.min()):g} to {float(target.max()):g} m is not between {NEAR_M} and {FAR_M} m; correct it"
        )
    window = (range_m >= NEAR_M) & (range_m <= FAR_M)
    return np.sum(power * (window & gate(range_m, target)), axis=-1), np.sum(power * window, axis=-1)


def multipath_share(power: np.ndarray, range_m: np.ndarray, target_m: ArrayLike) -> float:
    """Compute the multipath share of a recording, 0 to 1. The arguments are those of `gate_energies`.

    Raises:
        InputError: as `gate_energies`, or the recording has no energy.

    >>> echoes = np.where(np.isin(np.arange(100), (20, 60)), 1.0, 0.0)
    >>> multipath_share(echoes, np.arange(100) * 0.05, 1.0)
    0.5
    """
    inside, total = gate_energies(power, range_m, target_m)
    if not np.sum(total) > 0:
        raise InputError(f"multipath share: there is no energy between {NEAR_M} and {FAR_M} m; check the recording")
    return float(1 - np.sum(inside) / np.sum(total))


def beyond_target_share(profile: np.ndarray, range_m: np.ndarray, target_m: float) -> float:
    """Compute the fraction of the energy from NEAR_M to FAR_M that lies behind the target gate: sum_{r > gate} P / sum P."""
    inside = (range_m >= NEAR_M) & (range_m <= FAR_M)
    beyond = inside & (range_m > target_m) & ~gate(range_m, target_m)
    return float(profile[beyond].sum() / profile[inside].sum())


def profile_correlation(first: np.ndarray, second: np.ndarray, range_m: np.ndarray, scale: str = "amplitude") -> float:
    """Compute the Pearson correlation of two mean range profiles between NEAR_M and FAR_M.

    Args:
        first, second: (bins,) power of the two mean range profiles.
        range_m: (bins,) centres of the range bins in metres.
        scale: "amplitude" correlates the square roots of the powers, so that the strongest peak dominates the correlation. "db" correlates
            the powers in decibels, so that all range bins above the noise have similar weight.
    """
    inside = (range_m >= NEAR_M) & (range_m <= FAR_M)
    if scale not in ("amplitude", "db"):
        raise InputError(f"profile correlation: scale {scale!r} is unknown; choose amplitude or db")
    transform = np.sqrt if scale == "amplitude" else lambda power: 10 * np.log10(power)
    return float(np.corrcoef(transform(first[inside]), transform(second[inside]))[0, 1])
