"""Detect targets at a constant false-alarm rate (CFAR): cell averaging (CA) and ordered statistic (OS).

Symbols: N training cells, K looks averaged in each cell (channels times frames), P_fa -> false_alarm, alpha -> factor,
Y -> the estimate of the noise power. A cell is detected where its power exceeds alpha * Y.

A mean of K looks of exponentially distributed noise power is gamma distributed. CA-CFAR then compares two gamma
variables, whose ratio is F(2K, 2KN) distributed; K = 1 gives the textbook alpha = N (P_fa^(-1/N) - 1). OS-CFAR
integrates over the distribution of its order statistic. An FFT window correlates neighbouring cells, so the true
false-alarm rate is slightly higher than P_fa.

References: H. Rohling, Radar CFAR thresholding in clutter and multiple target situations, IEEE Trans. AES-19 (1983);
M. Richards, Fundamentals of Radar Signal Processing, 2nd ed., ch. 6.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

Real = NDArray[np.float64]
Cells = int | tuple[int, ...]


def ca_factor(training: int, false_alarm: float, looks: int = 1) -> float:
    """Compute the CA-CFAR factor alpha: threshold over the mean of `training` cells, each averaged over `looks` independent looks.

    >>> round(ca_factor(16, 1e-4), 6) == round(16 * (1e-4 ** (-1 / 16) - 1), 6)
    True
    """
    from scipy.stats import f

    _check_rate(false_alarm, looks)
    return float(f.isf(false_alarm, 2 * looks, 2 * looks * training))


@lru_cache(maxsize=64)
def os_factor(training: int, rank: int, false_alarm: float, looks: int = 1) -> float:
    """Compute the OS-CFAR factor alpha: threshold over the cell of rank `rank` (1 is the smallest) of the `training` cells.

    Each cell is averaged over `looks` independent looks.
    """
    from scipy.optimize import brentq
    from scipy.stats import beta, gamma

    _check_rate(false_alarm, looks)
    if not 1 <= rank <= training:
        raise InputError(f"OS-CFAR: rank {rank} must be from 1 to the {training} training cells")
    # Integrate over the distribution of the order statistic at 4000 quantiles, which suffice for a smooth integrand.
    levels = beta(rank, training - rank + 1).ppf((np.arange(4000) + 0.5) / 4000)
    noise = gamma(looks, scale=1 / looks).ppf(levels)
    cell = gamma(looks, scale=1 / looks)

    def excess(log_factor: float) -> float:
        return float(np.log(cell.sf(np.exp(log_factor) * noise).mean() + 1e-300) - np.log(false_alarm))

    root: Any = brentq(excess, np.log(1e-3), np.log(1e6))
    return float(np.exp(root))


def ca_cfar(
    power: Real,
    *,
    guard: Cells,
    training: Cells,
    false_alarm: float = 1e-5,
    looks: int = 1,
    min_factor: float = 0.0,
    wrap: tuple[bool, ...] = (),
) -> tuple[NDArray[np.bool_], Real]:
    """Detect cells by cell-averaging CFAR.

    Args:
        power: linear power, one or more dimensions.
        guard: cells ignored on each side of the cell under test, per axis or one number for all axes.
        training: cells averaged beyond the guard cells on each side, per axis or one number for all axes.
        looks: independent looks averaged in each cell.
        min_factor: lower limit of the threshold factor alpha, which would approach 1 with many looks.
        wrap: for each axis, whether the axis is circular; all other axes are continued by reflection.
    Returns:
        detections: boolean, of the shape of power.
        threshold: of the shape of power.
    Raises:
        InputError: the window does not fit the map, or false_alarm is not between 0 and 1.

    >>> noise = np.random.default_rng(0).exponential(size=4096)
    >>> hits, _ = ca_cfar(noise, guard=2, training=16, false_alarm=1e-2)
    >>> bool(0.005 < hits.mean() < 0.02)
    True
    """
    from scipy.ndimage import uniform_filter1d

    guards, outer, modes = _windows(power, guard, training, wrap)
    total, inner = power.astype(np.float64), power.astype(np.float64)
    for axis, (g, o, mode) in enumerate(zip(guards, outer, modes, strict=True)):
        total = uniform_filter1d(total, 2 * o + 1, axis=axis, mode=mode) * (2 * o + 1)
        inner = uniform_filter1d(inner, 2 * g + 1, axis=axis, mode=mode) * (2 * g + 1)
    cells = _training_cells(guards, outer)
    # Near a strong cell, the difference of the two running sums may fall below zero by rounding.
    noise = np.maximum(total - inner, 0.0) / cells
    threshold = max(ca_factor(cells, false_alarm, looks), min_factor) * noise
    return power > threshold, threshold


def os_cfar(
    power: Real,
    *,
    guard: Cells,
    training: Cells,
    false_alarm: float = 1e-5,
    looks: int = 1,
    min_factor: float = 0.0,
    quantile: float = 0.75,
    wrap: tuple[bool, ...] = (),
) -> tuple[NDArray[np.bool_], Real]:
    """Detect cells by ordered-statistic CFAR, in which neighbouring targets do not mask each other.

    The other arguments, the results and the errors are those of ca_cfar.

    Args:
        quantile: the quantile of the training cells that serves as the noise estimate (Rohling: 3/4).
    """
    from scipy.ndimage import rank_filter

    guards, outer, modes = _windows(power, guard, training, wrap)
    cells = _training_cells(guards, outer)
    if not 0 < quantile <= 1:
        raise InputError(f"OS-CFAR: quantile {quantile} must be above 0 and at most 1")
    rank = max(1, round(quantile * cells))
    footprint = np.ones([2 * o + 1 for o in outer], dtype=bool)
    footprint[tuple(slice(o - g, o + g + 1) for g, o in zip(guards, outer, strict=True))] = False
    padded = power
    for axis, (o, mode) in enumerate(zip(outer, modes, strict=True)):
        border = [(o, o) if a == axis else (0, 0) for a in range(power.ndim)]
        padded = np.pad(padded, border, mode="wrap" if mode == "wrap" else "symmetric")
    noise = rank_filter(padded, rank - 1, footprint=footprint)
    noise = noise[tuple(slice(o, o + n) for o, n in zip(outer, power.shape, strict=True))]
    threshold = max(os_factor(cells, rank, false_alarm, looks), min_factor) * noise
    return power > threshold, threshold


def _windows(
    power: Real, guard: Cells, training: Cells, wrap: tuple[bool, ...]
) -> tuple[tuple[int, ...], tuple[int, ...], tuple[str, ...]]:
    guards, trainings = ((cells,) * power.ndim if isinstance(cells, int) else tuple(cells) for cells in (guard, training))
    wraps = wrap or (False,) * power.ndim
    if not len(guards) == len(trainings) == len(wraps) == power.ndim:
        raise InputError(f"CFAR: guard, training and wrap need one entry per axis of the {power.ndim}-dimensional map")
    outer = tuple(g + t for g, t in zip(guards, trainings, strict=True))
    if min(guards) < 0 or min(trainings) < 0 or max(trainings) == 0:
        raise InputError("CFAR: guard and training cells must be at least 0, with training cells along some axis")
    for size, reach in zip(power.shape, outer, strict=True):
        if 2 * reach + 1 > size:
            raise InputError(f"CFAR: a window of {2 * reach + 1} cells does not fit an axis of {size}; use fewer cells")
    return guards, outer, tuple("wrap" if circular else "reflect" for circular in wraps)


def _training_cells(guards: tuple[int, ...], outer: tuple[int, ...]) -> int:
    return int(np.prod([2 * o + 1 for o in outer]) - np.prod([2 * g + 1 for g in guards]))


def _check_rate(false_alarm: float, looks: int) -> None:
    if not 0 < false_alarm < 1 or looks < 1:
        raise InputError(f"CFAR: false_alarm {false_alarm} must be between 0 and 1 and looks {looks} at least 1")
