"""Describe the scene and the materials of a recording, for its provenance and as a line for the terminal."""

from __future__ import annotations

import hashlib
from collections import Counter
from pathlib import Path
from typing import Any

from radartwin.config.materials import MaterialsConfig
from radartwin.config.scene import ScanScene, SceneConfig
from radartwin.label.labels import belongs_to_room
from radartwin.scene.scene import Scene
from radartwin.scene.storage import MANIFEST, scene_folder
from radartwin.scene.viewer.colouring import material_label

LISTED = 4  # materials named in the line


def describe_room(room: Scene, scene: SceneConfig, materials: MaterialsConfig) -> dict[str, Any]:
    """Describe the scene and its materials as plain JSON values.

    Args:
        room: the scene without the target, with the materials of the configured source.
    Returns:
        "scene": {name; for a scan also the name of its file or folder and the SHA-256 of its mesh or manifest}. "materials": {source;
        said_by: number of surfaces by labeller; surfaces: number of surfaces by material, largest first}.
    """
    described: dict[str, Any] = {"name": scene.name}
    if isinstance(scene, ScanScene):
        folder = scene_folder(Path(scene.path))
        file = Path(scene.path) if folder is None else folder / MANIFEST
        described["path"] = (folder or file).resolve().name
        described["sha256" if folder is None else "manifest_sha256"] = hashlib.sha256(file.read_bytes()).hexdigest()
    surfaces = [surface for surface in room if belongs_to_room(surface)]
    labellers = Counter(str(s.provenance.get("model") or s.provenance.get("source") or "nobody") for s in surfaces)
    labels = Counter(material_label(s.material) for s in surfaces)
    counts = {"source": materials.source, "said_by": dict(labellers.most_common()), "surfaces": dict(labels.most_common())}
    return {"scene": described, "materials": counts}


def materials_line(provenance: dict[str, Any]) -> str:
    """Return the result of `describe_room` as a sentence; an empty string for a scene without a room."""
    scene, materials = provenance["scene"], provenance["materials"]
    counts: dict[str, int] = materials["surfaces"]
    if not counts:
        return ""
    listed = [f"{label} on {count}" for label, count in list(counts.items())[:LISTED]]
    listed += [f"others on {sum(list(counts.values())[LISTED:])}"] if len(counts) > LISTED else []
    text = f"materials of the room's {sum(counts.values())} surfaces: {', '.join(listed)}"
    if materials["source"] == "scene":
        return f"{text}; as labelled in {scene['path']} by {', '.join(materials['said_by'])}"
    unused = f"; the labels in {scene['path']} are not used" if "manifest_sha256" in scene and materials["source"] != "vlm" else ""
    return f"{text}; materials={materials['source']}{unused}"
