"""Calibrate features with a corner reflector: map simulated to measured values by a slope and an offset per feature.

y = a x + b with a = sd(measured) / sd(simulated) and b = mean(measured) - a mean(simulated). Means and standard deviations are over the
frames of a trihedral, once simulated and once measured. Ref: paper, corner-reflector radiometric calibration, a per-feature affine map of
energy-dependent features that uses no label of any evaluated class. The map uses means and standard deviations instead of a regression.
The frames therefore need no alignment, and noise does not reduce the slope. If a feature is constant in the simulation, a = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

_CONSTANT = 1e-9  # a feature whose spread divided by its value is smaller counts as constant


@dataclass(frozen=True, eq=False)
class AffineMap:
    """Hold the slope and the offset of each feature, (features,)."""

    slope: NDArray[np.float64]
    offset: NDArray[np.float64]

    def apply(self, matrix: NDArray) -> NDArray[np.float64]:
        """Convert simulated values (..., features) to the scale of the measurement."""
        return np.asarray(matrix, dtype=np.float64) * self.slope + self.offset


def fit(simulated: NDArray, measured: NDArray) -> AffineMap:
    """Fit the map to simulated and measured frames of the reflector.

    Args:
        simulated, measured: (F, features) and (G, features); with one row each, the slope is 1.
    Raises:
        InputError: the matrices have different features, no rows, or values that are not finite.

    >>> frames = np.array([[0.0], [2.0]])
    >>> fit(frames, 3 * frames + 1).apply(np.array([[5.0]])).tolist()
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
