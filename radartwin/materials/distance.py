"""How far apart two materials are for the radar: the mean difference of their reflection in decibels over incidence.

    L(theta) = 10 log10 mean over the sweep of (|te|^2 + |tm|^2)/2          reflectivity, not below FLOOR_DB
    d(A, B)  = mean over theta = 0, 2, ..., 80 degrees of |L_A - L_B|

The field is unpolarised (what a room's tilted surfaces present on average), the power is averaged over the sweep of the default radar,
77 to 80.4 GHz, since one echo takes in all of it: single frequencies see the interference of a wall a millimetre thinner. Roughness is
left out: it moves power from the mirror direction into others, it does not take it away. d is a metric up to materials that reflect alike.
"""

from __future__ import annotations

import numpy as np

from radartwin.materials import Layered, permittivity, reflection
from radartwin.materials.itu import P2040
from radartwin.materials.layers import stack_reflection
from radartwin.materials.varied import split

INCIDENCE_DEG = np.arange(0.0, 81.0, 2.0)
SWEEP_HZ = np.linspace(77e9, 80.44e9, 33)
FLOOR_DB = -40.0  # below this a surface counts as not there: some 30 dB under plaster, the room's own diffuse level


def reflectivity_db(
    material: str | Layered, frequency_hz: np.ndarray | float = SWEEP_HZ, incidence_deg: np.ndarray = INCIDENCE_DEG
) -> np.ndarray:
    """Unpolarised reflectivity averaged over the frequencies, dB, one per angle, shape of `incidence_deg`, at least FLOOR_DB.

    Raises:
        MaterialError: unknown material, or one without values at these frequencies.

    >>> float(np.round(reflectivity_db("metal", 77e9, np.array([0.0]))[0], 1) + 0)
    0.0
    """
    cosine, frequency = _grid(frequency_hz, incidence_deg)
    return _level(*reflection(material, cosine, frequency))


def distance_db(first: str | Layered, second: str | Layered, frequency_hz: np.ndarray | float = SWEEP_HZ) -> float:
    """Electromagnetic distance of two materials, dB: see the module.

    >>> distance_db("glass", "glass")
    0.0
    """
    return float(np.mean(np.abs(reflectivity_db(first, frequency_hz) - reflectivity_db(second, frequency_hz))))


def closest(permittivity_there: complex, among: tuple[str, ...], frequency_hz: np.ndarray | float = SWEEP_HZ) -> tuple[str, float]:
    """The material whose half-space reflects most like one of a given permittivity, and their distance in dB.

    Args:
        permittivity_there: eta' - j eta'', constant over the frequencies.
        among: names of materials; the first of equals is taken.
    """
    cosine, frequency = _grid(frequency_hz, INCIDENCE_DEG)
    wanted = _level(*stack_reflection([], [], np.full(frequency.shape, permittivity_there), cosine, frequency))
    distances = {name: float(np.mean(np.abs(reflectivity_db(name, frequency_hz) - wanted))) for name in among}
    best = min(distances, key=lambda name: distances[name])
    return best, distances[best]


def in_range(name: str, frequency_hz: float = 77e9) -> bool:
    """Whether a plain material has values of its own at a frequency, without a stand-in."""
    base = split(name)[0]
    if base in P2040:
        return any(fit.low_ghz * 1e9 <= frequency_hz <= fit.high_ghz * 1e9 for fit in P2040[base])
    permittivity(name, frequency_hz)  # refuses what has no values there
    return True


def _grid(frequency_hz: np.ndarray | float, incidence_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.cos(np.radians(np.asarray(incidence_deg, float)))[:, None], np.atleast_1d(np.asarray(frequency_hz, float))[None]


def _level(te: np.ndarray, tm: np.ndarray) -> np.ndarray:
    power = ((np.abs(te) ** 2 + np.abs(tm) ** 2) / 2).mean(axis=-1)
    return np.maximum(10 * np.log10(np.maximum(power, 1e-30)), FLOOR_DB)
