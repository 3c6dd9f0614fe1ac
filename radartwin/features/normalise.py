"""Bring simulated and measured features to a common scale without class labels, either by ranks or by a corner reflector.

Rank normalisation: each value of a feature becomes u_i = (rank_i - 1/2) / n, where rank_i is its rank among the n recordings of its own
domain (simulation or measurement). An increasing function of a feature does not change its ranks. Rank normalisation therefore removes
every difference between simulation and measurement that such a function describes.

Corner-reflector calibration: each simulated value x of a feature becomes y = a x + b, with a = sd(measured) / sd(simulated) and
b = mean(measured) - a mean(simulated). The means and standard deviations (sd) are those of the feature over the frames of a trihedral
corner reflector, once simulated and once measured. Because this affine map uses means and standard deviations instead of a regression, the
frames of simulation and measurement need no alignment, and noise does not reduce the slope a. If a feature is constant in the simulation, a
is 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

_CONSTANT = 1e-9  # a feature counts as constant if its standard deviation is at most this fraction of 1 + its largest magnitude


def rank_normalise(matrix: NDArray, groups: NDArray) -> NDArray[np.float64]:
    """Replace each value by its normalised rank in its column, above 0 and below 1; equal values have their mean rank.

    Args:
        matrix: (n, features) feature values of n recordings of one domain (simulation or measurement).
        groups: (n,) group of each recording, for example its distance; the function ranks each group separately.
    Raises:
        InputError: values are not finite, or the length of `groups` is not n.

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
    """Hold the slope (features,) and the offset (features,) of the affine map from simulated to measured values of each feature."""

    slope: NDArray[np.float64]
    offset: NDArray[np.float64]

    def apply(self, matrix: NDArray) -> NDArray[np.float64]:
        """Convert simulated values (..., features) to the scale of the measurement."""
        return np.asarray(matrix, dtype=np.float64) * self.slope + self.offset


def fit_map(simulated: NDArray, measured: NDArray) -> AffineMap:
    """Fit the affine map from simulated to measured features to the frames of a corner reflector.

    Args:
        simulated: (F, features) features of F simulated frames.
        measured: (G, features) features of G measured frames. If a matrix has a single row, the slope of the map is 1.
    Raises:
        InputError: the matrices have different numbers of features, no rows, or values that are not finite.

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
