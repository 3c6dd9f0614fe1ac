"""Compute the permittivity of building materials and ground from the fits of ITU-R P.2040-4.

The real part of the permittivity is eta' = a f^b, and the conductivity is sigma = c f^d in S/m, with the frequency f in GHz. The
coefficients are those of ITU-R P.2040-4 (09/2025), table 3, which contains fits to published measurements. Each fit is valid between two
frequencies. Where two fits of one material overlap, the module uses the fit that the table P2040 lists first. The module does not
extrapolate any fit. At a frequency outside the fits of a material, a substitute material of STAND_INS replaces this material, with a
warning. If a material has no substitute, the module raises MaterialError.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from radartwin.constants import VACUUM_PERMITTIVITY
from radartwin.errors import MaterialError


@dataclass(frozen=True)
class Fit:
    """Hold one fit of table 3 in ITU-R P.2040-4: the coefficients a, b, c, d and the frequency range of the fit in GHz."""

    a: float
    b: float
    c: float
    d: float
    low_ghz: float
    high_ghz: float


P2040 = {
    "concrete": (Fit(5.24, 0, 0.0462, 0.7822, 1, 100), Fit(5.17, 0, 0.0145, 1.09, 110, 330)),
    "brick": (Fit(3.91, 0, 0.0238, 0.16, 1, 40), Fit(4.15, 0, 0.0006, 1.5712, 110, 330)),
    "plasterboard": (
        Fit(2.73, 0, 0.0085, 0.9395, 1, 100), Fit(2.56, 0, 0.0001, 1.7799, 110, 330), Fit(2.65, 0, 0.0002, 1.598, 100, 400),
    ),
    "wood": (
        Fit(1.99, 0, 0.0047, 1.0718, 0.001, 100), Fit(1.82, 0, 0.0040, 1.0761, 110, 330), Fit(2.1183, 0, 0.0055, 1.1113, 100, 400),
    ),
    "glass": (
        Fit(6.31, 0, 0.0036, 1.3394, 0.1, 100), Fit(6.5767, 0, 0.0012, 1.4697, 100, 400), Fit(5.79, 0, 0.0004, 1.658, 220, 450),
    ),
    "clear_acrylic": (Fit(2.58, 0, 0.0001, 1.6524, 110, 330),),
    "ceiling_board": (
        Fit(1.48, 0, 0.0011, 1.0750, 1, 100), Fit(1.52, 0, 0.0029, 1.029, 220, 450), Fit(1.2567, 0, 0.00013, 1.454, 100, 400),
    ),
    "chipboard": (Fit(2.58, 0, 0.0217, 0.7800, 1, 100), Fit(2.16, 0, 0.0023, 1.359, 100, 200)),
    "plywood": (Fit(2.71, 0, 0.33, 0, 1, 40), Fit(1.94, 0, 0.0067, 0.9982, 110, 330), Fit(2.17, 0, 0.0063, 1.045, 100, 400)),
    "marble": (Fit(7.074, 0, 0.0055, 0.9262, 1, 60), Fit(7.94, 0, 0.0001, 1.7330, 110, 330), Fit(8.62, 0, 0.0027, 1.15, 100, 400)),
    "floorboard": (
        Fit(3.66, 0, 0.0044, 1.3515, 50, 100), Fit(5.27, 0, 2.22e-17, 7.3413, 220, 300), Fit(5.27, 0, 0.0003, 2.0298, 300, 400),
        Fit(5.27, 0, 49.8726, 0, 400, 450), Fit(3.1575, 0, 0.001675, 1.32775, 100, 400),
    ),
    "vinyl_tile": (Fit(3.62, 0, 0.0051, 0.8422, 1, 40),),
    "carpet_tile": (Fit(2.08, 0, 0.0009, 0.8200, 1, 40),),
    "asphalt_concrete": (Fit(4.83, 0, 0.0108, 1.3969, 1, 40),),
    "metal": (Fit(1.0, 0, 1e7, 0, 0, np.inf),),  # the table says 1 to 100 GHz, but a good conductor reflects at every frequency
    "very_dry_ground": (Fit(3.0, 0, 0.00015, 2.52, 1, 10),),
    "medium_dry_ground": (Fit(15.0, -0.1, 0.035, 1.63, 1, 10),),
    "wet_ground": (Fit(30.0, -0.4, 0.15, 1.30, 1, 10),),
}  # fmt: skip

# Substitute materials at 77 GHz. Each substitute has a fit at 77 GHz, and of all such materials, its reflection at normal incidence is
# closest to that of the replaced material. The reflection of the replaced material is computed at the highest frequency of its fit, or
# interpolated in log frequency between two fits below and above 77 GHz. The reflection of the substitute minus that of the replaced
# material in dB is: brick -0.6, clear acrylic 0.0 (the substitute has more loss), plywood 1.0, marble -0.8, vinyl tile 0.1, carpet tile
# -0.5, asphalt 0.3, very dry ground -0.7, medium dry ground 0.9, wet ground -0.1. The fits of ground end at 10 GHz, far below the
# relaxation frequency of water. Very dry ground is therefore compared with its substitute at 10 GHz. Medium dry and wet ground are compared
# at 77 GHz, as a mixture of grains (permittivity 3.0) with 15 and 30 % water by volume. Averaging the refractive indices gives the
# permittivities 4.0 - j 1.3 and 4.9 - j 3.0 of these mixtures. At 62 GHz, the same substitutes are the closest, and their reflection
# differs from that of the replaced materials by at most 0.8 dB. The substitutes of medium dry and wet ground were not compared at 62 GHz.
STAND_INS = {
    "brick": "floorboard",
    "clear_acrylic": "chipboard",
    "plywood": "chipboard",
    "marble": "glass",
    "vinyl_tile": "floorboard",
    "carpet_tile": "wood",
    "asphalt_concrete": "concrete",
    "very_dry_ground": "plasterboard",
    "medium_dry_ground": "concrete",
    "wet_ground": "glass",
}

_warned: set[tuple[str, str]] = set()


class StandInWarning(UserWarning):
    """Warn that a substitute replaces a material because no fit of the material includes the frequency."""


def permittivity(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Compute the complex relative permittivity eta' - j eta'' of a material (time convention exp(+j omega t)).

    Args:
        name: material name, a key of P2040.
        frequency_hz: frequencies (...,) in Hz.
    Returns:
        Complex relative permittivity (...,).
    Raises:
        MaterialError: the name is unknown, or neither the material nor its substitute has a fit at a frequency.
    Warns:
        StandInWarning: a substitute replaces the material. The warning appears once per material and process, unless a warning filter
            requests every warning.

    >>> complex(np.round(permittivity("glass", 77e9), 3))
    (6.31-0.283j)
    """
    frequency_ghz = np.asarray(frequency_hz, float) / 1e9
    if name not in P2040:
        raise MaterialError(f"unknown material {name!r}; known: {', '.join(sorted(P2040))}")
    fit = _fit(name, frequency_ghz)
    if fit is None:
        stand_in = STAND_INS.get(name)
        fit = None if stand_in is None else _fit(stand_in, frequency_ghz)
        if fit is None or stand_in is None:
            low, high = float(frequency_ghz.min()), float(frequency_ghz.max())
            raise MaterialError(
                f"material {name!r} is fitted {_ranges(name)} in ITU-R P.2040-4 and has no substitute at {low:g} to {high:g} GHz; "
                "choose a material with values there"
            )
        _warn(name, stand_in)
    real = fit.a * frequency_ghz**fit.b
    conductivity = fit.c * frequency_ghz**fit.d
    return real - 1j * conductivity / (2 * np.pi * frequency_ghz * 1e9 * VACUUM_PERMITTIVITY)


def _fit(name: str, frequency_ghz: np.ndarray) -> Fit | None:
    """Return the first fit of a material in the table P2040 that is valid at all given frequencies, or None if no fit is valid."""
    low, high = float(frequency_ghz.min()), float(frequency_ghz.max())
    return next((fit for fit in P2040[name] if fit.low_ghz <= low and high <= fit.high_ghz), None)


def _ranges(name: str) -> str:
    return " and ".join(f"from {fit.low_ghz:g} to {fit.high_ghz:g} GHz" for fit in P2040[name])


def _warn(name: str, stand_in: str) -> None:
    """Warn that `stand_in` replaces the material `name`, once per process."""
    action = next(
        (
            action
            for action, message, category, module, _ in warnings.filters
            if not message and not module and issubclass(StandInWarning, category)
        ),
        "default",
    )
    if (name, stand_in) in _warned and action not in ("always", "all", "error"):
        return
    _warned.add((name, stand_in))
    text = f"material {name!r} is fitted only {_ranges(name)} in ITU-R P.2040-4; outside this range {stand_in!r} replaces it"
    warnings.warn(text, StandInWarning, stacklevel=3)
