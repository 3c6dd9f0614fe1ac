"""Compute the brightness B of a target, in which the loss with distance is removed: B = 10 log10(mean_f E(f) R(f)^4).

E(f) is the target-gate energy of frame f and R(f) the nominal distance in metres. For a point target of radar cross section s,
E = G^2 lambda^2 s / ((4 pi)^3 R^4), so B depends only on s and on the radar. Ref: paper, disentangled fidelity, material (return brightness
at matched distance), and motion-specific feature design (target-gate brightness is the material feature). B is an absolute level, so
receiver gain and calibration change it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError


def without_range_law(energy: NDArray, distance_m: NDArray) -> NDArray[np.float64]:
    """Multiply each energy by the fourth power of its distance: E(f) R(f)^4, (F,)."""
    return np.asarray(energy, dtype=np.float64) * np.asarray(distance_m, dtype=np.float64) ** 4


def brightness_db(energy: NDArray, distance_m: NDArray) -> float:
    """Compute the brightness B: received over transmitted power at one metre, in decibels.

    Args:
        energy: (F,) from `envelope.target_energy`. distance_m: (F,).
    Raises:
        InputError: the mean energy above the noise is zero or negative.

    >>> round(brightness_db(np.full(4, 1e-8), np.full(4, 10.0)), 6)
    -40.0
    """
    mean = float(np.mean(without_range_law(energy, distance_m)))
    if not mean > 0:
        raise InputError("brightness: the target is not above the noise; check that it is in its gate")
    return 10 * float(np.log10(mean))
