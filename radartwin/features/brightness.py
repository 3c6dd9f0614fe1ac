"""How bright the target is, with the range equation taken out: B = 10 log10(mean_f E(f) R(f)^4), R the nominal distance in metres.

For a point target of radar cross section s, E = G^2 lambda^2 s / ((4 pi)^3 R^4), so B depends on s and the radar alone (paper,
disentangled fidelity, material: return brightness at matched distance; motion-specific feature design: target-gate brightness is the
material feature). It stays absolute: gain and calibration shift it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError


def without_range_law(energy: NDArray, distance_m: NDArray) -> NDArray[np.float64]:
    """E(f) R(f)^4, (F,)."""
    return np.asarray(energy, dtype=np.float64) * np.asarray(distance_m, dtype=np.float64) ** 4


def brightness_db(energy: NDArray, distance_m: NDArray) -> float:
    """B in decibels at one metre, of received over transmitted power.

    Args:
        energy: (F,) from `envelope.target_energy`. distance_m: (F,).
    Raises:
        InputError: a mean at or below the noise.

    >>> round(brightness_db(np.full(4, 1e-8), np.full(4, 10.0)), 6)
    -40.0
    """
    mean = float(np.mean(without_range_law(energy, distance_m)))
    if not mean > 0:
        raise InputError("brightness: the target is not above the noise; is it in its gate?")
    return 10 * float(np.log10(mean))
