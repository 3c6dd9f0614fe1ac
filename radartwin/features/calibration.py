"""Corner-reflector calibration: one affine map per feature from simulated to measured values, from recordings of a trihedral.

y = a x + b with a = sd(measured) / sd(simulated) and b = mean(measured) - a mean(simulated), over the frames of the reflector in both
domains (paper, corner-reflector radiometric calibration: a per-feature affine map between simulated and measured energy-dependent
features, more than a scalar gain, without a label of any evaluated class). The map uses moments and no regression, so the frames need not
be aligned and noise does not reduce the slope. A feature that is constant in the simulation of the reflector is only shifted, with a = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

_CONSTANT = 1e-9  # spread over value below which a feature is constant up to rounding


@dataclass(frozen=True, eq=False)
class AffineMap:
    """Slope and offset per feature, (features,)."""

    slope: NDArray[np.float64]
    offset: NDArray[np.float64]

    def apply(self, matrix: NDArray) -> NDArray[np.float64]:
        """Simulated values (..., features) on the scale of the measured domain."""
        return np.asarray(matrix, dtype=np.float64) * self.slope + self.offset


def fit(simulated: NDArray, measured: NDArray) -> AffineMap:
    """The map from the frames of the reflector in both domains.

    Args:
        simulated, measured: (F, features) and (G, features); one row each gives only a shift.
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
