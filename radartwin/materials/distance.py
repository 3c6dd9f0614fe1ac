"""Compute the electromagnetic distance d of two materials: the mean difference of their reflectivity L over incidence angles, in dB.

    L(theta) = 10 log10 mean over the sweep of (|te|^2 + |tm|^2)/2          reflectivity, limited to FLOOR_DB from below
    d(A, B)  = mean over theta = 0, 2, ..., 80 degrees of |L_A - L_B|

Here te and tm are the reflection coefficients at the angle of incidence theta. The definition assumes an unpolarised field, because the
surfaces of a room have all orientations. The definition averages the power over the frequency sweep of the default radar, 77 to 80.4 GHz,
because an echo contains the whole sweep. At a single frequency, the interference of the reflections from both faces of a wall would change
if the wall thickness changed by a millimetre. The distance does not include roughness, because roughness redistributes power and does not
absorb it. The distance d is a metric, except that d is also 0 between different materials of equal reflectivity.

The distance of two roughnesses compares the share of the reflected power that is diffuse at normal incidence, 1 - exp(-(2 k h)^2) for the
rms height h and the wavenumber k at the middle of the sweep (Ament's factor, `radartwin.materials.roughness`).
"""

from __future__ import annotations

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials.itu import P2040
from radartwin.materials.layers import Layered, reflection, stack_coefficients
from radartwin.materials.permittivity_by_name import permittivity, split

INCIDENCE_DEG = np.arange(0.0, 81.0, 2.0)
SWEEP_HZ = np.linspace(77e9, 80.44e9, 33)
# Lower limit of the reflectivity in dB. The limit, like the level of the diffuse echoes of a room, is about 30 dB below the reflectivity of
# plaster.
FLOOR_DB = -40.0
SMOOTHEST_M = 2e-6  # rms height of a glazed or polished face; a face of lower rms height has no measurable diffuse echo


def reflectivity_db(
    material: str | Layered, frequency_hz: np.ndarray | float = SWEEP_HZ, incidence_deg: np.ndarray = INCIDENCE_DEG
) -> np.ndarray:
    """Compute the reflectivity of a material for an unpolarised field in dB, averaged over the frequencies and at least FLOOR_DB.

    The result has the shape of `incidence_deg`.

    Raises:
        MaterialError: unknown material, or a material without values at these frequencies.

    >>> float(np.round(reflectivity_db("metal", 77e9, np.array([0.0]))[0], 1) + 0)
    0.0
    """
    cosine, frequency = _grid(frequency_hz, incidence_deg)
    return _level(*reflection(material, cosine, frequency))


def distance_db(first: str | Layered, second: str | Layered, frequency_hz: np.ndarray | float = SWEEP_HZ) -> float:
    """Compute the electromagnetic distance of two materials in dB, as defined at the top of this module.

    >>> distance_db("glass", "glass")
    0.0
    """
    return float(np.mean(np.abs(reflectivity_db(first, frequency_hz) - reflectivity_db(second, frequency_hz))))


def closest(target: complex, among: tuple[str, ...], frequency_hz: np.ndarray | float = SWEEP_HZ) -> tuple[str, float]:
    """Find the material whose half-space reflects most like a half-space of a given permittivity.

    Args:
        target: permittivity eta' - j eta'' of the half-space to match, constant over the frequencies.
        among: names of candidate materials. If several candidates are equally close, the function returns the first of them.
        frequency_hz: frequencies in Hz over which the reflectivity is averaged.
    Returns:
        name: the closest material.
        distance: its electromagnetic distance from the half-space of permittivity `target`, dB.
    """
    cosine, frequency = _grid(frequency_hz, INCIDENCE_DEG)
    te, tm, *_ = stack_coefficients([], [], np.full(frequency.shape, target), cosine, frequency)
    level = _level(te, tm)
    half_spaces = {name: Layered([], backing=name) for name in among}
    distances = {name: float(np.mean(np.abs(reflectivity_db(half, frequency_hz) - level))) for name, half in half_spaces.items()}
    best = min(distances, key=lambda name: distances[name])
    return best, distances[best]


def in_range(name: str, frequency_hz: float = 77e9) -> bool:
    """Return whether a plain material has permittivity values of its own at a frequency, so that no substitute material replaces it.

    Raises:
        MaterialError: the material is a plastic or liquid without values at this frequency.
    """
    base = split(name)[0]
    if base in P2040:
        return any(fit.low_ghz * 1e9 <= frequency_hz <= fit.high_ghz * 1e9 for fit in P2040[base])
    permittivity(name, frequency_hz)
    return True


def _grid(frequency_hz: np.ndarray | float, incidence_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.cos(np.radians(np.asarray(incidence_deg, float)))[:, None], np.atleast_1d(np.asarray(frequency_hz, float))[None]


def _level(te: np.ndarray, tm: np.ndarray) -> np.ndarray:
    power = ((np.abs(te) ** 2 + np.abs(tm) ** 2) / 2).mean(axis=-1)
    return np.maximum(10 * np.log10(np.maximum(power, 1e-30)), FLOOR_DB)


def diffuse_distance_db(first_m: float, second_m: float) -> float:
    """Compute the distance in dB of two rms heights in metres: the magnitude of the ratio, in dB, of their diffuse power shares.

    >>> round(diffuse_distance_db(0.3e-3, 0.05e-3), 1)
    13.7
    >>> diffuse_distance_db(0.0, 2e-6)
    0.0
    """
    wavenumber = 2 * np.pi * float(SWEEP_HZ.mean()) / SPEED_OF_LIGHT
    one, two = (-np.expm1(-((2 * wavenumber * max(height, SMOOTHEST_M)) ** 2)) for height in (first_m, second_m))
    return float(abs(10 * np.log10(one / two)))
