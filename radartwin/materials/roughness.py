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
