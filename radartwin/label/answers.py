"""Parse and check a model's answer to a material question about one surface, and derive the surface's material from the answer.

Each answer of the model has one of the 23 MINC material categories, a finish, a confidence, a reason and an optional material name. The
finish is a word for the roughness of the surface, and determines its rms height. The material name states a material that the MINC category
does not determine, such as the material under paint, or a material in the category "other". If the question is about an object, the model's
answer also has the object's wall thickness and contents, from which a layered shell is built. If a model's answer violates the JSON schema,
the model receives the schema's error message and must answer the question again.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from radartwin.errors import LabelError, MaterialError
from radartwin.materials import MATERIAL_THICKNESS, Layered, half_space, layered
from radartwin.materials.minc import BUILD_UPS, CATEGORIES, COVERED, Row, row
from radartwin.materials.names import PERMITTIVITY, Resolved, mentioned, resolve
from radartwin.materials.roughness import CLASSES, FINISHES, Roughness

Kind = Literal["surface", "object"]

# This table gives the material that fills an object, for each kind of contents; None stands for a solid object or unknown contents.
CONTENTS: dict[str, str | None] = {
    "empty": "air",
    "water-like liquid": "water",
    "oil-like liquid": "oil",
    "moist food or paste": "mustard",
    "solid": None,
    "unknown": None,
}
FINISH_WORDS = (*FINISHES, "unknown")
REASON_CHARACTERS, NAME_CHARACTERS = 400, 80


@dataclass(frozen=True)
class Answer:
    """The answer of a model or a person to the question which material a surface has.

    Attributes:
        material: MINC category of the surface's material.
        confidence: confidence of the model or person in the answer, from 0 to 1; None if the answer states no confidence.
        wall_thickness_mm: thickness of an object's wall in millimetres; None if unknown or if the surface is no object.
        contents: filling of an object, as one of the words in CONTENTS; None if unknown or if the surface is no object.
        finish: roughness of the surface, as one of FINISH_WORDS; None in answers to earlier questions, which did not ask for a finish.
        named: name of a material, if this name is more exact than the MINC category; None otherwise.
        invalid: True if the model gave no valid answer in any attempt; `material` is then "other".
    """

    material: str
    confidence: float | None = None
    reason: str = ""
    wall_thickness_mm: float | None = None
    contents: str | None = None
    finish: str | None = None
    named: str | None = None
    invalid: bool = False
    attempts: int = 1

    def to_dict(self) -> dict[str, Any]:
        """Return, as JSON-compatible values, the fields of this answer that differ from their defaults."""
        default = asdict(Answer(""))
        return {key: value for key, value in asdict(self).items() if key == "material" or value != default[key]}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Answer:
        """Make an answer from the JSON-compatible values that `to_dict` returned."""
        try:
            answer = cls(**values)
        except TypeError as error:
            raise LabelError(f"a recorded answer is invalid ({error})") from error
        if answer.material not in CATEGORIES:
            raise LabelError(f"a recorded answer has {answer.material!r}, which is not a MINC category")
        if answer.finish not in (None, *FINISH_WORDS):
            raise LabelError(f"a recorded answer has the unknown finish {answer.finish!r}")
        return answer

    @classmethod
    def none(cls, why: str, attempts: int) -> Answer:
        """Return an answer with the category "other", for a surface about which the model gave no valid answer."""
        return cls("other", 0.0, f"no valid answer in {attempts} attempts: {why}"[:REASON_CHARACTERS], invalid=True, attempts=attempts)


@functools.cache
def schema(kind: Kind) -> dict[str, Any]:
    """Return the JSON schema of the answer to a material question; the question is about a "surface" of the room or an "object"."""
    fields: dict[str, Any] = {
        "material": {"type": "string", "enum": list(CATEGORIES)},
        "finish": {"type": "string", "enum": list(FINISH_WORDS)},
        "confidence": {"type": "number", "minimum": 0, "maximum": 1},
        "reason": {"type": "string", "maxLength": REASON_CHARACTERS},
        "name": {"type": ["string", "null"], "maxLength": NAME_CHARACTERS},
    }
    if kind == "object":
        fields["wall_thickness_mm"] = {"type": ["number", "null"], "exclusiveMinimum": 0, "maximum": 500}
        fields["contents"] = {"type": "string", "enum": list(CONTENTS)}
    required = [field for field in fields if field != "name"]
    return {"type": "object", "properties": fields, "required": required, "additionalProperties": False}


def read_answer(text: str | Mapping[str, Any], kind: Kind, names: bool = False) -> Answer:
    """Parse a model's answer to a material question from text or from a JSON object, and check the answer against the JSON schema.

    Args:
        names: True to replace a material outside the MINC categories by its closest MINC category, if `radartwin.materials.names` knows
            the material.
    Raises:
        LabelError: the answer violates the schema; the error message can be sent to the model so that it answers again.

    >>> read_answer('Sure: {"material": "wood", "finish": "smooth", "confidence": 0.9, "reason": "grain"}', "surface").material
    'wood'
    """
    from jsonschema import Draft202012Validator

    value = dict(text) if isinstance(text, Mapping) else _first_object(text)
    named = None
    if names and isinstance(value.get("material"), str) and value["material"] not in CATEGORIES:
        named, value = value["material"], {**value, "material": _closest_category(value["material"])}
    problems = sorted(Draft202012Validator(schema(kind)).iter_errors(value), key=lambda e: list(map(str, e.absolute_path)))
    if problems:
        raise LabelError("; ".join(_message(problem) for problem in problems))
    name = str(value.pop("name", None) or "").strip() or None
    return Answer(**value, named=named or name)


def material_of(answer: Answer) -> tuple[str | Layered, Roughness, bool]:
    """Return (material, roughness, stand_in) for a model's answer; stand_in is True for a substitute material or uncertain
    layers.

    The finish of the answer determines the rms height of the roughness. The roughness class of the material determines the correlation
    length, and also the rms height if the answer states no finish or the finish "unknown".

    >>> material_of(Answer("painted", named="concrete"))[0], material_of(Answer("other", named="mineral fibre ceiling tiles"))[0]
    ('concrete', Layered(layers=(('ceiling_board', 0.015),), backing='air'))
    """
    entry = row(answer.material)
    resolved = specified(answer)
    base, rough = entry.material, CLASSES[entry.texture]
    if resolved is not None:
        base = _build_up(resolved, entry)
        texture = next((n for n in (resolved.name, resolved.material) if isinstance(n, str) and n in CLASSES), None)
        rough = CLASSES[texture] if texture and answer.material not in COVERED else rough
    if answer.finish in FINISHES:
        height_m, source = FINISHES[answer.finish]
        rough = Roughness(height_m, rough.correlation_m, source)
    shell = interior(base, answer.wall_thickness_mm, answer.contents)
    # If the material name in the answer agrees with the MINC category, the layers of that category count as known.
    confirms = resolved is None or resolved.category in (answer.material, *COVERED)
    stand_in = entry.stand_in(exact=resolved is not None or shell != base) if confirms or resolved is None else resolved.stand_in
    return shell, rough, stand_in or (shell != base and answer.contents not in ("empty", "solid", "unknown"))


def specified(answer: Answer) -> Resolved | None:
    """Return the material that the name in a model's answer specifies.

    The result is None if the name is unknown, or if the named material belongs to another MINC category than the answer states. The MINC
    categories for paint and wallpaper are exceptions, because paint may cover a material of any category. A name such as "tile on concrete"
    contains two materials: the lower material is used if the answer's MINC category is a cover such as paint, otherwise the upper material.
    """
    parts = re.split(r"\b(?:on|onto|over)\b", answer.named or "")
    resolved = mentioned(parts[-1 if answer.material in COVERED else 0]) or mentioned(answer.named or "")
    if resolved is None or resolved.name == answer.material:
        return None
    agrees = resolved.category in (None, answer.material) or answer.material in (*COVERED, "other")
    return resolved if agrees else None


def _build_up(resolved: Resolved, entry: Row) -> str | Layered:
    """Return the usual layers of the named material `resolved`. The row `entry` belongs to the MINC category in the answer."""
    if isinstance(resolved.material, Layered):
        return resolved.material
    if resolved.material in BUILD_UPS and resolved.name not in PERMITTIVITY and resolved.category is None:
        return BUILD_UPS[resolved.material]
    usual = entry.material
    plain = resolved.category is None and resolved.material != "metal"
    if plain and isinstance(usual, Layered) and len(usual.layers) == 1 and usual.backing == "air":
        return Layered([(resolved.material, usual.layers[0][1])])
    if resolved.name in PERMITTIVITY and resolved.material in MATERIAL_THICKNESS:
        return half_space(resolved.material)  # the substitute has the reflection of a half-space
    return resolved.material


def interior(material: str | Layered, wall_thickness_mm: float | None, contents: str | None) -> str | Layered:
    """Return the wall of a hollow object as a single layer of the outermost material in `material`, backed by the material of the contents.

    `material` is returned unchanged if the wall thickness or the contents are unknown, and if the outermost material is metal or air.

    >>> interior("hdpe", 1.0, "water-like liquid")
    Layered(layers=(('hdpe', 0.001),), backing='water')
    """
    inside = CONTENTS.get(contents) if contents is not None else None
    outer = half_space(material).backing
    if inside is None or wall_thickness_mm is None or outer in ("metal", "air", "vacuum"):
        return material
    return Layered([(outer, wall_thickness_mm / 1000)], backing=inside)


def _first_object(text: str) -> dict[str, Any]:
    """Return the first JSON object in the text of a model. Language models often write words and code fences around the JSON object."""
    start = text.find("{")
    if start < 0:
        raise LabelError(f"no JSON object in {text.strip()[:80]!r}")
    try:
        value, _ = json.JSONDecoder().raw_decode(text[start:])
    except (ValueError, RecursionError) as error:
        raise LabelError(f"not valid JSON ({error})") from error
    return value


def _closest_category(name: str) -> str:
    """Return the MINC category that a name outside MINC stands for, else a category with the same material, else `other`."""
    try:
        resolved = resolve(name)
    except MaterialError:
        return name  # an unknown material name stays in the answer, so that the answer violates the schema
    if resolved.category is not None:
        return resolved.category
    same = (layered(resolved.material), half_space(resolved.material))
    return next((category for category in CATEGORIES if layered(row(category).material) in same), "other")


def _message(problem: Any) -> str:
    where = ".".join(map(str, problem.absolute_path))
    return f"{where}: {problem.message}" if where else problem.message
