"""Coherent loss of a rough surface. Ref: W. S. Ament, Proc. IRE 41 (1953) 142.

Symbols: sigma_h -> rms height, theta -> angle of incidence; rho_s = exp(-2 (k sigma_h cos theta)^2) on the field.
"""

import numpy as np


def ament(roughness_m: float, cos_incidence: np.ndarray, wavenumber: float | np.ndarray) -> np.ndarray:
    """Factor on the coherent reflected field, shape of `cos_incidence`.

    >>> float(np.round(20 * np.log10(ament(0.05e-3, np.array(1.0), 2 * np.pi / 3.8934e-3)), 4))
    -0.1131
    """
    return np.exp(-2 * (wavenumber * roughness_m * np.asarray(cos_incidence)) ** 2)


def ament_transmitted(
    roughness_m: float, cos_incidence: np.ndarray, wavenumber: float | np.ndarray, permittivity: np.ndarray | complex
) -> np.ndarray:
    """Factor on the coherent field that passes one rough face into or out of a medium, shape of `cos_incidence`.

    The phase screen of the same surface: a height h changes the way by h (k_z inside - k_z outside), where reflection has 2 h k_z, so that
    exp(-(1/2) (sigma_h (k_z' - k_z))^2) stands in the place of Ament's factor. It is much the milder of the two.
    """
    cosine = np.asarray(cos_incidence, float)
    inside = np.real(np.sqrt(np.asarray(permittivity) + 0j - (1 - cosine**2)))
    return np.exp(-0.5 * (wavenumber * roughness_m * (inside - cosine)) ** 2)
