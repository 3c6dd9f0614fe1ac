"""Compute the electromagnetics of surfaces: permittivity, reflection and transmission of layers, roughness.

A material is a plain name (a half-space), a name with factors (see `permittivity_by_name`) or a `Layered` stack. This package does not
import `radartwin.scene`.
"""

from radartwin.materials.layers import Layered, reflection, transmission
from radartwin.materials.permittivity_by_name import MATERIAL_NAMES, MATERIAL_THICKNESS, check_name, permittivity, varied
from radartwin.materials.roughness import roughness_m

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
