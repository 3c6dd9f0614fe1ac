"""Liquids: complex permittivity of what bottles hold.

Water is the double-Debye model of Liebe, Hufford and Manabe, Int. J. Infrared and Millimeter Waves 12 (1991) 659:
with gamma the relaxation frequencies in GHz and time convention exp(+j omega t):
eps = eps_0 - f [ (eps_0 - eps_1)/(f - j gamma_1) + (eps_1 - eps_2)/(f - j gamma_2) ].
"""

import numpy as np

from radartwin.errors import MaterialError


def water(frequency_hz: np.ndarray | float, temperature_c: float = 20.0) -> np.ndarray:
    """Complex relative permittivity of pure water, eta' - j eta''; the model holds to 1 THz.

    Raises:
        MaterialError: a frequency above it.

    >>> complex(np.round(water(77e9), 1))
    (8.8-15.9j)
    """
    f = np.asarray(frequency_hz, float) / 1e9
    if f.max() > 1000:
        raise MaterialError(f"material 'water' has a model up to 1000 GHz, not at {float(f.max()):g} GHz")
    theta = 300.0 / (273.15 + temperature_c)
    static = 77.66 + 103.3 * (theta - 1)
    first = 0.0671 * static
    second = 3.52
    gamma_1 = 20.20 - 146.4 * (theta - 1) + 316.0 * (theta - 1) ** 2
    gamma_2 = 39.8 * gamma_1
    return static - f * ((static - first) / (f - 1j * gamma_1) + (first - second) / (f - 1j * gamma_2))
