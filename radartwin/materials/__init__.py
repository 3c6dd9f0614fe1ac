"""Electromagnetics of surfaces: permittivity, layered reflection, roughness. Knows no scene.

A material is a plain name (a half-space; a name in MATERIAL_THICKNESS would be a slab), a name with factors (`varied`) or a `Layered`
stack.
"""

import difflib

import numpy as np
from numpy.typing import NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import MaterialError
from radartwin.materials import itu, liquids, plastics
from radartwin.materials.layers import Layered, stack_reflection, stack_transmission
from radartwin.materials.roughness import ament, ament_transmitted, roughness_m
from radartwin.materials.varied import split, varied

__all__ = [
    "MATERIAL_NAMES",
    "MATERIAL_THICKNESS",
    "Layered",
    "check_name",
    "permittivity",
    "reflection",
    "roughness_m",
    "transmission",
    "varied",
]

MATERIAL_NAMES = tuple(sorted({*itu.P2040, *plastics.PERMITTIVITY, *liquids.NAMES}))

# Plain names that stand for a slab of a given thickness (metres) rather than a half-space: none.
MATERIAL_THICKNESS: dict[str, float] = {}


def check_name(name: str) -> None:
    """Raise MaterialError, with the nearest known names, unless `name` is a material."""
    if split(name)[0] not in MATERIAL_NAMES:
        near = difflib.get_close_matches(str(name), MATERIAL_NAMES, 2)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(MATERIAL_NAMES)}"
        raise MaterialError(f"unknown material {name!r}; {hint}")


def permittivity(name: str, frequency_hz: np.ndarray | float) -> NDArray[np.complex128]:
    """Complex relative permittivity eta' - j eta'' of a named material, shape of `frequency_hz`."""
    check_name(name)
    name, real, loss = split(name)
    if real != 1 or loss != 1:
        eta = permittivity(name, frequency_hz)
        return real * eta.real + 1j * loss * eta.imag
    if name in liquids.NAMES:
        return liquids.permittivity(name, frequency_hz)
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
        loss = ament(roughness_m, cos_incidence, 2 * np.pi * frequency_hz / SPEED_OF_LIGHT)
        te, tm = te * loss, tm * loss
    return te, tm


def transmission(
    material: "str | Layered", cos_incidence: np.ndarray, frequency_hz: np.ndarray, roughness_m: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Complex (te, tm) that a shell between air and air lets through once, under exp(+j omega t): field behind over field before it.

    The fields are taken where the ray enters and straight behind that point along the normal, so a wall of thickness d adds the phase of
    the coefficient and takes k d cos_incidence off the path that is counted as air.

    Args:
        material: a stack, of which only the layers count (what backs it is air here), or a plain name: a half-space, through which nothing
            comes, except air and vacuum.
        cos_incidence, frequency_hz: as for `reflection`.
        roughness_m: rms height of each of its two faces, taken as independent; see `roughness.ament_transmitted`.
    Returns:
        (te, tm), complex, of the broadcast shape; at normal incidence they are equal.
    Raises:
        MaterialError: unknown material, or one without values at these frequencies.

    >>> te, tm = transmission(Layered([("pet", 0.5e-3)]), np.array(1.0), np.array(77e9))
    >>> bool(np.isclose(te, tm)), float(np.round(20 * np.log10(abs(te)), 1))
    (True, -1.2)
    """
    frequency_hz, cos_incidence = np.asarray(frequency_hz, float), np.asarray(cos_incidence, float)
    shape = np.broadcast_shapes(cos_incidence.shape, frequency_hz.shape)
    stack = material if isinstance(material, Layered) else Layered([], backing=material)
    if not isinstance(material, Layered) and material not in plastics.EMPTY:
        permittivity(material, frequency_hz)  # refuses what `reflection` refuses
        return np.zeros(shape, complex), np.zeros(shape, complex)
    eta = [permittivity(name, frequency_hz) for name, _ in stack.layers]
    te, tm = stack_transmission(eta, [thickness for _, thickness in stack.layers], cos_incidence, frequency_hz)
    if roughness_m and stack.layers:
        wavenumber = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
        for face in (eta[0], eta[-1]):
            loss = ament_transmitted(roughness_m, cos_incidence, wavenumber, face)
            te, tm = te * loss, tm * loss
    return te, tm
