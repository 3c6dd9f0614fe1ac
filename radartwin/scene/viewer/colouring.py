"""Choose the display colours of surfaces by material, segment or reflectivity, and write the name of a material for the legend."""

from __future__ import annotations

import colorsys
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import ImageColor

from radartwin.errors import MaterialError
from radartwin.materials import Layered, reflection
from radartwin.materials.distance import in_range
from radartwin.materials.itu import STAND_INS
from radartwin.scene.surface import Surface

RGB = tuple[int, int, int]

# Familiar colours of materials. The colours differ in lightness, so that colour-blind readers can distinguish them (hues of Okabe and Ito).
COLOURS = {
    "metal": "#5b6b7a",
    "concrete": "#a8a8a0",
    "brick": "#b5533c",
    "plasterboard": "#ece3cf",
    "wood": "#c98b4a",
    "plywood": "#d9a86c",
    "chipboard": "#d9bf94",
    "floorboard": "#8a5a33",
    "glass": "#56b4e9",
    "ceiling_board": "#cfd8dc",
    "marble": "#f0e9f2",
    "water": "#0072b2",
    "oil": "#e69f00",
    "pet": "#009e73",
    "hdpe": "#33c29a",
}
# Each colour resembles the material of its MINC category. The colours of categories that often touch in a room differ in lightness.
CATEGORY_COLOURS = {
    "brick": "#b5533c", "carpet": "#6a3d9a", "ceramic": "#c7e9f1", "fabric": "#cc79a7", "foliage": "#3a9d3a", "food": "#e6ab02",
    "glass": "#56b4e9", "hair": "#4d2f12", "leather": "#7b3f00", "metal": "#3f4a54", "mirror": "#a6cee3", "other": "#ff00ff",
    "painted": "#f1e8d2", "paper": "#e8c77a", "plastic": "#009e73", "polishedstone": "#b8a9c9", "skin": "#f2b9a0", "sky": "#9fd3ff",
    "stone": "#9a9a92", "tile": "#8fd3c4", "wallpaper": "#f5b971", "water": "#0072b2", "wood": "#a8672f",
}  # fmt: skip
OTHER = "#cc79a7"
BAND_HZ = (77e9, 81e9)  # the automotive radar band; a mean over this band averages out the interference fringes of a slab
LOW_DB = -40.0  # lower end of the colour scale: a ten-thousandth of the power is reflected
UNKNOWN: RGB = (216, 27, 160)  # colour of a surface with unknown reflectivity, which does not occur in the colour scale


def material_label(material: str | Layered) -> str:
    """Return the display name of a material, such as `concrete`, `floorboard 8 mm on concrete` or `glass 4 mm | air 16 mm | glass 4 mm`."""
    if isinstance(material, str):
        return material
    stack = " | ".join(f"{name} {1000 * thickness:.4g} mm" for name, thickness in material.layers)
    if not stack:
        return material.backing
    return stack if material.backing == "air" else f"{stack} on {material.backing}"


def surface_label(surface: Surface) -> str:
    """Return the material of a surface for readers. If a substitute is simulated, or if a vision-language model named the material, its
    category comes first, such as `fabric (simulated as wood 0.5 mm)`.
    """
    label, category = material_label(surface.material), surface.provenance.get("minc")
    named = surface.provenance.get("source") == "vlm" and str(category) not in label
    if not category or not (named or surface.provenance.get("stand_in")):
        return label
    return f"{category} (simulated as {STAND_INS[label] if label in STAND_INS and not in_range(label) else label})"


def material_colours(materials: Sequence[str | Layered]) -> dict[str, RGB]:
    """Choose a colour for every distinct material, and return a dictionary from the display name of the material to its colour. A name from
    `surface_label` counts as a material.

    Layered materials with the same outer layer have colours of different lightness.
    """
    counts: Counter[str] = Counter()
    colours = {}
    for label in sorted({material_label(m) for m in materials}):
        name = label.partition(" ")[0]  # name of the outermost material
        colours[label] = _lighter(
            ImageColor.getrgb({**CATEGORY_COLOURS, **COLOURS}.get(name, OTHER)), (0, -0.13, 0.1, -0.22, 0.18)[counts[name] % 5]
        )
        counts[name] += 1
    return colours


def segment_colours(areas: Sequence[float]) -> list[RGB]:
    """Choose a colour for each segment by the rank of the segment in area.

    The hues of consecutive ranks differ by the golden angle, so that large segments have clearly different colours.
    """
    colours: list[RGB] = [(0, 0, 0)] * len(areas)
    for rank, index in enumerate(np.argsort(-np.asarray(areas), kind="stable")):
        hue = (0.58 + rank * 0.61803398875) % 1
        r, g, b = colorsys.hls_to_rgb(hue, (0.62, 0.45, 0.74)[rank % 3], (0.6, 0.5, 0.75)[rank // 3 % 3])
        colours[int(index)] = (round(255 * r), round(255 * g), round(255 * b))
    return colours


@lru_cache(maxsize=4096)
def reflection_db(material: str | Layered, roughness_m: float = 0.0) -> float | None:
    """Compute the reflected relative to the incident power in dB at normal incidence, averaged over 77 to 81 GHz.

    The result is None for a material without permittivity values at these frequencies.

    >>> round(reflection_db("metal"), 1), round(reflection_db("concrete"), 1)
    (-0.0, -8.1)
    """
    frequencies = np.linspace(*BAND_HZ, 41)
    try:
        te, _ = reflection(material, np.ones_like(frequencies), frequencies, roughness_m)
    except MaterialError:
        return None
    power = float(np.mean(np.abs(te) ** 2))
    return 10 * float(np.log10(power)) if power > 0 else -np.inf


def ramp() -> list[RGB]:
    """Return the colours of the reflectivity scale from LOW_DB to 0 dB, from dark to light (colour map viridis)."""
    from matplotlib import colormaps

    return [(int(r), int(g), int(b)) for r, g, b in np.round(255 * colormaps["viridis"](np.linspace(0, 1, 33))[:, :3])]


def reflectivity_colour(level_db: float | None, stops: Sequence[RGB]) -> RGB:
    """Return the colour of a reflectivity in dB on the scale `stops`, clipped at the ends of the scale; UNKNOWN for None."""
    if level_db is None:
        return UNKNOWN
    at = float(np.clip(1 - level_db / LOW_DB, 0, 1)) * (len(stops) - 1)
    r, g, b = (round(float(np.interp(at, range(len(stops)), [s[k] for s in stops]))) for k in range(3))
    return r, g, b


def _lighter(colour: tuple[int, ...], share: float) -> RGB:
    goal = 255 if share > 0 else 0
    r, g, b = (round(c + abs(share) * (goal - c)) for c in colour)
    return r, g, b
