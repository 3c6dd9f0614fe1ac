"""An answer about one surface: what it must look like, and the material it stands for.

The schema admits one of the 23 MINC categories, a confidence, a reason and, where the category says too little, the material's own name:
what is under paint, what "other" is. About objects it also asks for the thickness of the wall and what is inside, from which a layered
shell is built. Whoever answers gets the schema's own complaint and another try.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from radartwin.errors import LabelError, MaterialError
from radartwin.materials import Layered, roughness_m
from radartwin.materials.minc import BUILD_UPS, CATEGORIES, COVERED, Row, row
from radartwin.materials.names import PERMITTIVITY, Resolved, mentioned, resolve
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
REASON_CHARACTERS, NAME_CHARACTERS = 400, 80


@dataclass(frozen=True)
class Answer:
    """What somebody said of a surface.

    Attributes:
        material: MINC category.
        confidence: 0 to 1, None where nobody said.
        wall_thickness_mm, contents: of objects; None where not asked or not known.
        named: the material in the answerer's own words, more exact than the category; None where it adds nothing.
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
        "name": {"type": ["string", "null"], "maxLength": NAME_CHARACTERS},
    }
    if kind == "object":
        fields["wall_thickness_mm"] = {"type": ["number", "null"], "exclusiveMinimum": 0, "maximum": 500}
        fields["contents"] = {"type": "string", "enum": list(CONTENTS)}
    required = [field for field in fields if field != "name"]
    return json.dumps({"type": "object", "properties": fields, "required": required, "additionalProperties": False})


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
    name = str(value.pop("name", None) or "").strip() or None
    return Answer(**value, named=named or name)


def material_of(answer: Answer) -> tuple[str | Layered, float, bool]:
    """Material, roughness (metres) and whether it is a stand-in or an uncertain build-up, of an answer.

    >>> material_of(Answer("painted", named="concrete"))[0], material_of(Answer("other", named="mineral fibre ceiling tiles"))[0]
    ('concrete', Layered(layers=(('ceiling_board', 0.015),), backing='air'))
    """
    entry = row(answer.material)
    found = specified(answer)
    base, rough = entry.material, entry.roughness_m
    if found is not None:
        base = _build_up(found, entry)
        texture = next((n for n in (found.name, found.material) if isinstance(n, str) and n in CLASSES), None)
        rough = roughness_m(texture) if texture and answer.material not in COVERED else rough
    shell = interior(base, answer.wall_thickness_mm, answer.contents)
    own = found is None or found.category in (answer.material, *COVERED)  # a category's build-up, which the words may confirm
    stand_in = entry.stand_in(exact=found is not None or shell != base) if own or found is None else found.stand_in
    return shell, rough, stand_in or (shell != base and answer.contents not in ("empty", "solid", "unknown"))


def specified(answer: Answer) -> Resolved | None:
    """What an answer's own words say beyond its category; None where they say nothing known, or another category's material.

    Under paint and wallpaper anything may be; elsewhere a name that belongs to another category contradicts the one chosen, which stands.
    Of one thing on another, paint shows what is below and all else what is above.
    """
    parts = re.split(r"\b(?:on|onto|over)\b", answer.named or "")
    found = mentioned(parts[-1 if answer.material in COVERED else 0]) or mentioned(answer.named or "")
    if found is None or found.name == answer.material:
        return None
    agrees = found.category in (None, answer.material) or answer.material in (*COVERED, "other")
    return found if agrees else None


def _build_up(found: Resolved, entry: Row) -> str | Layered:
    """What a named material is commonly built as: its own row's stack, its common sheet, or a sheet of the category's thickness."""
    if isinstance(found.material, Layered):
        return found.material
    if found.material in BUILD_UPS and found.name not in PERMITTIVITY and found.category is None:
        return BUILD_UPS[found.material]
    usual = entry.material
    plain = found.category is None and found.material != "metal"
    if plain and isinstance(usual, Layered) and len(usual.layers) == 1 and usual.backing == "air":
        return Layered([(found.material, usual.layers[0][1])])
    return found.material


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
    except (ValueError, RecursionError) as error:
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
