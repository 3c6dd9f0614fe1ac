"""Electromagnetics of surfaces: permittivity, layered reflection, roughness. Knows no scene.

A material is a plain name (a half-space; a name in MATERIAL_THICKNESS would be a slab) or a `Layered` stack.
"""

import difflib

import numpy as np

from radartwin.errors import MaterialError
from radartwin.materials import itu, liquids, plastics
from radartwin.materials.layers import Layered, stack_reflection
from radartwin.materials.roughness import ament

__all__ = [
    "MATERIAL_NAMES",
    "MATERIAL_THICKNESS",
    "Layered",
    "check_name",
    "permittivity",
    "reflection",
]

MATERIAL_NAMES = tuple(sorted({*itu.P2040, *plastics.PERMITTIVITY, "water"}))

# Plain names that stand for a slab of a given thickness (metres) rather than a half-space: none.
MATERIAL_THICKNESS: dict[str, float] = {}


def check_name(name: str) -> None:
    """Raise MaterialError, with the nearest known names, unless `name` is a material."""
    if name not in MATERIAL_NAMES:
        near = difflib.get_close_matches(str(name), MATERIAL_NAMES, 2)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(MATERIAL_NAMES)}"
        raise MaterialError(f"unknown material {name!r}; {hint}")


def permittivity(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Complex relative permittivity eta' - j eta'' of a named material, shape of `frequency_hz`."""
    check_name(name)
    if name == "water":
        return liquids.water(frequency_hz)
    if name in plastics.PERMITTIVITY:
        return plastics.permittivity(name, frequency_hz)
    return itu.permittivity(name, frequency_hz)


def reflection(
    material: "str | Layered", cos_incidence: np.ndarray, frequency_hz: np.ndarray, roughness_m: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Complex (te, tm) reflection seen from air, under exp(+j omega t).

    Args:
        material: a name (half-space) or a stack.
        cos_incidence: cosine of the angle from the normal, broadcastable with `frequency_hz`.
        frequency_hz: frequencies at which the materials are evaluated.
        roughness_m: rms height; multiplies both by the Ament factor.
    Raises:
        MaterialError: unknown material, or one without values at these frequencies.
    """
    stack = material if isinstance(material, Layered) else Layered([], backing=material)
    frequency_hz = np.asarray(frequency_hz, float)
    te, tm = stack_reflection(
        [permittivity(name, frequency_hz) for name, _ in stack.layers],
        [thickness for _, thickness in stack.layers],
        permittivity(stack.backing, frequency_hz),
        cos_incidence,
        frequency_hz,
    )
    if roughness_m:
        loss = ament(roughness_m, cos_incidence, 2 * np.pi * frequency_hz / 299_792_458.0)
        te, tm = te * loss, tm * loss
    return te, tm
