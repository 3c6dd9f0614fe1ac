"""Compute the permittivity of air, of container plastics and of the liquids in bottles, time convention exp(+j omega t).

Plastics, oil and air are nearly lossless and constant between 10 and 100 GHz. Refs: J. W. Lamb, Int. J. Infrared and Millimeter Waves 17
(1996) 1997 (HDPE 2.31, PET 2.9 at millimetre waves, loss tangents of 0.0003 and 0.01); vegetable oils 2.4 to 2.5 with loss tangents of 0.03
to 0.05 (free-space measurements at W band).
Water follows the double-Debye model of H. Liebe, G. Hufford, T. Manabe, Int. J. Infrared and Millimeter Waves 12 (1991) 659, with the
relaxation frequencies gamma in GHz: eps = eps_0 - f [(eps_0 - eps_1)/(f - j gamma_1) + (eps_1 - eps_2)/(f - j gamma_2)].
Dry skin follows the Cole-Cole fit of Gabriel (`skin`).
Ethanol follows the triple-Debye fit of J. Kindt, C. Schmuttenmaer, J. Phys. Chem. 100 (1996) 10373, at 25 C.

All other liquids are mixtures by the law of H. Looyenga, Physica 31 (1965) 401. By this law, the cube root of the permittivity of a mixture
is the average of the cube roots of the permittivities of its components, weighted by their volume fractions. The law is exact to second
order in the contrast of the components. For oil drops in water, with up to a quarter of oil, the surface reflection by this law differs
from that by Hanai's law by less than 0.2 dB. The volume fractions are the rounded composition of an ordinary product. Dissolved and
suspended solids have the permittivity SOLIDS. The model leaves out salt. A salt content of 3 % would add 1.0 to the imaginary part
of the permittivity at 77 GHz, which changes the reflection by at most 0.3 dB. The unknown composition of a product causes a similar
uncertainty, about 10 % of the permittivity.
"""

import numpy as np

from radartwin.errors import MaterialError

CONSTANT_HZ = (10e9, 100e9)  # frequency range in which the permittivities in CONSTANT are valid; air and vacuum are valid everywhere
CONSTANT = {"pet": 2.9 * (1 - 0.01j), "hdpe": 2.31 * (1 - 0.0003j), "oil": 2.45 * (1 - 0.04j), "air": 1.0 + 0.0j, "vacuum": 1.0 + 0.0j}
EMPTY = ("air", "vacuum")
SOLIDS = 2.7 * (1 - 0.02j)  # dry sugar, starch and protein: 2.5 to 3 (S. Nelson, IEEE Trans. Electr. Insul. 26 (1991) 845)

# Volume fractions of the components of each liquid mixture; the remaining volume is water.
RECIPES = {
    "mouthwash": {"ethanol": 0.22},  # 21.6 % by volume on the label of the classic antiseptic mouthwash
    "detergent": {"oil": 0.25, "ethanol": 0.03},  # hand dishwashing: 15 to 30 % surfactants (label classes of EC 648/2004), a solvent
    "mustard": {"oil": 0.04, "solids": 0.09},  # yellow, prepared: 84 % water, 3 % fat, 10 % carbohydrate and protein by mass (USDA)
    "dressing": {"oil": 0.25, "solids": 0.09},  # Italian: about two thirds water, a fifth fat, 12 % carbohydrate by mass (USDA)
}
LIQUIDS = ("water", "ethanol", *RECIPES)
SKIN = "skin"
NAMES = (*CONSTANT, *LIQUIDS, SKIN)


def permittivity(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Compute the complex relative permittivity eta' - j eta'' of a material of NAMES, shape of `frequency_hz`.

    Water is at 20 C, ethanol and oil at room temperature.

    Raises:
        MaterialError: a frequency is outside the range in which the model of the material is valid.

    >>> complex(np.round(permittivity("mustard", 77e9), 1))
    (8.1-12.4j)
    """
    if name == "water":
        return water(frequency_hz)
    if name == "ethanol":
        return ethanol(frequency_hz)
    if name == SKIN:
        return skin(frequency_hz)
    if name == "solids":
        return np.full(np.shape(frequency_hz), SOLIDS)
    if name in CONSTANT:
        low, high = float(np.min(frequency_hz)), float(np.max(frequency_hz))
        if name not in EMPTY and not (CONSTANT_HZ[0] <= low and high <= CONSTANT_HZ[1]):
            raise MaterialError(
                f"material {name!r} has values from 10 to 100 GHz, not at {low / 1e9:g} to {high / 1e9:g} GHz; choose another material"
            )
        return np.full(np.shape(frequency_hz), CONSTANT[name])
    recipe = RECIPES[name]
    return looyenga(
        [(1 - sum(recipe.values()), water(frequency_hz)), *((part, permittivity(other, frequency_hz)) for other, part in recipe.items())]
    )


def skin(frequency_hz: np.ndarray | float) -> np.ndarray:
    """Compute the permittivity of dry human skin by the fit of S. Gabriel, R. Lau, C. Gabriel, Phys. Med. Biol. 41 (1996) 2271.

    >>> complex(np.round(skin(60e9), 1))
    (8-10.9j)
    """
    omega = 2 * np.pi * np.asarray(frequency_hz, float)
    return 4.0 + 32.0 / (1 + 1j * omega * 7.234e-12) + 1100.0 / (1 + (1j * omega * 32.48e-9) ** 0.8)


def looyenga(phases: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Compute the permittivity of a mixture by Looyenga's law from a list of (volume fraction, permittivity)."""
    return sum((fraction * np.asarray(eps) ** (1 / 3) for fraction, eps in phases), np.zeros((), complex)) ** 3


def water(frequency_hz: np.ndarray | float) -> np.ndarray:
    """Compute the complex relative permittivity of pure water at 20 C, eta' - j eta'', up to 1 THz.

    Raises:
        MaterialError: a frequency is above 1 THz.

    >>> complex(np.round(water(77e9), 1))
    (8.8-15.9j)
    """
    f = _gigahertz("water", frequency_hz)
    theta = 300.0 / (273.15 + 20.0)
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
    turns = 2 * np.pi * _gigahertz("ethanol", frequency_hz) * 1e-3  # omega times a picosecond
    steps = ((24.35, 4.15, 161.0), (4.15, 2.72, 3.3), (2.72, 1.93, 0.22))
    return 1.93 + sum(((high - low) / (1 + 1j * turns * delay) for high, low, delay in steps), np.zeros((), complex))


def _gigahertz(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    f = np.asarray(frequency_hz, float) / 1e9
    if not (f.min() >= 0 and f.max() <= 1000):
        raise MaterialError(
            f"material {name!r} has a model up to 1000 GHz, not at {float(f.max()):g} GHz; choose another material or frequency"
        )
    return f
