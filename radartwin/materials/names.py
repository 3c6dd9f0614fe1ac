"""Find the known material for a material name that is neither a MINC category nor a material of ITU-R P.2040.

The module has two tables. The table SYNONYMS lists other words for a known material, such as drywall or steel. The table PERMITTIVITY lists
further materials with their permittivity. For such a material, the module chooses air or a P.2040 material with a fit at 77 GHz, so that a
half-space of the chosen material has the most similar reflection (`distance.closest`). For example, it replaces porcelain by glass, because
the permittivity of porcelain is 6.0. There is no default material: the module refuses a name that is in neither table.

Sources of PERMITTIVITY, real part and loss tangent at 60 to 100 GHz: [L] J. Lamb, Int. J. Infrared and Millimeter Waves 17 (1996) 1997;
[A] 60 GHz values of docs/pcr_tech/radar_principles, Acconeer; [D] data sheets and handbooks at microwave frequencies. The loss tangents of
[D] are less certain, but a loss tangent below 0.1 hardly changes the reflection.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from radartwin.errors import MaterialError
from radartwin.materials.distance import closest, in_range
from radartwin.materials.itu import P2040
from radartwin.materials.layers import Layered
from radartwin.materials.minc import CATEGORIES, MINC, row
from radartwin.materials.permittivity_by_name import MATERIAL_NAMES

SYNONYMS = {
    "metal": "steel stainless_steel sheet_metal iron aluminium aluminum copper brass bronze chrome zinc tin tinplate gold silver lead",
    "glass": "window window_pane pane glazing safety_glass tempered_glass float_glass screen",
    "mirror": "looking_glass",
    "painted": "drywall gypsum gypsum_board sheetrock plaster_board plaster stucco painted_wall painted_plaster wall_paint paint",
    "wood": "timber oak pine beech plank solid_wood wood_panelling wood_paneling parquet hardwood softwood bamboo veneer lumber",
    "ceramic": "crockery earthenware stoneware china",
    "tile": "ceramic_tile wall_tile floor_tile",
    "plastic": "polyethylene polypropylene pp pe",
    "fabric": "cloth textile curtain upholstery cotton wool linen polyester felt velvet canvas sofa",
    "carpet": "rug carpeting moquette",
    "paper": "cardboard carton corrugated_cardboard paperboard poster book newspaper",
    "leather": "hide suede artificial_leather faux_leather",
    "foliage": "plant leaf leaves grass houseplant",
    "skin": "human person hand face",
    "brick": "brickwork masonry clinker",
    "polishedstone": "polished_stone terrazzo",
    "stone": "rock natural_stone",
    "ceiling_board": "ceiling_tile acoustic_tile mineral_fibre_board mineral_wool_board",
    "chipboard": "particle_board particleboard mdf fibreboard fiberboard hardboard melamine_board",
    "concrete": "cement mortar screed cement_block",
    "floorboard": "laminate_floor laminate laminate_flooring",
    "vinyl_tile": "vinyl linoleum pvc_floor lino",
    "clear_acrylic": "acrylic plexiglass plexiglas perspex pmma",
    "asphalt_concrete": "asphalt",
}
_ROW_OF = {word: name for name, words in SYNONYMS.items() for word in words.split()}

PERMITTIVITY = {
    "porcelain": (6.0, 0.01),  # [D]
    "alumina": (9.7, 0.001),  # [L]
    "granite": (5.5, 0.02),  # [D]
    "limestone": (7.5, 0.02),  # [D]
    "sandstone": (4.5, 0.03),  # [D]
    "slate": (7.0, 0.03),  # [D]
    "quartz": (3.8, 0.001),  # [L] fused
    "rubber": (3.0, 0.03),  # [D]
    "abs": (2.75, 0.01),  # [A] gives 2.5 to 4.0; ABS without fillers is at the lower end
    "polycarbonate": (2.75, 0.01),  # [A]
    "polystyrene": (2.54, 0.002),  # [L]
    "nylon": (3.0, 0.02),  # [L]
    "ptfe": (2.05, 0.0005),  # [L]
    "pvc": (2.9, 0.01),  # [D]
    "fibreglass": (4.4, 0.02),  # [D] epoxy laminate
    "epoxy": (3.0, 0.03),  # [D]
    "silicone": (2.9, 0.03),  # [D]
    "foam": (1.05, 0.001),  # [D] polystyrene or polyurethane of 30 kg/m3
    "cork": (1.7, 0.05),  # [D]
    "wax": (2.25, 0.001),  # [L]
    "ice": (3.17, 0.002),  # [D]
    "gypsum_plaster": (2.7, 0.03),  # [A]
}
_SPELLINGS = {"fiberglass": "fibreglass", "teflon": "ptfe", "styrofoam": "foam", "polyurethane_foam": "foam", "enamel": "porcelain"}


@dataclass(frozen=True)
class Resolved:
    """Hold the material that a name resolves to."""

    name: str  # material name in lower case, with underscores instead of spaces
    material: str | Layered  # known material: a name (half-space) or a stack of layers
    category: str | None  # MINC category of the material; None for a plain material
    stand_in: bool  # whether the material is a substitute at 77 GHz


def resolve(name: str) -> Resolved:
    """Find the known material for a material name. Capitals are ignored; spaces and hyphens count as underscores.

    Raises:
        MaterialError: the name is unknown. The message lists the known names.

    >>> resolve("Porcelain").material, resolve("drywall").category
    ('glass', 'painted')
    """
    plain = "_".join(str(name).strip().lower().replace("-", " ").split())
    plain = _SPELLINGS.get(plain, plain)
    if plain in MINC:
        return Resolved(plain, row(plain).material, plain, row(plain).stand_in())
    if plain in MATERIAL_NAMES:
        return Resolved(plain, plain, None, not in_range(plain))
    if plain in _ROW_OF:
        return replace(resolve(_ROW_OF[plain]), name=plain)
    if plain in PERMITTIVITY:
        real, loss = PERMITTIVITY[plain]
        return Resolved(plain, closest(real * (1 - 1j * loss), ["air", *filter(in_range, P2040)]), None, True)
    raise MaterialError(f"unknown material {name!r}; known: {', '.join(known_names())}")


def mentioned(words: str) -> Resolved | None:
    """Return the known material that a free text mentions, or None if the text mentions no known material.

    If the text mentions several materials, the function prefers plain materials to MINC categories, then longer names to shorter names, and
    then names that occur later in the text, because the main noun of an English compound is its last word.

    >>> mentioned("white acoustic ceiling tiles").material, mentioned("lacquered sheet steel").category, mentioned("unobtainium")
    ('ceiling_board', 'metal', None)
    """
    plain = re.sub(r"[^a-z]+", " ", words.lower()).split()
    candidates: list[tuple[bool, int, int, Resolved]] = []
    for start in range(len(plain)):
        for stop in range(start + 1, len(plain) + 1):
            phrase = "_".join(plain[start:stop])
            for spelling in (phrase, phrase.removesuffix("s")):
                if _is_known(spelling):
                    known = resolve(spelling)
                    candidates.append((known.category is None, stop - start, start, known))
                    break
    return max(candidates, key=lambda entry: entry[:3])[3] if candidates else None


def _is_known(name: str) -> bool:
    return any(name in table for table in (MINC, MATERIAL_NAMES, _ROW_OF, PERMITTIVITY, _SPELLINGS))


def known_names() -> tuple[str, ...]:
    """Return every name that `resolve` accepts, MINC categories first."""
    return (*CATEGORIES, *sorted({*MATERIAL_NAMES, *_ROW_OF, *PERMITTIVITY, *_SPELLINGS} - set(CATEGORIES)))
