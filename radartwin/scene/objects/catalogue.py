"""Define the twelve catalogue objects of the recognition study: shape, size, materials, class labels and the sources of the dimensions.

Objects stand on z = 0. The vertical axis of each object is the z axis, which is also the axis of the turntable. In the first turntable
frame, the side +x of an object faces the radar. The opening of the corner reflector and the handle of the mug point to +x, and the narrow
side of a bottle lies along y. `aim_m` is the height at which a level radar aims: half the height of the object, or the apex of the
reflector.

Can sizes are trade sizes of the Can Manufacturers Institute: outer diameter x height, measured at the rim seams, in inches and sixteenths
(211 is 2 11/16 inches, 68.3 mm). All six cans have the diameter 211 and differ mainly in height. The wall of the two drink cans has a
diameter of 66 mm. Bottles are filled completely, without air below the cap, and have a separate cap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import trimesh

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import SceneError
from radartwin.materials import Layered, correlation_m, half_space, roughness_m
from radartwin.scene import textures
from radartwin.scene.objects import shapes, vessels
from radartwin.scene.surface import Surface

ShapeClass = Literal["symmetric", "faceted", "asymmetric"]
MaterialClass = Literal["metal", "ceramic", "plastic"]

CAN_M = 0.0683  # outer diameter of can size 211: 2 11/16 inches
OUNCE_ML = 28.35  # volume of an avoirdupois ounce of water
CMI = "Can Manufacturers Institute, dimensional food can standards"
# No drawing or data sheet is public for these bottles. Height and cross-section are estimates; the inside volume is that printed on the
# bottle's label.
VOLUME = (
    "order of magnitude, no data sheet: ordinary retail proportions, sized so that the inside holds the label's volume; PET of 0.5 mm too"
)


class Part(NamedTuple):
    """Hold a closed part of an object: mesh, material, roughness class, and appearance (name of a texture in `textures.LOOKS`)."""

    mesh: trimesh.Trimesh
    material: str | Layered
    roughness: str
    look: str


@dataclass(frozen=True)
class Entry:
    """Describe an object of the catalogue.

    Attributes:
        name: identifier of the object, such as "can_355".
        label: everyday name of the object.
        size_m: width along x (with handle), depth along y, and height of the object in metres.
        wall_m: thickness of the object's wall in metres; 0 for the sheet metal of the corner reflector.
        material: name of the material of the object's wall.
        contents: name of the material inside the object, or None for air.
        shape, material_class: the object's shape class and material class, the class labels of the recognition study.
        minc: category of the wall material in the MINC data set of material photographs.
        volume_ml: inside volume in millilitres, for a can up to the brim, for a bottle as on its label; None if no source states it.
        description: description of what the object looks like, from which a text encoder computes a text embedding of the class.
        source: publication or standard from which the dimensions come.
        build: function that returns the parts of the object, given its contents ("air" if the object is empty).
        aim_m: height in metres above the object's base at which a level radar aims.
        rover: whether the rover experiments use the object.
        outline_m: outline of a body of revolution about the z axis; None for other objects.
        radar_description: description of the object's radar echo on a turntable, for a second text embedding of the class. The description
            follows from shape and material: a cylinder's echo is constant and grows with its length, a flat side flashes when it faces the
            radar, and plastic with oil reflects less than plastic with water. The description was written without any simulated or measured
            recording.
    """

    name: str
    label: str
    size_m: tuple[float, float, float]
    wall_m: float
    material: str
    contents: str | None
    shape: ShapeClass
    material_class: MaterialClass
    minc: str
    volume_ml: float | None
    description: str
    source: str
    build: Callable[[str], tuple[Part, ...]]
    aim_m: float
    rover: bool = True
    outline_m: vessels.Outline | None = None
    radar_description: str = ""

    @property
    def symmetric(self) -> bool:
        return self.shape == "symmetric"

    def surfaces(self, pose: np.ndarray | None = None, *, name: str | None = None, contents: str = "filled") -> tuple[Surface, ...]:
        """Build the parts of the object as surfaces with the same name, so that all parts move together.

        Args:
            pose: (4, 4) object-to-world pose; by default the parts stay in the object's own frame.
            name: name of the surfaces; by default the name of the catalogue object.
            contents: "filled" builds the walls and contents of the catalogue. With "unknown", every part is a half-space of its outermost
                material, for a simulation that does not know what is behind the surface.
        """
        parts = self.build(self.contents or "air")
        provenance = {"source": "true", "confidence": 1.0, "stand_in": self.material == "glass", "minc": self.minc, "object": self.name}
        out = []
        for part in parts:
            mesh = textures.textured(part.mesh, part.look)
            height, length = roughness_m(part.roughness), correlation_m(part.roughness)
            material = half_space(part.material) if contents == "unknown" else part.material
            surface = Surface(mesh, material, name or self.name, height, "object", provenance, length)
            out.append(surface if pose is None else surface.moved(pose))
        return tuple(out)


def can(outline_m: vessels.Outline, look: str) -> Callable[[str], tuple[Part, ...]]:
    """Return the function that builds a can."""
    return lambda contents: (Part(shapes.revolution(outline_m, vessels.AROUND), "metal", "metal", look),)  # sheet metal is opaque


def _food_can(size: str, height_m: float, water_oz: float, use: str, look: str, text: str, radar: str, rover: bool = True) -> Entry:
    outline_m = vessels.food_can(CAN_M, height_m)
    return Entry(
        f"can_{size}", use, (CAN_M, CAN_M, height_m), 0.0002, "metal", None, "symmetric", "metal", "metal", OUNCE_ML * water_oz, text,
        f"{CMI}: {size.replace('_', ' x ')}, {water_oz} ounces of water; tinplate of 0.2 mm, seams 1.2 mm proud",
        can(outline_m, look), height_m / 2, rover, outline_m, radar,
    )  # fmt: skip


def _drink_can(name: str, label: str, height_m: float, volume_ml: float, look: str, text: str, radar: str, source: str) -> Entry:
    outline_m = vessels.drink_can(0.0661, height_m)
    return Entry(
        name, label, (0.0661, 0.0661, height_m), 0.0001, "metal", None, "symmetric", "metal", "metal", volume_ml, text, source,
        can(outline_m, look), height_m / 2, outline_m=outline_m, radar_description=radar,
    )  # fmt: skip


def bottle(
    sections_m: tuple[tuple[float, float, float, float], ...],
    plastic: str,
    wall_m: float,
    look: str,
    cap: tuple[float, float],
    cap_look: str,
) -> Callable[[str], tuple[Part, ...]]:
    """Return the function that builds a bottle: a lofted body with a cap of size `cap` (radius, height) a millimetre above it."""

    def build(contents: str) -> tuple[Part, ...]:
        radius, height = cap
        lid = shapes.cylinder(radius, height, 96).apply_translation([0, 0, sections_m[-1][0] + 0.001 + height / 2])
        body = Part(vessels.oval(sections_m), Layered([(plastic, wall_m)], backing=contents), plastic, look)
        return body, Part(lid, Layered([], backing="hdpe"), "hdpe", cap_look)

    return build


def reflector(leg_m: float, name: str) -> Entry:
    """Return a triangular trihedral corner reflector with legs of length `leg_m` in metres."""

    def build(contents: str) -> tuple[Part, ...]:
        mesh = shapes.trihedral(leg_m)
        return (Part(mesh.apply_translation([0, 0, -mesh.bounds[0, 2]]), "metal", "metal", "brushed_metal"),)

    size = (round(leg_m / 3**0.5, 4), round(leg_m * 2**0.5, 4), round(leg_m * 1.5**0.5, 4))
    section = 4 * np.pi * leg_m**4 / (3 * (SPEED_OF_LIGHT / 77e9) ** 2)
    return Entry(
        name, "trihedral corner reflector", size, 0.0, "metal", None, "faceted", "metal", "metal", None,
        "a metal trihedral corner reflector: three flat right-angled triangular plates that meet in one corner and open to one side",
        f"chosen, not measured: a calibration target of {100 * leg_m:g} cm legs, {section:.1f} m^2 at 77 GHz by 4 pi L^4 / (3 lambda^2)",
        build, leg_m / 6**0.5,
        radar_description="one very strong broad lobe each turn from three metal plates that meet in a corner, almost no echo from behind",
    )  # fmt: skip


def mug(diameter_m: float, height_m: float, reach_m: float) -> Callable[[str], tuple[Part, ...]]:
    """Return the function that builds a mug with a handle; a `reach_m` of 0 builds a canister without one."""

    def build(contents: str) -> tuple[Part, ...]:
        cup = Part(vessels.mug(diameter_m, height_m), Layered([("glass", MUG_WALL_M)], backing=contents), "ceramic", "ceramic")
        if not reach_m:
            return (cup,)
        low, high = (share / 0.095 * height_m for share in (0.022, 0.076))
        bow = vessels.handle(diameter_m / 2, low, high, reach_m - 0.0045 - 0.001)
        return cup, Part(bow, Layered([], backing="glass"), "ceramic", "ceramic")

    return build


REFLECTOR_LEG_M = 0.1
OTHER_LEGS_M = (0.05, 0.06, 0.07, 0.08, 0.09, 0.11, 0.12)  # corner reflectors of other sizes, which are not part of the catalogue
MUG_M, MUG_WALL_M = (0.082, 0.095, 0.034), 0.004  # diameter, height, and reach of the handle; wall thickness

# Cross-sections of the bottles: height, half width and half depth in metres, and exponent of the superellipse. The cap is above the last
# cross-section.
MUSTARD = (
    (0.000, 0.0430, 0.0265, 2.4), (0.004, 0.0453, 0.0280, 2.3), (0.015, 0.0480, 0.0287, 2.3), (0.027, 0.0480, 0.0276, 2.4),
    (0.038, 0.0466, 0.0262, 2.6), (0.050, 0.0436, 0.0256, 2.7), (0.061, 0.0407, 0.0253, 2.8), (0.073, 0.0402, 0.0256, 2.7),
    (0.084, 0.0420, 0.0259, 2.5), (0.096, 0.0460, 0.0254, 2.4), (0.107, 0.0480, 0.0253, 2.3), (0.119, 0.0474, 0.0254, 2.3),
    (0.130, 0.0436, 0.0258, 2.5), (0.142, 0.0356, 0.0255, 2.3), (0.151, 0.0240, 0.0238, 2.0),
)  # fmt: skip
OLIVE_OIL = (
    (0.000, 0.0264, 0.0264, 5.0), (0.004, 0.0283, 0.0283, 6.0), (0.140, 0.0283, 0.0283, 6.0), (0.160, 0.0259, 0.0259, 4.5),
    (0.190, 0.0165, 0.0165, 2.2), (0.205, 0.0140, 0.0140, 2.0), (0.225, 0.0135, 0.0135, 2.0),
)  # fmt: skip
MOUTHWASH = (
    (0.000, 0.0381, 0.0236, 4.5), (0.005, 0.0405, 0.0255, 5.0), (0.045, 0.0405, 0.0255, 5.0), (0.080, 0.0381, 0.0244, 5.0),
    (0.115, 0.0405, 0.0255, 5.0), (0.130, 0.0391, 0.0247, 4.5), (0.155, 0.0219, 0.0189, 2.4), (0.165, 0.0165, 0.0165, 2.0),
    (0.172, 0.0160, 0.0160, 2.0),
)  # fmt: skip
DRESSING = (
    (0.000, 0.0371, 0.0235, 2.4), (0.005, 0.0395, 0.0254, 2.5), (0.100, 0.0400, 0.0257, 2.5), (0.125, 0.0366, 0.0242, 2.4),
    (0.155, 0.0231, 0.0192, 2.1), (0.175, 0.0180, 0.0180, 2.0), (0.188, 0.0178, 0.0178, 2.0),
)  # fmt: skip

ENTRIES: tuple[Entry, ...] = (
    reflector(REFLECTOR_LEG_M, "corner_reflector"),
    _food_can("211_300", 0.0762, 7.93, "short food can", "label_green",
              "a short metal food can, a round cylinder of tinplate with a paper label, 76 mm tall",
              "a steady but rather small metal echo from a short upright cylinder, with the same level at every angle of the turntable"),
    _food_can("211_304", 0.0826, 8.68, "food can", "label_blue",
              "a small metal food can, a round cylinder of tinplate with a paper label, 83 mm tall",
              "a nearly constant return of modest strength from a round conducting wall as high as a hand, without flashes or nulls",
              rover=False),
    _food_can("211_400", 0.1016, 10.94, "condensed soup can", "label_red",
              "a metal can of condensed soup, a round cylinder of tinplate with a paper label, 102 mm tall",
              "a medium strong echo that does not vary during the revolution, from a vertical cylinder of tinplate of average height"),
    _food_can("211_414", 0.1238, 13.56, "tall food can", "label_yellow",
              "a tall slim metal food can, a round cylinder of tinplate with a paper label, 124 mm tall",
              "a strong flat envelope over the whole turn, a single sharp peak in range from a tall slim metal cylinder with rims"),
    _drink_can("drink_can_355", "drink can", 0.1222, 355, "brushed_metal",
               "an aluminium drink can of 355 ml, a round cylinder with a necked top, 122 mm tall",
               "a strong unchanging echo of a thin round aluminium wall whose tapered neck reflects upwards and away from the radar",
               "Can Manufacturers Institute 211 x 413, necked to a 202 end; wall of 66.1 mm, 0.1 mm thick"),
    _drink_can("drink_can_473", "tall drink can", 0.1572, 473, "label_blue",
               "a tall aluminium drink can of 473 ml, a round cylinder with a necked top, 157 mm tall",
               "the largest constant return of all cylinders, because the aluminium side is longest, without modulation by rotation",
               "the US pint can: 6.19 inches on the wall and end of the 355 ml can"),
    Entry(
        "mug", "ceramic mug", (0.116, 0.082, 0.095), MUG_WALL_M, "glass", None, "symmetric", "ceramic", "ceramic", 330,
        "a white glazed ceramic coffee mug, a round cylinder with a handle on one side, 95 mm tall",
        "order of magnitude, no data sheet: the ordinary 11 ounce mug, 82 x 95 mm walls of 4 mm; porcelain takes the closest row, glass",
        mug(*MUG_M), 0.0475,
        radar_description="a moderate echo of a hollow ceramic cylinder, a second peak from its rear wall, and a handle seen once per turn",
    ),
    Entry(
        "olive_oil", "olive oil bottle", (0.0566, 0.0566, 0.246), 0.0005, "pet", "oil", "asymmetric", "plastic", "plastic", 500,
        "a tall plastic bottle of olive oil with a square section, four flat sides and a thin neck, filled with oil",
        f"half a litre of the square Marasca kind in PET; {VOLUME}",
        bottle(OLIVE_OIL, "pet", 0.0005, "green_plastic", (0.0155, 0.020), "plastic"), 0.123,
        radar_description="four equal narrow flashes each turn from flat sides at right angles, weak because waves enter plastic and oil",
    ),
    Entry(
        "mouthwash", "mouthwash bottle", (0.081, 0.051, 0.195), 0.0005, "pet", "mouthwash", "asymmetric", "plastic", "plastic", 500,
        "a flat plastic bottle of mouthwash with broad flat front and back panels and a slight waist, filled with a watery liquid",
        f"half a litre in PET; {VOLUME}",
        bottle(MOUTHWASH, "pet", 0.0005, "cyan_plastic", (0.0185, 0.022), "plastic"), 0.0975,
        radar_description="two bright narrow flashes each turn from wide opposite panels, two smaller ones from the sides of a watery box",
    ),
    Entry(
        "mustard", "mustard bottle", (0.096, 0.0574, 0.192), 0.0008, "hdpe", "mustard", "asymmetric", "plastic", "plastic", 540,
        "a yellow plastic squeeze bottle of mustard with an oval section, a waist and a pointed cap, filled with mustard",
        "sections of the scanned YCB model 006_mustard_bottle (20 ounces, 567 g), .096 x .058 x .192 m; HDPE squeeze bottles have 0.8 mm",
        bottle(MUSTARD, "hdpe", 0.0008, "yellow_plastic", (0.0170, 0.040), "yellow_plastic"), 0.096,
        radar_description="two broad swells each turn from the rounded wide sides of an oval wet body whose waist scatters elsewhere",
    ),
    Entry(
        "dressing", "salad dressing bottle", (0.080, 0.0514, 0.211), 0.0005, "pet", "dressing", "asymmetric", "plastic", "plastic", 473,
        "a plastic bottle of salad dressing with an oval section, broad shoulders and a round neck, filled with dressing",
        f"16 fluid ounces in PET; {VOLUME}",
        bottle(DRESSING, "pet", 0.0005, "cream_plastic", (0.0195, 0.022), "white_plastic"), 0.1055,
        radar_description="the level rises and falls gently twice per revolution, from a tall elliptical emulsion with sloping shoulders",
    ),
)  # fmt: skip


def catalogue() -> dict[str, Entry]:
    """Return the twelve catalogue objects as a dictionary by name.

    >>> sum(entry.symmetric for entry in catalogue().values()), len(catalogue())
    (7, 12)
    """
    return {entry.name: entry for entry in ENTRIES}


def entry(name: str) -> Entry:
    """Return the catalogue object with the given name; an unknown name raises SceneError."""
    known = catalogue()
    if name not in known:
        raise SceneError(f"the catalogue has no object {name!r}; choose {', '.join(known)}")
    return known[name]


def make(name: str) -> tuple[Surface, ...]:
    """Build the surfaces of the catalogue object with the given name, in the object's own frame."""
    return entry(name).surfaces()
