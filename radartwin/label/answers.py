"""An answer about one surface: what it must look like, and the material it stands for.

The schema admits one of the 23 MINC categories, a confidence and a reason; about objects also the thickness of the wall and what is
inside, from which a layered shell is built. Whoever answers gets the schema's own complaint and another try.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from radartwin.errors import LabelError, MaterialError
from radartwin.materials import Layered, roughness_m
from radartwin.materials.minc import CATEGORIES, row
from radartwin.materials.names import resolve
from radartwin.materials.roughness import CLASSES

Kind = Literal["surface", "object"]

# What may be inside an object, and what the radar meets there; None: no cavity, or nobody knows.
CONTENTS: dict[str, str | None] = {
    "empty": "air",
    "water-like liquid": "water",
    "oil-like liquid": "oil",
    "moist food or paste": "mustard",
    "solid": None,
    "unknown": None,
}
REASON_CHARACTERS = 400


@dataclass(frozen=True)
class Answer:
    """What somebody said of a surface.

    Attributes:
        material: MINC category.
        confidence: 0 to 1, None where nobody said.
        wall_thickness_mm, contents: of objects; None where not asked or not known.
        named: a material outside MINC that was named instead, and is taken as its closest row.
        invalid: no valid answer came; `material` is "other".
        attempts: how often it was asked.
    """

    material: str
    confidence: float | None = None
    reason: str = ""
    wall_thickness_mm: float | None = None
    contents: str | None = None
    named: str | None = None
    invalid: bool = False
    attempts: int = 1

    def to_dict(self) -> dict[str, Any]:
        """Without what is as by default."""
        default = asdict(Answer(""))
        return {key: value for key, value in asdict(self).items() if key == "material" or value != default[key]}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Answer:
        """The inverse of `to_dict`.

        Raises:
            LabelError: fields it does not have, or a category that is none.
        """
        try:
            answer = cls(**values)
        except TypeError as error:
            raise LabelError(f"a recorded answer does not fit ({error}); record it again") from error
        if answer.material not in CATEGORIES:
            raise LabelError(f"a recorded answer says {answer.material!r}, which is no MINC category; record it again")
        return answer

    @classmethod
    def none(cls, why: str, attempts: int) -> Answer:
        """What stands for a surface whose answers stayed invalid."""
        return cls("other", 0.0, f"no valid answer in {attempts} attempts: {why}"[:REASON_CHARACTERS], invalid=True, attempts=attempts)


@functools.cache
def _schema(kind: Kind) -> str:
    fields: dict[str, Any] = {
        "material": {"type": "string", "enum": list(CATEGORIES)},
        "confidence": {"type": "number", "minimum": 0, "maximum": 1},
        "reason": {"type": "string", "maxLength": REASON_CHARACTERS},
    }
    if kind == "object":
        fields["wall_thickness_mm"] = {"type": ["number", "null"], "exclusiveMinimum": 0, "maximum": 500}
        fields["contents"] = {"type": "string", "enum": list(CONTENTS)}
    return json.dumps({"type": "object", "properties": fields, "required": list(fields), "additionalProperties": False})


def schema(kind: Kind) -> dict[str, Any]:
    """The JSON schema of an answer about a "surface" or an "object"."""
    return json.loads(_schema(kind))


def read_answer(text: str | Mapping[str, Any], kind: Kind, names: bool = False) -> Answer:
    """An answer from what a model wrote, or from a JSON object.

    Args:
        names: take a material outside MINC that `radartwin.materials.names` knows as its closest row, instead of refusing it.
    Raises:
        LabelError: what is wrong with it, in words that can be shown to whoever is asked again.

    >>> read_answer('Sure: {"material": "wood", "confidence": 0.9, "reason": "grain"}', "surface").material
    'wood'
    """
    from jsonschema import Draft202012Validator

    value = dict(text) if isinstance(text, Mapping) else _first_object(text)
    named = None
    if names and isinstance(value.get("material"), str) and value["material"] not in CATEGORIES:
        named, value = value["material"], {**value, "material": _closest_category(value["material"])}
    problems = sorted(Draft202012Validator(schema(kind)).iter_errors(value), key=lambda e: list(map(str, e.absolute_path)))
    if problems:
        raise LabelError("; ".join(_said(problem) for problem in problems))
    return Answer(**{key: value[key] for key in schema(kind)["properties"]}, named=named)


def material_of(answer: Answer) -> tuple[str | Layered, float, bool]:
    """Material, roughness (metres) and whether it is a stand-in, of an answer."""
    entry = row(answer.material)
    base, rough, stand_in = entry.material, entry.roughness_m, entry.stand_in()
    if answer.named is not None:
        found = resolve(answer.named)
        base, stand_in = found.material, found.stand_in
        texture = next((n for n in (found.name, base) if isinstance(n, str) and n in CLASSES), None)
        rough = roughness_m(texture) if texture else rough
    shell = interior(base, answer.wall_thickness_mm, answer.contents)
    return shell, rough, stand_in or (shell != base and answer.contents not in ("empty", "solid", "unknown"))


def interior(material: str | Layered, wall_thickness_mm: float | None, contents: str | None) -> str | Layered:
    """A shell of the material's outermost layer with what is inside behind it; the material itself where that is not known.

    >>> interior("hdpe", 1.0, "water-like liquid")
    Layered(layers=(('hdpe', 0.001),), backing='water')
    """
    inside = CONTENTS.get(contents) if contents is not None else None
    outer = material if isinstance(material, str) else material.layers[0][0]
    if inside is None or wall_thickness_mm is None or outer in ("metal", "air", "vacuum"):
        return material
    return Layered([(outer, wall_thickness_mm / 1000)], backing=inside)


def _first_object(text: str) -> dict[str, Any]:
    """The first JSON object in a text, which models like to wrap in words and fences."""
    start = text.find("{")
    if start < 0:
        raise LabelError(f"no JSON object in {text.strip()[:80]!r}")
    try:
        value, _ = json.JSONDecoder().raw_decode(text[start:])
    except ValueError as error:
        raise LabelError(f"not valid JSON ({error})") from error
    return value


def _closest_category(name: str) -> str:
    """The MINC category that a known name outside MINC is filed under: its own, or the one with the same row, else `other`."""
    try:
        found = resolve(name)
    except MaterialError:
        return name  # for the schema to refuse
    if found.category is not None:
        return found.category
    return next((category for category in CATEGORIES if row(category).material == found.material), "other")


def _said(problem: Any) -> str:
    where = ".".join(map(str, problem.absolute_path))
    return f"{where}: {problem.message}" if where else problem.message
