"""Detect targets at a constant false-alarm rate by cell averaging (CA-CFAR).

Symbols: N is the number of training cells, and K is the number of looks (channels times frames) averaged in each cell. P_fa is the
false-alarm probability, alpha the threshold factor, and Y the estimate of the noise power, which is the mean of the training cells. The
detector reports a cell if its power exceeds alpha * Y.

The mean of K looks of exponentially distributed noise power has a gamma distribution. CA-CFAR therefore compares two gamma variables, whose
ratio is F(2K, 2KN) distributed. K = 1 gives the textbook factor alpha = N (P_fa^(-1/N) - 1). An FFT window correlates neighbouring cells,
so the true false-alarm rate is slightly higher than P_fa.

Reference: M. Richards, Fundamentals of Radar Signal Processing, 2nd ed., ch. 6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

Real = NDArray[np.float64]


def ca_factor(training: int, false_alarm: float, looks: int = 1) -> float:
    """Compute the CA-CFAR factor alpha, by which the mean power of the training cells is multiplied to obtain the threshold.

    Args:
        looks: number of independent looks averaged in each cell.

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
        power: array of linear power with one or more axes.
        guard: for each axis, the number of cells ignored on each side of the cell under test.
        training: for each axis, the number of cells averaged beyond the guard cells on each side of the cell under test.
        looks: number of independent looks averaged in each cell.
        min_factor: smallest threshold factor alpha, because alpha would approach 1 with many looks.
        wrap: for each axis, whether the axis is circular. The function extends a non-circular axis beyond its ends by reflection.
    Returns:
        detections: boolean array of the shape of `power`, true for detected cells.
        threshold: threshold power of each cell, of the shape of `power`.
    Raises:
        InputError: guard cells and training cells do not fit into the array, or there are no training cells.

    >>> noise = np.random.default_rng(0).exponential(size=4096)
    >>> hits, _ = ca_cfar(noise, guard=(2,), training=(16,), false_alarm=1e-2, looks=1, wrap=(False,))
    >>> bool(0.005 < hits.mean() < 0.02)
    True
    """
    noise, cells = training_mean(power, guard=guard, training=training, wrap=wrap)
    threshold = max(ca_factor(cells, false_alarm, looks), min_factor) * noise
    return power > threshold, threshold


def training_mean(power: Real, *, guard: tuple[int, ...], training: tuple[int, ...], wrap: tuple[bool, ...]) -> tuple[Real, int]:
    """Estimate the noise power of each cell as the mean of its training cells.

    The arguments are those of `ca_cfar`. The function returns the noise power of each cell, of the shape of `power`, and the number of
    training cells of a cell.

    Raises:
        InputError: guard cells and training cells do not fit into the array, or there are no training cells.
    """
    from scipy.ndimage import uniform_filter1d

    outer = tuple(g + t for g, t in zip(guard, training, strict=True))
    if max(training) == 0 or any(2 * reach + 1 > size for size, reach in zip(power.shape, outer, strict=True)):
        cells = f"guard cells {guard} and training cells {training} do not fit a map of {power.shape} cells"
        raise InputError(f"CFAR: {cells}; use fewer cells, and at least one training cell")
    total, inner = power.astype(np.float64), power.astype(np.float64)
    for axis, (g, o, circular) in enumerate(zip(guard, outer, wrap, strict=True)):
        mode = "wrap" if circular else "reflect"
        total = uniform_filter1d(total, 2 * o + 1, axis=axis, mode=mode) * (2 * o + 1)
        inner = uniform_filter1d(inner, 2 * g + 1, axis=axis, mode=mode) * (2 * g + 1)
    cells = int(np.prod([2 * o + 1 for o in outer]) - np.prod([2 * g + 1 for g in guard]))
    # Near a strong cell, rounding may make the difference of the two running sums negative.
    return np.maximum(total - inner, 0.0) / cells, cells
