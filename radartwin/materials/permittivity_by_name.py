"""Compute the permittivity of a named material: P.2040 materials, plastics and liquids, each with optional factors (see `varied`)."""

import difflib

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import MaterialError
from radartwin.materials import itu, liquids, plastics
from radartwin.materials.varied import split

MATERIAL_NAMES = tuple(sorted({*itu.P2040, *plastics.PERMITTIVITY, *liquids.NAMES}))

# Thickness in metres of each plain name that means a slab instead of a half-space; empty, because every plain name is a half-space.
MATERIAL_THICKNESS: dict[str, float] = {}


def check_name(name: str) -> None:
    """Raise MaterialError, with the most similar known names, unless `name` is a material."""
    if split(name)[0] not in MATERIAL_NAMES:
        near = difflib.get_close_matches(str(name), MATERIAL_NAMES, 2)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(MATERIAL_NAMES)}"
        raise MaterialError(f"unknown material {name!r}; {hint}")


def permittivity(name: str, frequency_hz: np.ndarray | float) -> NDArray[np.complex128]:
    """Compute the complex relative permittivity eta' - j eta'' of a named material, shape of `frequency_hz`."""
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
