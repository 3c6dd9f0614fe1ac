"""Energy in and around the target gate.

Symbols: P(f, r) -> power, (F, bins), from `profile.range_time`. The gate is GATE_BINS range bins to either side of the target. All
energies are between NEAR_M and FAR_M. Multipath share (paper, motion-specific features): energy outside the target gate over all energy,
sum_{r outside gate} P / sum P, in 0.3 to 5.5 m, gate +-3 bins (0.13 m).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from radartwin.errors import InputError
from radartwin.features.profile import FAR_M, GATE_BINS, NEAR_M


def gate_energies(power: np.ndarray, range_m: np.ndarray, target_m: ArrayLike, bins: int = GATE_BINS) -> tuple[np.ndarray, np.ndarray]:
    """Energy in the target gate, and all energy, per frame.

    Args:
        power: (F, bins), or (bins,) for one profile.
        range_m: (bins,) in metres.
        target_m: range of the target, one value or one per frame (F,).
    Returns:
        (inside, all), each (F,), or two scalars for one profile.
    Raises:
        InputError: shapes do not fit, or the target is outside NEAR_M to FAR_M.
    """
    power, target = np.asarray(power, dtype=np.float64), np.asarray(target_m, dtype=np.float64)
    if power.shape[-1:] != range_m.shape or target.shape not in ((), power.shape[:-1]):
        raise InputError(
            f"power {power.shape}, range {range_m.shape} and target {target.shape} do not fit; give (F, bins), (bins,) and (F,)"
        )
    if not np.all((target >= NEAR_M) & (target <= FAR_M)):
        raise InputError(f"a target at {float(target.min()):g} to {float(target.max()):g} m is not between {NEAR_M} and {FAR_M} m")
    window = (range_m >= NEAR_M) & (range_m <= FAR_M)
    centre = np.abs(range_m - target[..., None]).argmin(axis=-1)
    gate = window & (np.abs(np.arange(len(range_m)) - centre[..., None]) <= bins)
    return np.sum(power * gate, axis=-1), np.sum(power * window, axis=-1)


def multipath_share(power: np.ndarray, range_m: np.ndarray, target_m: ArrayLike, bins: int = GATE_BINS) -> float:
    """Energy outside the target gate over all energy of a recording, 0 to 1; arguments as `gate_energies`.

    Raises:
        InputError: as `gate_energies`, or the recording has no energy.

    >>> axis = np.arange(100) * 0.05
    >>> echoes = np.where(np.isin(np.arange(100), (20, 60)), 1.0, 0.0)
    >>> multipath_share(echoes, axis, 1.0)
    0.5
    """
    inside, total = gate_energies(power, range_m, target_m, bins)
    if not np.sum(total) > 0:
        raise InputError(f"multipath share: there is no energy between {NEAR_M} and {FAR_M} m; check the recording")
    return float(1 - np.sum(inside) / np.sum(total))
