"""Parse and check an answer about one surface, and derive the surface's material from the answer.

An answer has one of the 23 MINC categories, a confidence, a reason and an optional name. The name states a material that the category does
not determine, such as the material under paint, or a material in "other". For objects, the answer also has the wall thickness and the
contents, from which a layered shell is built. If an answer violates the schema, the model receives the schema's error message and is asked
again.
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

# The material for each kind of contents; None for a solid object or unknown contents.
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
    """The answer of a model or a person about a surface.

    Attributes:
        material: MINC category.
        confidence: 0 to 1, or None if the answer has none.
        wall_thickness_mm, contents: for objects; None if unknown.
        named: name of the material, if it is more exact than the category.
        invalid: whether all attempts were invalid, so that `material` is "other".
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
        """Return the fields that differ from their defaults, as plain values."""
        default = asdict(Answer(""))
        return {key: value for key, value in asdict(self).items() if key == "material" or value != default[key]}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Answer:
        """Make an answer from plain values; the inverse of `to_dict`."""
        try:
            answer = cls(**values)
        except TypeError as error:
            raise LabelError(f"a recorded answer is invalid ({error}); record it again") from error
        if answer.material not in CATEGORIES:
            raise LabelError(f"a recorded answer has {answer.material!r}, which is not a MINC category; record it again")
        return answer

    @classmethod
    def none(cls, why: str, attempts: int) -> Answer:
        """Return the answer "other" for a surface that got no valid answer."""
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
    """Return the JSON schema of an answer about a "surface" or an "object"."""
    return json.loads(_schema(kind))


def read_answer(text: str | Mapping[str, Any], kind: Kind, names: bool = False) -> Answer:
    """Parse an answer from the text of a model or from a JSON object, and check it against the schema.

    Args:
        names: whether to replace a material outside MINC by its closest category, if `radartwin.materials.names` knows the material.
    Raises:
        LabelError: the answer is invalid; the message can be sent to the model.

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
        raise LabelError("; ".join(_message(problem) for problem in problems))
    name = str(value.pop("name", None) or "").strip() or None
    return Answer(**value, named=named or name)


def material_of(answer: Answer) -> tuple[str | Layered, float, bool]:
    """Derive the material of an answer, its roughness in metres, and whether it is a substitute material or has uncertain layers.

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
    # If the name confirms the layers of the category, they are exact.
    confirms = found is None or found.category in (answer.material, *COVERED)
    stand_in = entry.stand_in(exact=found is not None or shell != base) if confirms or found is None else found.stand_in
    return shell, rough, stand_in or (shell != base and answer.contents not in ("empty", "solid", "unknown"))


def specified(answer: Answer) -> Resolved | None:
    """Return the material that the answer's name specifies; None if the name is unknown, or names a material of another category.

    Paint and wallpaper may cover any material. For all other categories, a name of another category contradicts the answer, and the
    category is used. In a name such as "tile on concrete", the lower material is used if the category is a cover such as paint, otherwise
    the upper material.
    """
    parts = re.split(r"\b(?:on|onto|over)\b", answer.named or "")
    found = mentioned(parts[-1 if answer.material in COVERED else 0]) or mentioned(answer.named or "")
    if found is None or found.name == answer.material:
        return None
    agrees = found.category in (None, answer.material) or answer.material in (*COVERED, "other")
    return found if agrees else None


def _build_up(found: Resolved, entry: Row) -> str | Layered:
    """Return the usual layers of a named material: those of its table row, or its common sheet, or a sheet as thick as the category's."""
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
    """Return a shell of the material's outermost layer, backed by the contents; the material itself if the wall or contents are unknown.

    >>> interior("hdpe", 1.0, "water-like liquid")
    Layered(layers=(('hdpe', 0.001),), backing='water')
    """
    inside = CONTENTS.get(contents) if contents is not None else None
    outer = material if isinstance(material, str) else material.layers[0][0]
    if inside is None or wall_thickness_mm is None or outer in ("metal", "air", "vacuum"):
        return material
    return Layered([(outer, wall_thickness_mm / 1000)], backing=inside)


def _first_object(text: str) -> dict[str, Any]:
    """Return the first JSON object in a text. Models often write words and code fences around it."""
    start = text.find("{")
    if start < 0:
        raise LabelError(f"no JSON object in {text.strip()[:80]!r}")
    try:
        value, _ = json.JSONDecoder().raw_decode(text[start:])
    except (ValueError, RecursionError) as error:
        raise LabelError(f"not valid JSON ({error})") from error
    return value


def _closest_category(name: str) -> str:
    """Return the closest MINC category of a known name outside MINC: its own, or that of the same material, or `other`."""
    try:
        found = resolve(name)
    except MaterialError:
        return name  # an unknown name violates the schema
    if found.category is not None:
        return found.category
    return next((category for category in CATEGORIES if row(category).material == found.material), "other")


def _message(problem: Any) -> str:
    where = ".".join(map(str, problem.absolute_path))
    return f"{where}: {problem.message}" if where else problem.message
