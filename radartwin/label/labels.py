"""Labels: what a surface is made of with who says so, and how they are put on a scene.

The provenance of a labelled surface has who labelled it (source), how sure that is (confidence, None where nobody said), whether a P.2040
row stands in for something it is not (stand_in) and the MINC category (minc, None where there is none). What is known of its geometry
stays beside it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from radartwin.errors import LabelError
from radartwin.label.answers import Answer, material_of
from radartwin.label.journal import Record
from radartwin.label.place import overlap, place_of
from radartwin.materials import Layered
from radartwin.scene.scene import Scene, Surface

VLM = "vlm"
SCANNED = {"segment", "planar"}  # facts that only a scan's surfaces carry
# What a label says, as opposed to what is known of the geometry, which outlives it.
LABEL_KEYS = (
    "source", "confidence", "stand_in", "minc", "model", "reason", "provider", "transferred", "covered", "key", "named", "invalid",
    "missing", "wall_thickness_mm", "contents", "wrong",
)  # fmt: skip


def belongs_to_room(surface: Surface) -> bool:
    """Whether a source labels it: large things, and all that a scan brought, whose surfaces say what segment they are."""
    return surface.kind == "room" or not SCANNED.isdisjoint(surface.provenance)


@dataclass(frozen=True)
class Label:
    """A surface's new material and what its provenance says of it."""

    material: str | Layered
    roughness_m: float
    provenance: Mapping[str, Any]


def labelled(
    scene: Scene,
    found: Mapping[int, str | Layered | Answer | Record],
    asked: Sequence[int],
    missing: Label | None = None,
    transferred: bool | Callable[[int], bool] = False,
) -> Scene:
    """The scene with the answers found, by surface index, for the surfaces asked about; all others stay as they are.

    Args:
        missing: what unanswered surfaces take.
        transferred: whether an answer was given about another scan of the surface.
    Raises:
        LabelError: unanswered surfaces and no `missing`, all of them named.
    """
    left = [scene.surfaces[i].name or str(i) for i in asked if i not in found]
    if left and missing is None:
        raise LabelError(
            f"nobody answered for {len(left)} of {len(asked)} surfaces: {', '.join(left)}; "
            "ask again, or give what they take (--missing uniform:plasterboard, materials.missing=plasterboard)"
        )
    wanted = set(asked)

    def answered(index: int, surface: Surface) -> Label | None:
        if index not in wanted:
            return None
        if index not in found:
            assert missing is not None
            return dataclasses.replace(missing, provenance={**missing.provenance, "missing": True})
        moved = transferred(index) if callable(transferred) else transferred
        return answer_label(found[index], surface, moved)

    return relabelled(scene, answered, VLM)


def answer_label(given: str | Layered | Answer | Record, surface: Surface, transferred: bool = False) -> Label:
    """The label that an answer gives a surface; one transferred from another scan is as sure as the share of the surface it covers."""
    told: dict[str, Any] = {"source": VLM}
    answer = given.answer if isinstance(given, Record) else given
    if not isinstance(answer, Answer):
        return Label(
            answer, surface.roughness_m, {**told, "confidence": None, "stand_in": False, "minc": None, "model": None, "reason": ""}
        )
    material, roughness, stand_in = material_of(answer)
    told |= {"confidence": answer.confidence, "stand_in": stand_in, "minc": answer.material, "model": None, "reason": answer.reason}
    if isinstance(given, Record):
        told |= {"model": given.model, "provider": given.provider, "key": given.key[:12]}
    told |= {key: value for key in ("named", "wall_thickness_mm", "contents") if (value := getattr(answer, key)) is not None}
    told |= {key: True for key, holds in (("invalid", answer.invalid), ("transferred", transferred)) if holds}
    if transferred and isinstance(given, Record):
        covered = overlap(place_of(surface.mesh), given.place)
        told |= {"covered": round(covered, 3), "confidence": None if answer.confidence is None else round(answer.confidence * covered, 3)}
    return Label(material, roughness, told)


def relabelled(scene: Scene, rule: Callable[[int, Surface], Label | None], source: str) -> Scene:
    """The scene with the rule's labels on what belongs to the room; None keeps a surface's own."""
    surfaces = []
    for index, surface in enumerate(scene):
        label = rule(index, surface) if belongs_to_room(surface) else None
        if label is not None:
            geometry = {key: value for key, value in surface.provenance.items() if key not in LABEL_KEYS}
            surface = surface.replaced(material=label.material, roughness_m=label.roughness_m, provenance={**geometry, **label.provenance})
        surfaces.append(surface)
    return Scene(surfaces, {**scene.provenance, "materials": source})
