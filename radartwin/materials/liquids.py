"""Compute the complex permittivity of the liquids in bottles, time convention exp(+j omega t).

Water follows the double-Debye model of H. Liebe, G. Hufford, T. Manabe, Int. J. Infrared and Millimeter Waves 12 (1991) 659, with the
relaxation frequencies gamma in GHz: eps = eps_0 - f [(eps_0 - eps_1)/(f - j gamma_1) + (eps_1 - eps_2)/(f - j gamma_2)].
Ethanol follows the triple-Debye fit of J. Kindt, C. Schmuttenmaer, J. Phys. Chem. 100 (1996) 10373, at 25 C.

All other liquids are mixtures by the law of H. Looyenga, Physica 31 (1965) 401: the cube root of the permittivity is the average of the
cube roots, weighted by the volume fractions. The law treats all components alike and is exact to second order in their contrast. For oil
drops in water, up to a quarter of oil, its surface reflection differs from that of Hanai's law by less than 0.2 dB. The fractions are the
rounded composition of an ordinary product. Dissolved and suspended solids have the permittivity SOLIDS. Salt is left out: 3 % of salt adds
1.0 to eps'' at 77 GHz, which changes the reflection by at most 0.3 dB. The composition of a product is uncertain by as much, about 10 % of
eps.
"""

import numpy as np

from radartwin.errors import MaterialError
from radartwin.materials import plastics

TEMPERATURE_C = 20.0
SOLIDS = 2.7 * (1 - 0.02j)  # dry sugar, starch and protein: 2.5 to 3 (S. Nelson, IEEE Trans. Electr. Insul. 26 (1991) 845)

# Volume fractions; the rest is water.
RECIPES = {
    "mouthwash": {"ethanol": 0.22},  # 21.6 % by volume on the label of the classic antiseptic kind
    "detergent": {"oil": 0.25, "ethanol": 0.03},  # hand dishwashing: 15 to 30 % surfactants (label classes of EC 648/2004), a solvent
    "mustard": {"oil": 0.04, "solids": 0.09},  # yellow, prepared: 84 % water, 3 % fat, 10 % carbohydrate and protein by mass (USDA)
    "dressing": {"oil": 0.25, "solids": 0.09},  # Italian: about two thirds water, a fifth fat, 12 % carbohydrate by mass (USDA)
}
NAMES = ("water", "ethanol", *RECIPES)


def permittivity(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Compute the complex relative permittivity eta' - j eta'' of a liquid of NAMES, shape of `frequency_hz`.

    Water is at 20 C, ethanol and oil at room temperature.

    Raises:
        MaterialError: a frequency outside the range of a model.

    >>> complex(np.round(permittivity("mustard", 77e9), 1))
    (8.1-12.4j)
    """
    if name == "water":
        return water(frequency_hz)
    if name == "ethanol":
        return ethanol(frequency_hz)
    recipe = RECIPES[name]
    phases = [(1 - sum(recipe.values()), water(frequency_hz))]
    for part, fraction in recipe.items():
        phases.append((fraction, _part(part, frequency_hz)))
    return looyenga(phases)


def _part(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    if name == "solids":
        return np.full(np.shape(frequency_hz), SOLIDS)
    return ethanol(frequency_hz) if name == "ethanol" else plastics.permittivity(name, frequency_hz)


def looyenga(phases: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Compute the permittivity of a mixture by Looyenga's law from a list of (volume fraction, permittivity)."""
    return sum((fraction * np.asarray(eps) ** (1 / 3) for fraction, eps in phases), np.zeros((), complex)) ** 3


def water(frequency_hz: np.ndarray | float, temperature_c: float = TEMPERATURE_C) -> np.ndarray:
    """Compute the complex relative permittivity of pure water, eta' - j eta'', up to 1 THz.

    Raises:
        MaterialError: a frequency above 1 THz, or a temperature outside 0 to 100 C.

    >>> complex(np.round(water(77e9), 1))
    (8.8-15.9j)
    """
    f = _gigahertz("water", frequency_hz, 0.0, 1000.0)
    if not 0 <= temperature_c <= 100:
        raise MaterialError(f"material 'water' is liquid from 0 to 100 C, not at {temperature_c!r} C")
    theta = 300.0 / (273.15 + temperature_c)
    static = 77.66 + 103.3 * (theta - 1)
    first = 0.0671 * static
    second = 3.52
    gamma_1 = 20.20 - 146.4 * (theta - 1) + 316.0 * (theta - 1) ** 2
    gamma_2 = 39.8 * gamma_1
    return static - f * ((static - first) / (f - 1j * gamma_1) + (first - second) / (f - 1j * gamma_2))


def ethanol(frequency_hz: np.ndarray | float) -> np.ndarray:
    """Compute the complex relative permittivity of ethanol at 25 C, up to 1 THz.

    >>> complex(np.round(ethanol(77e9), 1))
    (3.1-1j)
    """
    turns = 2 * np.pi * _gigahertz("ethanol", frequency_hz, 0.0, 1000.0) * 1e-3  # omega times a picosecond
    steps = ((24.35, 4.15, 161.0), (4.15, 2.72, 3.3), (2.72, 1.93, 0.22))
    return 1.93 + sum(((high - low) / (1 + 1j * turns * delay) for high, low, delay in steps), np.zeros((), complex))


def _gigahertz(name: str, frequency_hz: np.ndarray | float, low: float, high: float) -> np.ndarray:
    f = np.asarray(frequency_hz, float) / 1e9
    if not (low <= f.min() and f.max() <= high):
        raise MaterialError(f"material {name!r} has a model up to {high:g} GHz, not at {float(f.max()):g} GHz")
    return f
