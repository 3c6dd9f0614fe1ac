"""Ask a vision-language model about the material and the roughness of a surface, at most ATTEMPTS times until the answer is valid.

A material question consists of a prompt and pictures of the surface. The prompt states the size, orientation and height of the surface in
the scan. The model gets no other information about the scene. Each recorded answer stores the version and the digest of the prompt.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from radartwin.errors import LabelError
from radartwin.label.answers import CONTENTS, Answer, Kind, read_answer, schema
from radartwin.label.crops import Crop, Views
from radartwin.label.photos import Photo
from radartwin.label.surface_match import Place, place_of
from radartwin.materials.itu import P2040
from radartwin.materials.names import PERMITTIVITY
from radartwin.scene.scene import Scene, Surface

VERSION = 3
ATTEMPTS = 3  # largest number of times that a question is asked; if all answers are invalid, the material category is `other`
Message = dict[str, str]  # role ("user" or "assistant") and text of one message of a conversation with a model

# This table explains the MINC categories to the model. The table names no objects, because an object of the scanned room would reveal the
# answer.
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

# This table explains the finishes to the model. The order is from smooth to rough. Like MEANINGS, this table names no objects.
LOOKS = {
    "polished": "gloss like glass: glass, glaze, polished stone or metal",
    "smooth": "no grain to be felt: planed, varnished or coated board, moulded plastic, sheet metal, paint on a smooth ground",
    "fine": "grain that a fingertip just feels: plaster, wallpaper, paint from a roller, grained leather, fine cloth",
    "sandy": "grains or pores about as deep as a grain of sand: bare concrete, brick, render, coarse cloth, mineral board",
    "coarse": "relief of some millimetres: split stone, rough brickwork, exposed gravel, looped pile",
    "loose": "strands or loose pieces: cut pile, fur, leaves",
    "unknown": "impossible to tell",
}

# The prompt offers these material names to the model: all building solids in the tables of ITU-R P.2040 and of measured permittivities.
NAMES = tuple(sorted({*P2040, *PERMITTIVITY} - {"vacuum", "air", "ice", "wax", *(n for n in P2040 if "ground" in n)}))

_TASK = """You see {pictures} of one place in a scanned room. In each picture the same {what} is outlined in magenta, with its surroundings.
What is it made of? Decide by its look, its shape, what it is and where it is: name the material that a radio wave would meet, under any
paint or varnish, and think of what such a thing is commonly built of. What the outline leaves out does not count: other
things stand in front.

Choose exactly one of these categories:
{categories}

How rough is its outermost face, with the paint or varnish on it? Judge by its look and by what such a face is usually like. Choose exactly
one of these finishes, from smooth to rough:
{finishes}

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
    """The question which material and finish one surface of the scene has.

    Attributes:
        surface: index of the surface in the scene.
        kind: "surface" for a surface of the room, or "object" for an object, which may have contents.
        text: the complete prompt that the model receives.
        crops: pictures of the surface; the last picture also shows the surroundings of the surface.
    """

    surface: int
    kind: Kind
    text: str
    crops: tuple[Crop, ...]
    place: Place

    @cached_property
    def key(self) -> str:
        """Digest of the question's prompt and pictures. The digest does not reveal the name or index of the surface."""
        return hashlib.sha256("\n".join([self.text, *self.images]).encode()).hexdigest()

    @property
    def id(self) -> str:
        return self.key[:12]

    @property
    def images(self) -> tuple[str, ...]:
        """SHA-256 digest of each picture in the question."""
        return tuple(crop.digest for crop in self.crops)


def prompt_digest() -> str:
    """Return the SHA-256 digest of the answer schemas and of the prompt without the size and orientation of a surface."""
    parts = [VERSION, _TASK, _INSIDE, _FORMAT, MEANINGS, LOOKS, NAMES, CONTENTS, schema("surface"), schema("object")]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def questions(
    scene: Scene,
    photos: Sequence[Photo] = (),
    textured: Scene | None = None,
    *,
    views: int = 3,
    only: Sequence[int] | None = None,
    step: Callable[[], None] = lambda: None,
) -> list[Question]:
    """Prepare a material question for every surface of the scene that at least one picture shows.

    Args:
        photos: photographs of the scene; a surface that no photograph shows is rendered from the mesh instead.
        textured: the scanned mesh with its pictures, which is rendered instead of the surfaces of the scene; None renders the surfaces.
        only: indices of the surfaces to ask about; None means all surfaces.
    """
    indices = list(range(len(scene))) if only is None else list(only)
    floor = float(scene.bounds[0, 2])
    crops = Views(scene, photos, views, textured).crops(indices, step)
    return [_question(index, scene.surfaces[index], tuple(crops[index]), floor) for index in indices if crops[index]]


def _question(index: int, surface: Surface, crops: tuple[Crop, ...], floor_m: float) -> Question:
    kind: Kind = "object" if surface.kind == "object" else "surface"
    place = place_of(surface.mesh)
    return Question(index, kind, prompt(kind, facts(surface, floor_m), [crop.origin for crop in crops]), crops, place)


def prompt(kind: Kind, measured: str, origins: Sequence[str]) -> str:
    """Return the prompt for one surface.

    `measured` describes the surface's size; `origins` names each picture's origin, "photo" or "mesh".
    """
    count = len(origins)
    what_kind = "photograph" if "photo" in origins else "rendered picture"
    pictures = f"a {what_kind}" if count == 1 else f"{count} {what_kind}s"
    categories, finishes = ("\n".join(f"- {name}: {meaning}" for name, meaning in table.items()) for table in (MEANINGS, LOOKS))
    example: dict[str, object] = {"material": "...", "finish": "...", "confidence": 0.0, "reason": "...", "name": None}
    if kind == "object":
        example |= {"wall_thickness_mm": None, "contents": "..."}
    what = "surface" if kind == "surface" else "thing"
    text = _TASK.format(pictures=pictures, what=what, categories=categories, finishes=finishes, facts=measured)
    text += _INSIDE.format(contents=", ".join(f'"{name}"' for name in CONTENTS)) if kind == "object" else ""
    return text + _FORMAT.format(example=json.dumps(example), names=", ".join(name.replace("_", " ") for name in NAMES))


def facts(surface: Surface, floor_m: float) -> str:
    """Describe size, orientation and height of a surface in words, for the prompt of a material question.

    Example: "2.4 m x 0.9 m, flat, upright, its middle 1.0 m above the lowest point of the scan".
    """
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


def ask(question: Question, complete: Callable[[list[Message]], str]) -> Answer:
    """Ask a material question until the model's answer fits the JSON schema, at most ATTEMPTS times.

    After an invalid answer, the model receives the schema's error message. `complete` is a function that takes the conversation so far and
    returns the model's next message. In the last attempt, a known material outside the MINC categories is replaced by its closest MINC
    category. If this replacement does not make the answer of the last attempt valid, the material category is `other`.
    """
    messages = [{"role": "user", "content": question.text}]
    problem = ""
    for attempt in range(1, ATTEMPTS + 1):
        reply = complete(messages)
        try:
            answer = read_answer(reply, question.kind, names=attempt == ATTEMPTS)
        except LabelError as error:
            problem = str(error)
            again = f"That is not a valid answer: {problem[:500]}. Answer again, with one JSON object of the asked form and nothing else."
            messages += [{"role": "assistant", "content": reply[:2000]}, {"role": "user", "content": again}]
            continue
        return Answer(**{**answer.to_dict(), "attempts": attempt})
    return Answer.none(problem, ATTEMPTS)
