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

from collections.abc import Sequence

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials.itu import P2040
from radartwin.materials.layers import Layered, reflection, stack_coefficients
from radartwin.materials.permittivity_by_name import split

INCIDENCE_DEG = np.arange(0.0, 81.0, 2.0)
COSINES = np.cos(np.radians(INCIDENCE_DEG))[:, None]
SWEEP_HZ = np.linspace(77e9, 80.44e9, 33)
# Lower limit of the reflectivity in dB. The limit, like the level of the diffuse echoes of a room, is about 30 dB below the reflectivity of
# plaster.
FLOOR_DB = -40.0
SMOOTHEST_M = 2e-6  # rms height of a glazed or polished face; a face of lower rms height has no measurable diffuse echo


def reflectivity_db(material: str | Layered) -> np.ndarray:
    """Compute the reflectivity of a material for an unpolarised field in dB at the angles INCIDENCE_DEG, at least FLOOR_DB.

    Raises:
        MaterialError: unknown material, or a material without values at these frequencies.

    >>> float(np.round(reflectivity_db("metal")[0], 1) + 0)
    0.0
    """
    return _level(*reflection(material, COSINES, SWEEP_HZ))


def distance_db(first: str | Layered, second: str | Layered) -> float:
    """Compute the electromagnetic distance of two materials in dB, as defined at the top of this module.

    >>> distance_db("glass", "glass")
    0.0
    """
    return float(np.mean(np.abs(reflectivity_db(first) - reflectivity_db(second))))


def closest(target: complex, among: Sequence[str]) -> str:
    """Return the name in `among` whose half-space reflects most like a half-space of the permittivity `target` = eta' - j eta''.

    If several materials are equally close, the function returns the first of them.
    """
    te, tm, *_ = stack_coefficients([], [], np.full(SWEEP_HZ.shape, target), COSINES, SWEEP_HZ)
    level = _level(te, tm)
    return min(among, key=lambda name: float(np.mean(np.abs(reflectivity_db(Layered([], backing=name)) - level))))


def in_range(name: str) -> bool:
    """Return whether a plain material has permittivity values of its own at 77 GHz, so that no substitute material replaces it."""
    base = split(name)[0]
    return base not in P2040 or any(fit.low_ghz <= 77 <= fit.high_ghz for fit in P2040[base])


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
    first_share, second_share = (-np.expm1(-((2 * wavenumber * max(height, SMOOTHEST_M)) ** 2)) for height in (first_m, second_m))
    return float(abs(10 * np.log10(first_share / second_share)))
