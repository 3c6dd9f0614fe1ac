"""Compute the electromagnetic properties of surfaces: permittivity, reflection and transmission of layers, and roughness loss.

A material is given by its name, which means a half-space of the material, by a name with factors on the permittivity (see
`permittivity_by_name`), or by a `Layered` stack. This package does not import `radartwin.scene`.
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
