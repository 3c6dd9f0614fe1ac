"""Define the assortment: a second set of turntable objects, large enough that claims about recognition can be decided.

The file assortment.csv lists kind, material, contents, size and the source of the size of each object. Sizes are those of the Can
Manufacturers Institute (CMI), of the YCB set (B. Calli et al., IEEE Robotics and Automation Magazine 22 (2015) 36), of other data sets, of
product pages (given by their site), or of catalogue bottles stretched by the cube root of the volume. The objects of a kind have one shape
and differ in size, and some bottles also in plastic and contents. A simulation can therefore use another object of the same kind as a
deliberately wrong model. Shapes and walls follow the catalogue, and caps grow with the bottle. The reach of a mug's handle that no source
states is an order of magnitude.
"""

from __future__ import annotations

import csv
import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from radartwin.errors import SceneError
from radartwin.scene.objects import vessels
from radartwin.scene.objects.catalogue import (
    DRESSING,
    MOUTHWASH,
    MUG_WALL_M,
    MUSTARD,
    OLIVE_OIL,
    OTHER_LEGS_M,
    Entry,
    MaterialClass,
    Part,
    bottle,
    can,
    catalogue,
    mug,
    reflector,
)  # fmt: skip

SIZES = Path(__file__).with_name("assortment.csv")
WALLS: dict[str, tuple[float, MaterialClass, str]] = {  # material: thickness in metres, material class and look
    "metal": (0.0002, "metal", "brushed_metal"), "glass": (MUG_WALL_M, "ceramic", "ceramic"),
    "pet": (0.0005, "plastic", "cyan_plastic"), "hdpe": (0.0008, "plastic", "white_plastic"),
}  # fmt: skip
SYMMETRIC = ("food can", "drink can", "mug", "canister", "round bottle")
ROUND = (
    (0.000, 0.0290, 0.0290, 2.0), (0.005, 0.0320, 0.0320, 2.0), (0.130, 0.0320, 0.0320, 2.0), (0.165, 0.0180, 0.0180, 2.0),
    (0.182, 0.0135, 0.0135, 2.0),
)  # fmt: skip
BOTTLES = {  # kind: cross-sections as in the catalogue, and radius and height of the cap in metres
    "round bottle": (ROUND, (0.0155, 0.020)), "square bottle": (OLIVE_OIL, (0.0155, 0.020)), "flat bottle": (MOUTHWASH, (0.0185, 0.022)),
    "oval bottle": (DRESSING, (0.0195, 0.022)), "squeeze bottle": (MUSTARD, (0.0170, 0.040)),
}  # fmt: skip
REFLECTOR_KIND = "corner reflector"


@functools.cache
def assortment() -> Mapping[str, tuple[Entry, ...]]:
    """Return the objects of the assortment by kind.

    >>> sum(map(len, assortment().values()))
    50
    """
    by_kind: dict[str, list[Entry]] = {}
    with SIZES.open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            by_kind.setdefault(row["kind"], []).append(_entry(row))
    return {kind: tuple(entries) for kind, entries in by_kind.items()} | {REFLECTOR_KIND: tuple(_reflectors().values())[::3]}


@functools.cache
def every_object() -> Mapping[str, Entry]:
    """Return the objects of the catalogue and of the assortment, and the corner reflectors with legs of OTHER_LEGS_M, by name.

    >>> every_object()["corner_reflector_5cm"].aim_m < every_object()["corner_reflector"].aim_m
    True
    """
    return catalogue() | _reflectors() | {entry.name: entry for entries in assortment().values() for entry in entries}


def _reflectors() -> dict[str, Entry]:
    reflectors = [(leg, reflector(leg, f"corner_reflector_{100 * leg:g}cm")) for leg in OTHER_LEGS_M]
    return {entry.name: replace(entry, description=f"{entry.description}, with legs of {100 * leg:g} cm") for leg, entry in reflectors}


def _entry(row: Mapping[str, str]) -> Entry:
    kind, material, contents = row["kind"], row["material"], row["contents"] or None
    width, depth, height = (float(row[f"{name}_mm"]) / 1000 for name in ("width", "depth", "height"))
    size = width, depth, height
    wall, material_class, look = WALLS[material]
    wall, outline = wall / 2 if kind == "drink can" else wall, None  # drink cans have half the wall of food cans, as in the catalogue
    if kind in ("food can", "drink can"):
        outline = vessels.drink_can(width, height) if kind == "drink can" else vessels.food_can(width, height)
        build = can(outline, look)
    elif kind in BOTTLES:
        build = _bottle(kind, size, material, wall, look)
    elif kind == "metal box":
        build = _box(size, look)
    elif kind in ("mug", "canister"):
        build = mug(depth, height, width - depth)
    else:
        known = ", ".join(sorted({"metal box", *SYMMETRIC, *BOTTLES}))
        raise SceneError(f"{SIZES.name}: {row['name']} is of the unknown kind {kind!r}; choose {known}")
    label = row["name"].replace("_", " ").rstrip(" 0123456789")
    text = f"a {label} of {material_class}, {1000 * width:.0f} mm wide and {1000 * height:.0f} mm tall"
    return Entry(
        row["name"], label, size, wall, material, contents, "symmetric" if kind in SYMMETRIC else "asymmetric", material_class,
        material_class, None, text + (f", filled with {contents}" if contents else ""), row["source"], build, height / 2, rover=False,
        outline_m=outline,
    )  # fmt: skip


def _bottle(kind: str, size_m: tuple[float, ...], plastic: str, wall_m: float, look: str) -> Callable[[str], tuple[Part, ...]]:
    """Return the function that builds a bottle with the shape of its kind, stretched to its width, depth and height."""
    sections, (radius, cap) = BOTTLES[kind]
    half = [max(section[axis] for section in sections) for axis in (1, 2)]
    x, y, z = size_m[0] / 2 / half[0], size_m[1] / 2 / half[1], (size_m[2] - 0.001) / (sections[-1][0] + cap)
    stretched = tuple((at * z, a * x, b * y, n) for at, a, b, n in sections)
    return bottle(stretched, plastic, wall_m, look, (radius * min(x, y), cap * z), look)


def _box(size_m: tuple[float, ...], look: str) -> Callable[[str], tuple[Part, ...]]:
    """Return the function that builds a metal box with rounded vertical edges."""
    width, depth, height = size_m
    sections = [(at, width / 2, depth / 2, 8.0) for at in (0.0, height)]
    return lambda contents: (Part(vessels.oval(sections), "metal", "metal", look),)
