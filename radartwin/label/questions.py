"""What is asked about a surface: one prompt, its pictures and what the scanner measured of it. Nothing else of the scene is told.

The prompt has a version and a digest: an answer is only as good as the question, and recorded answers name theirs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from radartwin.label.answers import CONTENTS, Kind, schema
from radartwin.label.crops import Crop
from radartwin.label.photos import Photo
from radartwin.label.place import Place, place_of
from radartwin.label.views import Views
from radartwin.materials.itu import P2040
from radartwin.materials.names import PERMITTIVITY
from radartwin.scene.scene import Scene, Surface

VERSION = 2

# What counts as which. No examples of things: those that happen to stand in a room would be answered by the prompt.
MEANINGS = {
    "brick": "bare brickwork",
    "carpet": "carpet",
    "ceramic": "porcelain or earthenware (glazed tiles are tile)",
    "fabric": "cloth",
    "foliage": "leaves, plants",
    "food": "food without its packing",
    "glass": "glass, clear or frosted",
    "hair": "hair, fur",
    "leather": "leather or imitation leather",
    "metal": "metal of any kind, also under paint or enamel",
    "mirror": "mirror",
    "other": "none of these, or impossible to tell",
    "painted": "painted plaster, plasterboard, concrete or masonry; name says which",
    "paper": "paper or cardboard",
    "plastic": "plastic of any kind",
    "polishedstone": "polished or cut stone",
    "skin": "human skin",
    "sky": "sky",
    "stone": "rough stone, bare concrete, cement",
    "tile": "ceramic tiles",
    "wallpaper": "wallpaper",
    "water": "open water",
    "wood": "wood and boards made of wood, also varnished or laminated",
}

# Materials offered by name: every row of P.2040 and of the table of permittivities that a solid of a building can be.
NAMES = tuple(sorted({*P2040, *PERMITTIVITY} - {"vacuum", "air", "ice", "wax", *(n for n in P2040 if "ground" in n)}))

_TASK = """You see {pictures} of one place in a scanned room. In each picture the same {what} is outlined in magenta, with its surroundings.
What is it made of? Decide by its look, its shape, what it is and where it is: name the material that a radio wave would meet, under any
paint or varnish, and think of what such a thing is commonly built of. What the outline leaves out does not count: other
things stand in front.

Choose exactly one of these categories:
{categories}

The scanner measured: {facts}.
"""
_INSIDE = """
It is a thing rather than a part of the room. Estimate also the thickness of its wall in millimetres (null if it is solid or cannot be
told) and what is inside: {contents}.
"""
_FORMAT = """
Answer with one JSON object and nothing else:
{example}
confidence is between 0 and 1, how sure you are of the category; reason is one short sentence. name is the material more exactly than the
category says it, in a few plain words: of what is painted or papered, what is under the paint or paper; of "other", what it is; null where
the category says all. These names are known, use one where it fits: {names}.
"""


@dataclass(frozen=True, eq=False)
class Question:
    """One surface to be asked about.

    Attributes:
        surface: its index in the scene.
        kind: "surface" of the room, or an "object" that may hold something.
        text: the whole prompt.
        crops: its pictures, the first ones close, the last one wide.
        place: where it lies.
    """

    surface: int
    kind: Kind
    text: str
    crops: tuple[Crop, ...]
    place: Place

    @cached_property
    def key(self) -> str:
        """Digest of all that is shown and asked; says nothing of the surface's name or number."""
        return hashlib.sha256("\n".join([self.text, *self.images]).encode()).hexdigest()

    @property
    def id(self) -> str:
        return self.key[:12]

    @property
    def images(self) -> tuple[str, ...]:
        """SHA-256 of each picture."""
        return tuple(crop.digest for crop in self.crops)


def prompt_digest() -> str:
    """SHA-256 of everything in a prompt but the surface's own facts, with the schemas."""
    parts = [VERSION, _TASK, _INSIDE, _FORMAT, MEANINGS, NAMES, CONTENTS, schema("surface"), schema("object")]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def questions(
    scene: Scene,
    photos: Sequence[Photo] = (),
    *,
    views: int = 3,
    only: Sequence[int] | None = None,
    step: Callable[[], None] = lambda: None,
) -> list[Question]:
    """A question for every surface (or those of `only`) that any view shows.

    Args:
        views: pictures of each at most.
        step: called after each surface's pictures.
    """
    indices = list(range(len(scene))) if only is None else list(only)
    if not indices:
        return []
    floor = float(scene.bounds[0, 2])
    crops = Views(scene, photos, views).of(indices, step)
    return [_question(index, scene.surfaces[index], tuple(crops[index]), floor) for index in indices if crops[index]]


def _question(index: int, surface: Surface, crops: tuple[Crop, ...], floor_m: float) -> Question:
    kind: Kind = "object" if surface.kind == "object" else "surface"
    place = place_of(surface.mesh)
    return Question(index, kind, prompt(kind, facts(surface, floor_m), [crop.origin for crop in crops]), crops, place)


def prompt(kind: Kind, measured: str, origins: Sequence[str]) -> str:
    """The prompt about a surface of which `measured` is known, shown in pictures of one origin, "photo" or "mesh"."""
    count = len(origins)
    what_kind = "photograph" if "photo" in origins else "rendered picture"
    pictures = f"a {what_kind}" if count == 1 else f"{count} {what_kind}s"
    categories = "\n".join(f"- {name}: {meaning}" for name, meaning in MEANINGS.items())
    example: dict[str, object] = {"material": "...", "confidence": 0.0, "reason": "...", "name": None}
    if kind == "object":
        example |= {"wall_thickness_mm": None, "contents": "..."}
    what = "surface" if kind == "surface" else "thing"
    text = _TASK.format(pictures=pictures, what=what, categories=categories, facts=measured)
    text += _INSIDE.format(contents=", ".join(f'"{name}"' for name in CONTENTS)) if kind == "object" else ""
    return text + _FORMAT.format(example=json.dumps(example), names=", ".join(name.replace("_", " ") for name in NAMES))


def facts(surface: Surface, floor_m: float) -> str:
    """Size, attitude and height in words, as coarse as a scan knows them: "2.4 m x 0.9 m, upright, its middle 1.0 m above the floor"."""
    place = place_of(surface.mesh)
    spread = np.asarray(surface.mesh.vertices)[np.unique(np.asarray(surface.mesh.faces))]
    height = place.centroid[2] - floor_m
    if place.normal is None:
        size = np.sort(np.ptp(spread, axis=0))[::-1]
        form = " x ".join(f"{_length(extent)}" for extent in size) + ", not flat"
    else:
        level = abs(place.normal[2])
        upright = np.array([0.0, 0.0, 1.0])
        along = np.cross(upright, place.normal) if level < 0.95 else np.array([1.0, 0.0, 0.0])
        along /= np.linalg.norm(along)
        across = np.cross(place.normal, along)
        width, tall = np.ptp(spread @ along), np.ptp(spread @ across)
        side = "facing up" if place.normal[2] > 0 else "facing down"
        attitude = f"level, {side}" if level > 0.95 else "upright" if level < 0.25 else "sloping"
        form = f"{_length(width)} x {_length(tall)}, flat, {attitude}"
    return f"{form}, its middle {height:.1f} m above the lowest point of the scan"


def _length(metres: float) -> str:
    return f"{metres:.1f} m" if metres >= 0.95 else f"{100 * metres:.0f} cm"
