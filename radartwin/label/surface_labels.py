"""Define material labels of surfaces, apply the labels to a scene, and save them in the scene's manifest.

A material label is the material of a surface together with its provenance. The provenance of a material label has four keys that every
source of labels sets: source, confidence (None if not given), stand_in (whether a material of ITU-R P.2040 substitutes the actual material)
and minc (the MINC category, or None). The provenance of the surface's geometry stays unchanged beside the provenance of its label.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radartwin.errors import LabelError, SceneError
from radartwin.io import untrusted_json
from radartwin.io.files import write_atomically
from radartwin.label.answers import material_of
from radartwin.label.journal import Record
from radartwin.label.surface_match import overlap, place_of
from radartwin.materials import CORRELATION_M, Layered
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.storage import MANIFEST, material_to_json

VLM = "vlm"
SCANNED = {"segment", "planar"}  # provenance keys that only surfaces from a scan have
# These provenance keys belong to a surface's material label. All other keys belong to the geometry, and stay when the label changes.
LABEL_KEYS = (
    "source", "confidence", "stand_in", "minc", "model", "reason", "provider", "transferred", "covered", "key", "named", "invalid",
    "missing", "wall_thickness_mm", "contents", "finish", "wrong",
)  # fmt: skip


def belongs_to_room(surface: Surface) -> bool:
    """Return whether material sources label the surface: True for surfaces of the room, and for all surfaces of a scan."""
    return surface.kind == "room" or not SCANNED.isdisjoint(surface.provenance)


@dataclass(frozen=True)
class Label:
    """The new material and roughness of a surface, with the provenance of this material."""

    material: str | Layered
    roughness_m: float
    provenance: Mapping[str, Any]
    correlation_m: float = CORRELATION_M


def labelled(
    scene: Scene, answers: Mapping[int, Record], indices: Sequence[int], missing: Label | None, transferred: Callable[[int], bool]
) -> Scene:
    """Set the materials of the surfaces with the given indices from the model's answers about these surfaces.

    All other surfaces stay unchanged.

    Args:
        answers: record of the model's answer about a surface, by surface index.
        indices: indices of the surfaces that get a new material.
        missing: material label of surfaces without an answer; None raises a LabelError that names these surfaces.
        transferred: function of a surface index that returns True if the answer was given about another scan of the room.
    """
    unanswered = [scene.surfaces[i].name or str(i) for i in indices if i not in answers]
    if unanswered and missing is None:
        raise LabelError(
            f"{len(unanswered)} of {len(indices)} surfaces have no answer: {', '.join(unanswered)}; "
            "ask again, or give their material (--missing uniform:plasterboard, materials.missing=plasterboard)"
        )
    selected = set(indices)

    def rule(index: int, surface: Surface) -> Label | None:
        if index not in selected:
            return None
        if index not in answers:
            assert missing is not None
            return dataclasses.replace(missing, provenance={**missing.provenance, "missing": True})
        return answer_label(answers[index], surface, transferred(index))

    return relabelled(scene, rule, VLM)


def answer_label(given: Record, surface: Surface, transferred: bool = False) -> Label:
    """Make the material label of a surface from a model's answer.

    If the answer was given about another scan (`transferred`), the label's confidence is the answer's confidence times the share of the
    surface that overlaps the surface of the other scan.
    """
    answer = given.answer
    material, roughness, stand_in = material_of(answer)
    provenance: dict[str, Any] = {
        "source": VLM, "confidence": answer.confidence, "stand_in": stand_in, "minc": answer.material, "model": given.model,
        "reason": answer.reason, "provider": given.provider, "key": given.key[:12],
    }  # fmt: skip
    stated = ("named", "wall_thickness_mm", "contents", "finish")
    provenance |= {key: value for key in stated if (value := getattr(answer, key)) is not None}
    provenance |= {key: True for key, holds in (("invalid", answer.invalid), ("transferred", transferred)) if holds}
    if transferred:
        covered = overlap(place_of(surface.mesh), given.place)
        confidence = None if answer.confidence is None else round(answer.confidence * covered, 3)
        provenance |= {"covered": round(covered, 3), "confidence": confidence}
    return Label(material, roughness.height_m, provenance, roughness.correlation_m)


def relabelled(scene: Scene, rule: Callable[[int, Surface], Label | None], source: str) -> Scene:
    """Replace the materials of the surfaces of the room and of a scan by the materials that `rule` returns.

    All other surfaces stay unchanged, as does a surface for which `rule` returns None.
    """
    surfaces = []
    for index, surface in enumerate(scene):
        label = rule(index, surface) if belongs_to_room(surface) else None
        if label is not None:
            geometry = {key: value for key, value in surface.provenance.items() if key not in LABEL_KEYS}
            surface = surface.replaced(
                material=label.material, roughness_m=label.roughness_m, correlation_m=label.correlation_m,
                provenance={**geometry, **label.provenance},
            )  # fmt: skip
        surfaces.append(surface)
    return Scene(surfaces, {**scene.provenance, "materials": source})


def write_labels(folder: Path, scene: Scene) -> Path:
    """Write the materials of a scene's surfaces to the manifest in `folder`, which must list the same surfaces."""
    path = folder / MANIFEST
    manifest = untrusted_json.read(path)
    entries = manifest["surfaces"]
    if [entry.get("name", "") for entry in entries] != list(scene.names):
        raise SceneError(f"{path} changed during the labelling; run the same command again, which reuses the answers")
    for entry, surface in zip(entries, scene, strict=True):
        entry["material"] = material_to_json(surface.material)
        entry["roughness_m"], entry["correlation_m"] = float(surface.roughness_m), float(surface.correlation_m)
        entry["provenance"] = dict(surface.provenance)
    manifest["provenance"] = dict(scene.provenance)
    return write_atomically(path, json.dumps(manifest, indent=1, allow_nan=False) + "\n")
