"""Corner-reflector calibration: one affine map per feature from simulated to measured values, out of one unlabelled recording of a
trihedral in both domains.

y = a x + b with a = sd(measured) / sd(simulated) and b = mean(measured) - a mean(simulated), over the frames of the reflector's recordings
(paper, corner-reflector radiometric calibration: a per-feature affine map between simulated and measured energy-dependent features, more
than a scalar gain, without a label of any evaluated class). Moments, not a regression: frames of the two need not be aligned, and noise
does not flatten the slope. A feature that the reflector's simulation does not vary is shifted alone, a = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

_STILL = 1e-9  # a spread so small beside the value is rounding


@dataclass(frozen=True, eq=False)
class AffineMap:
    """slope and offset per feature, (features,)."""

    slope: NDArray[np.float64]
    offset: NDArray[np.float64]

    def apply(self, matrix: NDArray) -> NDArray[np.float64]:
        """Simulated values as the measured domain would have them; (..., features)."""
        return np.asarray(matrix, dtype=np.float64) * self.slope + self.offset


def fit(simulated: NDArray, measured: NDArray) -> AffineMap:
    """The map from the reflector's frames in both domains.

    Args:
        simulated, measured: (F, features) and (G, features); one row each gives a shift alone.
    Raises:
        InputError: matrices of different features, without rows, or with values that are not finite.

    >>> frames = np.array([[0.0], [2.0]])
    >>> fit(frames, 3 * frames + 1).apply(np.array([[5.0]])).tolist()
    [[16.0]]
    """
    simulated, measured = (np.asarray(matrix, dtype=np.float64) for matrix in (simulated, measured))
    if simulated.ndim != 2 or measured.ndim != 2 or simulated.shape[1] != measured.shape[1] or not (len(simulated) and len(measured)):
        raise InputError(f"calibration: give frames of the same features of both domains, not {simulated.shape} and {measured.shape}")
    if not (np.isfinite(simulated).all() and np.isfinite(measured).all()):
        raise InputError("calibration: a feature of the reflector is not finite")
    spread, wanted = simulated.std(axis=0), measured.std(axis=0)
    still = (spread <= _STILL * (1 + np.abs(simulated).max(axis=0))) | (len(measured) < 2)
    slope = np.where(still, 1.0, wanted / np.where(still, 1.0, spread))
    return AffineMap(slope, measured.mean(axis=0) - slope * simulated.mean(axis=0))
