"""Map each of the 23 material categories of the MINC image data set to a material at 77 GHz, in the table `MINC`.

S. Bell, P. Upchurch, N. Snavely, K. Bala, Material Recognition in the Wild with the Materials in Context Database, CVPR 2015, define the
categories. The materials are those of ITU-R P.2040-4 and the plastics and liquids of this package. A category has either a half-space of a
material or a stack with the usual layers of such a surface (its build-up). The thicknesses of sheets come from the table `sheets.SHEETS`.
If several layer stacks are common for a category, the table contains the one that is nearest to the others (smallest `distance_db`). The
field `note` gives the distances in dB.

The package uses a P.2040 fit only inside its frequency range. The fits of concrete, plasterboard, wood, glass, ceiling board, chipboard and
metal include 1 to 100 GHz, and that of floorboard 50 to 100 GHz. The fits of brick, marble and carpet tile end at 40 to 60 GHz. The table
still names brick, marble and carpet tile, so that a radar at a lower frequency uses their own fits. At 77 GHz, `itu.STAND_INS` replaces
them by substitute materials, with a StandInWarning. Above 100 GHz, only materials with a second fit have values. Plastics and oil have
values from 10 to 100 GHz.
"""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.errors import MaterialError
from radartwin.materials.distance import in_range
from radartwin.materials.layers import Layered, common_sheet
from radartwin.materials.roughness import correlation_m, roughness_m


@dataclass(frozen=True)
class Row:
    """Describe the material of one MINC category."""

    material: str | Layered  # material name, for a half-space, or a stack of layers
    proxy: bool  # whether the material is a substitute at every frequency, because the package has no material for the category itself
    source: str  # source of the layers or of the permittivity
    note: str  # explanation of the remaining uncertainty
    texture: str  # class of `radartwin.materials.roughness.CLASSES` that defines the surface roughness
    # Whether common layer stacks of the category differ by more than 2.5 dB in `distance_db`. For example, the category does not determine
    # the wall under a paint or the thickness of a plastic.
    uncertain: bool = False

    @property
    def roughness_m(self) -> float:
        """Return the rms surface height in metres."""
        return roughness_m(self.texture)

    @property
    def correlation_m(self) -> float:
        """Correlation length of the surface height in metres."""
        return correlation_m(self.texture)

    def stand_in(self, exact: bool = False) -> bool:
        """Return whether the material is a substitute for the category's real material.

        The material is a substitute if `proxy` is true, if it has no fit at 77 GHz, or if the layer stack is uncertain. If the layer stack
        is known from another source (`exact`), the field `uncertain` has no effect.
        """
        return self.proxy or (self.uncertain and not exact) or not all(map(in_range, names_in(self.material)))


def names_in(material: str | Layered) -> tuple[str, ...]:
    """Return the names of all plain materials of a half-space or layer stack, from the outermost layer to the backing."""
    return (material,) if isinstance(material, str) else (*(name for name, _ in material.layers), material.backing)


_BOARD_ON_STUDS = common_sheet("stud wall")
_BUILDING = "building practice (EN 520 board of 12.5 mm, studs of 75 mm)"
# The usual layers of a surface for material labels that name a plain material instead of a MINC category.
BUILD_UPS: dict[str, Layered] = {
    "plasterboard": _BOARD_ON_STUDS,
    "ceiling_board": common_sheet("ceiling_board"),
    "chipboard": common_sheet("chipboard"),
    "floorboard": Layered([("floorboard", 0.008)], backing="concrete"),  # EN 13329 laminate on a slab
}
COVERED = ("painted", "wallpaper")  # categories that describe the finish of a wall, but not the layers below the finish
_ACCONEER = "60 GHz values of docs/pcr_tech/radar_principles, Acconeer (Clear BSD)"

