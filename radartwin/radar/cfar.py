"""Detect targets at a constant false-alarm rate by cell averaging (CA-CFAR).

Symbols: N training cells, K looks averaged in each cell (channels times frames), P_fa -> false_alarm, alpha -> factor,
Y -> the estimate of the noise power. A cell is detected where its power exceeds alpha * Y.

A mean of K looks of exponentially distributed noise power is gamma distributed. CA-CFAR then compares two gamma
variables, whose ratio is F(2K, 2KN) distributed; K = 1 gives the textbook alpha = N (P_fa^(-1/N) - 1). An FFT window
correlates neighbouring cells, so the true false-alarm rate is slightly higher than P_fa.

Reference: M. Richards, Fundamentals of Radar Signal Processing, 2nd ed., ch. 6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

Real = NDArray[np.float64]


def ca_factor(training: int, false_alarm: float, looks: int = 1) -> float:
    """Compute the CA-CFAR factor alpha: threshold over the mean of `training` cells, each averaged over `looks` independent looks.

    >>> round(ca_factor(16, 1e-4), 6) == round(16 * (1e-4 ** (-1 / 16) - 1), 6)
    True
    """
    from scipy.stats import f

    return float(f.isf(false_alarm, 2 * looks, 2 * looks * training))


def ca_cfar(
    power: Real,
    *,
    guard: tuple[int, ...],
    training: tuple[int, ...],
    false_alarm: float,
    looks: int,
    min_factor: float = 0.0,
    wrap: tuple[bool, ...],
) -> tuple[NDArray[np.bool_], Real]:
    """Detect cells by cell-averaging CFAR.

    Args:
        power: linear power, one or more dimensions.
        guard: cells ignored on each side of the cell under test, per axis.
        training: cells averaged beyond the guard cells on each side, per axis.
        looks: independent looks averaged in each cell.
        min_factor: lower limit of the threshold factor alpha, which would approach 1 with many looks.
        wrap: for each axis, whether the axis is circular; all other axes are continued by reflection.
    Returns:
        detections: boolean, of the shape of power.
        threshold: of the shape of power.
    Raises:
        InputError: the window does not fit the map or has no training cells.

    >>> noise = np.random.default_rng(0).exponential(size=4096)
    >>> hits, _ = ca_cfar(noise, guard=(2,), training=(16,), false_alarm=1e-2, looks=1, wrap=(False,))
    >>> bool(0.005 < hits.mean() < 0.02)
    True
    """
    from scipy.ndimage import uniform_filter1d

    outer = tuple(g + t for g, t in zip(guard, training, strict=True))
    if max(training) == 0 or any(2 * reach + 1 > size for size, reach in zip(power.shape, outer, strict=True)):
        raise InputError(f"CFAR: guard cells {guard} and training cells {training} do not fit a map of {power.shape} cells")
    total, inner = power.astype(np.float64), power.astype(np.float64)
    for axis, (g, o, circular) in enumerate(zip(guard, outer, wrap, strict=True)):
        mode = "wrap" if circular else "reflect"
        total = uniform_filter1d(total, 2 * o + 1, axis=axis, mode=mode) * (2 * o + 1)
        inner = uniform_filter1d(inner, 2 * g + 1, axis=axis, mode=mode) * (2 * g + 1)
    cells = int(np.prod([2 * o + 1 for o in outer]) - np.prod([2 * g + 1 for g in guard]))
    # Near a strong cell, the difference of the two running sums may fall below zero by rounding.
    noise = np.maximum(total - inner, 0.0) / cells
    threshold = max(ca_factor(cells, false_alarm, looks), min_factor) * noise
    return power > threshold, threshold
