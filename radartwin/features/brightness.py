"""Brightness of the target without the range law: B = 10 log10(mean_f E(f) R(f)^4), with R the nominal distance in metres.

For a point target of radar cross section s, E = G^2 lambda^2 s / ((4 pi)^3 R^4), so B depends only on s and the radar (paper,
disentangled fidelity, material: return brightness at matched distance; motion-specific feature design: target-gate brightness is the
material feature). B is an absolute level, so gain and calibration shift it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError


def without_range_law(energy: NDArray, distance_m: NDArray) -> NDArray[np.float64]:
    """E(f) R(f)^4, (F,)."""
    return np.asarray(energy, dtype=np.float64) * np.asarray(distance_m, dtype=np.float64) ** 4


def brightness_db(energy: NDArray, distance_m: NDArray) -> float:
    """B in decibels of received over transmitted power at one metre.

    Args:
        energy: (F,) from `envelope.target_energy`. distance_m: (F,).
    Raises:
        InputError: the mean is at or below the noise.

    >>> round(brightness_db(np.full(4, 1e-8), np.full(4, 10.0)), 6)
    -40.0
    """
    mean = float(np.mean(without_range_law(energy, distance_m)))
    if not mean > 0:
        raise InputError("brightness: the target is not above the noise; check that it is in its gate")
    return 10 * float(np.log10(mean))
