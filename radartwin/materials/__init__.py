"""Compute the electromagnetic properties of surfaces: permittivity, reflection and transmission of layers, and roughness loss.

A material is given by its name, by a name with factors on the permittivity (see `permittivity_by_name`), or by a `Layered` stack. A name in
MATERIAL_THICKNESS means a sheet of this thickness in air (see `sheets`); any other name means a half-space. This package does not import
`radartwin.scene`.
"""

from radartwin.materials.layers import Layered, common_sheet, half_space, layered, reflection, transmission
from radartwin.materials.permittivity_by_name import MATERIAL_NAMES, check_name, permittivity, varied
from radartwin.materials.roughness import CORRELATION_M, correlation_m, roughness_m
from radartwin.materials.sheets import MATERIAL_THICKNESS

__all__ = [
    "CORRELATION_M",
    "MATERIAL_NAMES",
    "MATERIAL_THICKNESS",
    "Layered",
    "check_name",
    "common_sheet",
    "correlation_m",
    "half_space",
    "layered",
    "permittivity",
    "reflection",
    "roughness_m",
    "transmission",
    "varied",
]
