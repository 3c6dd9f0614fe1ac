"""Compute the energy inside the target gate, and the energy share of multipath outside of it.

Symbols: P(f, r) -> power, (F, bins), from `profile.range_time`. The gate holds the range bin of the target and GATE_BINS bins (0.13 m) on
either side. All sums are over ranges from NEAR_M to FAR_M. The multipath share (paper, motion-specific features) is the energy outside the
gate divided by all energy: sum_{r outside gate} P / sum P.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from radartwin.errors import InputError
from radartwin.features.profile import FAR_M, GATE_BINS, NEAR_M


def gate_energies(power: np.ndarray, range_m: np.ndarray, target_m: ArrayLike, bins: int = GATE_BINS) -> tuple[np.ndarray, np.ndarray]:
    """Compute the energy inside the target gate and the energy at all ranges from NEAR_M to FAR_M, for each frame.

    Args:
        power: (F, bins), or (bins,) for one profile.
        range_m: (bins,) in metres.
        target_m: range of the target in metres, one value or one per frame (F,).
    Returns:
        inside: energy inside the gate, (F,), or a scalar for one profile.
        all: energy at all ranges, of the same shape.
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
    """Compute the multipath share of a recording, 0 to 1. The arguments are those of `gate_energies`.

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