MINC: dict[str, Row] = {
    "brick": Row("brick", False, "P.2040-4 brick, 1 to 40 GHz",
        "at 77 GHz floorboard stands in (0.6 dB at normal incidence from brick's fits interpolated)", "brick"),
    "carpet": Row("carpet_tile", False, "P.2040-4 carpet tile, 1 to 40 GHz",
        "at 77 GHz wood stands in; 3 to 10 mm on concrete lie 0.9 to 3.1 dB away; pile scatters most of it", "carpet"),
    "ceramic": Row(Layered([], backing="glass"), True, "porcelain 5.5 to 6.5 (data sheets of technical ceramics), glass 6.3",
        "sanitary ware, crockery: thick and lossy enough for a half-space; a mug's wall comes from the answer", "ceramic"),
    "fabric": Row(common_sheet("fabric"), True, f"textile 2.0, {_ACCONEER}; wood 1.99",
        "0.3 to 1 mm of cloth lie 2.7 dB away at most; foam behind it is air to the radar (1.05)", "fabric"),
    "foliage": Row(Layered([("detergent", 0.0003)]), True, "leaf: two thirds water, 0.2 to 0.4 mm (F. Ulaby, M. El-Rayes 1987)",
        "a single leaf; a crown is sparse and mostly scatters", "foliage"),
    "food": Row("dressing", True, "two thirds water; containers.RECIPES", "moist food; dry food is nearer wood", "food"),
    "glass": Row(common_sheet("glass"), False, "P.2040-4 glass, 0.1 to 100 GHz; a pane of 6 mm",
        "panes of 3 to 12 mm and double glazing lie 0.8 to 2.4 dB away, the half-space 0.9 dB", "glass"),
    "hair": Row("detergent", True, "skin of 6.6 - j 9.5 behind it (S. Gabriel et al. 1996, extrapolated to 77 GHz)",
        "hair is mostly air and hides little of the skin", "hair"),
    "leather": Row(Layered([], backing="plasterboard"), True, "hide dried to 12 to 15 % water: about 2.7; plasterboard 2.73",
        "0.9 to 2 mm on foam lie 1.6 to 8.0 dB away, and further from each other: half a wave inside is 1.2 mm", "leather"),
    "metal": Row("metal", False, "P.2040-4 metal, 1 to 100 GHz", "painted or not: paint of 0.1 mm changes nothing", "metal"),
    "mirror": Row(Layered([("glass", 0.004)], backing="metal"), False, "EN 1036: silvered float glass of 4 mm", "", "mirror"),
    "other": Row("concrete", True, "unknown material: the P.2040-4 row with the least mean distance to the categories of a room (2.5 dB)",
        "computed by the test of this row; people, plants, food, water and sky do not count", "painted"),
    "painted": Row(_BOARD_ON_STUDS, False, f"plasterboard wall, {_BUILDING}",
        "plaster on masonry lies 0.4 dB away, bare painted concrete 2.9 dB, ceiling board 5.7 dB: uncertain unless named",
        "painted", True),
    "paper": Row(common_sheet("cardboard"), True,
        "corrugated board: two liners of 0.3 mm, 2.6 mm in all; cellulose 2.6 like chipboard",
        "up to 5 mm lie 2.4 to 5.4 dB away, a stack of paper or books 4.6 dB", "paper"),
    "plastic": Row(common_sheet("hdpe"), False, "polyolefins 2.2 to 2.3 (J. Lamb 1996); housings of 2 mm",
        "1 to 5 mm lie 2 to 5 dB away, ABS of 3 mm 2.7 dB: a wall thickness in the answer counts", "plastic", True),
    "polishedstone": Row("marble", False, "P.2040-4 marble, 1 to 60 GHz", "at 77 GHz glass stands in", "polishedstone"),
    "skin": Row("detergent", True, "6.6 - j 9.5 at 77 GHz, dry skin (S. Gabriel et al. 1996, extrapolated)",
        "the mixture of liquids nearest to it: 7.1 - j 9.0", "skin"),
    "sky": Row(common_sheet("glass"), True, "indoors, sky in a scan is a window pane", "as glass", "glass"),
    "stone": Row("concrete", True, "granite 5 to 6, limestone 7, sandstone 4 to 5; concrete 5.2", "rough-hewn", "stone"),
    "tile": Row(Layered([("glass", 0.008)], backing="concrete"), True, "fired clay 5 to 6.5 of 8 mm (EN 14411) on a slab; glass 6.3",
        "on plasterboard 0.2 dB away", "tile"),
    "wallpaper": Row(_BOARD_ON_STUDS, False, f"plasterboard wall, {_BUILDING}", "0.2 mm of paper (2.6) on board (2.7) is left out",
        "wallpaper", True),
    "water": Row("water", False, "H. Liebe et al. 1991", "", "water"),
    "wood": Row(common_sheet("wood"), False, "P.2040-4 wood, to 100 GHz; boards of 20 mm",
        "18 to 40 mm lie 0.2 dB away, chipboard 2.1 dB, 8 mm floorboard on concrete 4.1 dB", "wood"),
}  # fmt: skip

CATEGORIES = tuple(MINC)


def row(category: str) -> Row:
    """Return the row of the table `MINC` for a category.

    Raises:
        MaterialError: the name is not one of the 23 categories; `radartwin.materials.names.resolve` accepts other names.
    """
    if category not in MINC:
        raise MaterialError(f"{category!r} is not a MINC category; choose from {', '.join(CATEGORIES)}")
    return MINC[category]
