"""Bring simulated and measured features to a common scale, without labels: by ranks, or by a corner reflector.

Ranks: u_i = (rank_i - 1/2) / n per feature among the n recordings of one domain (simulation or measurement). An increasing function of a
feature does not change its ranks, so that any such difference between the two domains disappears (paper, scene-level recognition,
label-free: per-feature rank normalisation).

Corner reflector: y = a x + b with a = sd(measured) / sd(simulated) and b = mean(measured) - a mean(simulated). Means and standard
deviations are over the frames of a trihedral, once simulated and once measured (paper, corner-reflector radiometric calibration, a
per-feature affine map of energy-dependent features). Because the map uses means and standard deviations instead of a regression, the frames
need no alignment, and noise does not reduce the slope. If a feature is constant in the simulation, a = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

_CONSTANT = 1e-9  # a feature whose spread divided by its value is smaller counts as constant


def rank_normalise(matrix: NDArray, groups: NDArray) -> NDArray[np.float64]:
    """Replace each value by its normalised rank in its column, above 0 and below 1; equal values have their mean rank.

    Args:
        matrix: (n, features), rows of one domain.
        groups: (n,) group of each row, such as its distance; each group is ranked separately.
    Raises:
        InputError: values are not finite, or groups has another length.

    >>> rank_normalise(np.array([[3.0], [10.0], [10.0], [1.0]]), np.zeros(4))[:, 0].tolist()
    [0.375, 0.75, 0.75, 0.125]
    """
    from scipy.stats import rankdata

    matrix = np.asarray(matrix, dtype=np.float64)
    if matrix.ndim != 2 or not np.isfinite(matrix).all():
        raise InputError(f"rank normalisation: give a matrix (rows, features) of finite values, not {matrix.shape}")
    if np.shape(groups) != (len(matrix),):
        raise InputError(f"rank normalisation: {np.shape(groups)} groups for {len(matrix)} rows; give one group per row")
    ranked = np.empty_like(matrix)
    for group in np.unique(groups):
        rows = groups == group
        ranked[rows] = (rankdata(matrix[rows], axis=0) - 0.5) / rows.sum()
    return ranked


@dataclass(frozen=True, eq=False)
class AffineMap:
    """Hold the slope and the offset of each feature, (features,)."""

    slope: NDArray[np.float64]
    offset: NDArray[np.float64]

    def apply(self, matrix: NDArray) -> NDArray[np.float64]:
        """Convert simulated values (..., features) to the scale of the measurement."""
        return np.asarray(matrix, dtype=np.float64) * self.slope + self.offset


def fit_map(simulated: NDArray, measured: NDArray) -> AffineMap:
    """Fit the map to simulated and measured frames of the reflector.

    Args:
        simulated, measured: (F, features) and (G, features); with one row each, the slope is 1.
    Raises:
        InputError: the matrices have different features, no rows, or values that are not finite.

    >>> frames = np.array([[0.0], [2.0]])
    >>> fit_map(frames, 3 * frames + 1).apply(np.array([[5.0]])).tolist()
    [[16.0]]
    """
    simulated, measured = (np.asarray(matrix, dtype=np.float64) for matrix in (simulated, measured))
    if simulated.ndim != 2 or measured.ndim != 2 or simulated.shape[1] != measured.shape[1] or not (len(simulated) and len(measured)):
        raise InputError(f"calibration: give frames with the same features in both domains, not {simulated.shape} and {measured.shape}")
    if not (np.isfinite(simulated).all() and np.isfinite(measured).all()):
        raise InputError("calibration: a feature of the reflector is not finite; check its recordings")
    spread, measured_spread = simulated.std(axis=0), measured.std(axis=0)
    constant = (spread <= _CONSTANT * (1 + np.abs(simulated).max(axis=0))) | (len(measured) < 2)
    slope = np.where(constant, 1.0, measured_spread / np.where(constant, 1.0, spread))
    return AffineMap(slope, measured.mean(axis=0) - slope * simulated.mean(axis=0))
