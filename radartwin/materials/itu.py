"""Building materials of ITU-R P.2040-4: real permittivity and conductivity against frequency.

Symbols: eta' = a f^b -> real permittivity, sigma = c f^d -> conductivity (S/m), f in GHz.
Ref: ITU-R P.2040-4, table 3 (fits to published measurements, each valid between two frequencies). A material outside its
fit is never extrapolated: it is refused, or evaluated through the stand-in named in STAND_INS, with a warning.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from radartwin.constants import VACUUM_PERMITTIVITY
from radartwin.errors import MaterialError


@dataclass(frozen=True)
class Fit:
    """One row of the table: coefficients and the range they were fitted in (GHz)."""

    a: float
    b: float
    c: float
    d: float
    low_ghz: float
    high_ghz: float


P2040 = {
    "concrete": Fit(5.24, 0, 0.0462, 0.7822, 1, 100),
    "brick": Fit(3.91, 0, 0.0238, 0.16, 1, 40),
    "plasterboard": Fit(2.73, 0, 0.0085, 0.9395, 1, 100),
    "wood": Fit(1.99, 0, 0.0047, 1.0718, 0.001, 100),
    "glass": Fit(6.31, 0, 0.0036, 1.3394, 0.1, 100),
    "ceiling_board": Fit(1.48, 0, 0.0011, 1.0750, 1, 100),
    "chipboard": Fit(2.58, 0, 0.0217, 0.7800, 1, 100),
    "plywood": Fit(2.71, 0, 0.33, 0, 1, 40),
    "marble": Fit(7.074, 0, 0.0055, 0.9262, 1, 60),
    "floorboard": Fit(3.66, 0, 0.0044, 1.3515, 50, 100),
    "metal": Fit(1.0, 0, 1e7, 0, 1, 100),
}

# The closest row whose fit reaches 77 GHz, by normal-incidence reflection at the top of the material's own range:
# brick and plywood have no low-loss neighbour nearer than chipboard (eta' 2.58), marble is nearest to glass (6.31).
STAND_INS = {"brick": "concrete", "plywood": "chipboard", "marble": "glass"}


def permittivity(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Complex relative permittivity eta' - j eta'' (time convention exp(+j omega t)).

    Args:
        name: a row of P2040.
        frequency_hz: shape (...,).
    Returns:
        complex, shape (...,).
    Raises:
        MaterialError: unknown name, or a frequency outside every fit that could stand in.
    Warns:
        UserWarning: a stand-in is taken, naming both materials.

    >>> complex(np.round(permittivity("glass", 77e9), 3))
    (6.31-0.283j)
    """
    frequency_ghz = np.asarray(frequency_hz, float) / 1e9
    if name not in P2040:
        raise MaterialError(f"unknown material {name!r}; known: {', '.join(sorted(P2040))}")
    fit = P2040[name]
    low, high = float(frequency_ghz.min()), float(frequency_ghz.max())
    if not (fit.low_ghz <= low and high <= fit.high_ghz):
        stand_in = STAND_INS.get(name)
        if stand_in is None or not (P2040[stand_in].low_ghz <= low and high <= P2040[stand_in].high_ghz):
            raise MaterialError(
                f"material {name!r} is fitted from {fit.low_ghz:g} to {fit.high_ghz:g} GHz in ITU-R P.2040-4 and has no "
                f"stand-in at {low:g} to {high:g} GHz; give Layered with a material that has values there"
            )
        warnings.warn(
            f"material {name!r} is fitted only up to {fit.high_ghz:g} GHz in ITU-R P.2040-4; at {high:.4g} GHz "
            f"{stand_in!r} stands in for it",
            stacklevel=2,
        )
        fit = P2040[stand_in]
    real = fit.a * frequency_ghz**fit.b
    conductivity = fit.c * frequency_ghz**fit.d
    return real - 1j * conductivity / (2 * np.pi * frequency_ghz * 1e9 * VACUUM_PERMITTIVITY)
