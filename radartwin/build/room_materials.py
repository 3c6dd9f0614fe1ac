"""What a recording's room was made of, and who said so: for its provenance, and a line for the terminal."""

from __future__ import annotations

import hashlib
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin.config.materials import MaterialsConfig
from radartwin.config.scene import SceneConfig

if TYPE_CHECKING:
    from radartwin.scene.scene import Scene

SHOWN = 4  # materials named in the line


def made_of(room: Scene, scene: SceneConfig, materials: MaterialsConfig) -> dict[str, Any]:
    """Which scene and which materials, as plain JSON values.

    Args:
        room: with the materials of the configured source, the target not in it.
    Returns:
        "scene": {name, of a scan also its file's or folder's name and the SHA-256 of its mesh or manifest}; "materials": {source,
        said_by: surfaces by who labelled them, surfaces: how many of each material, most first}.
    """
    from radartwin.label.labels import belongs_to_room
    from radartwin.scene.storage import MANIFEST, scene_folder
    from radartwin.scene.viewer.colouring import material_label

    described: dict[str, Any] = {"name": scene.name}
    if scene.path is not None:
        folder = scene_folder(Path(scene.path))
        file = Path(scene.path) if folder is None else folder / MANIFEST
        described["path"] = (folder or file).resolve().name
        described["sha256" if folder is None else "manifest_sha256"] = hashlib.sha256(file.read_bytes()).hexdigest()
    surfaces = [surface for surface in room if belongs_to_room(surface)]
    said = Counter(str(s.provenance.get("model") or s.provenance.get("source") or "nobody") for s in surfaces)
    counted = Counter(material_label(s.material) for s in surfaces)
    told = {"source": materials.source, "said_by": dict(said.most_common()), "surfaces": dict(counted.most_common())}
    return {"scene": described, "materials": told}


def line(told: dict[str, Any]) -> str:
    """What `made_of` found, for people; empty where there is no room."""
    scene, materials = told["scene"], told["materials"]
    counted: dict[str, int] = materials["surfaces"]
    if not counted:
        return ""
    listed = [f"{label} on {count}" for label, count in list(counted.items())[:SHOWN]]
    listed += [f"others on {sum(list(counted.values())[SHOWN:])}"] if len(counted) > SHOWN else []
    what = f"materials of the room's {sum(counted.values())} surfaces: {', '.join(listed)}"
    if materials["source"] == "scene":
        return f"{what}; as labelled in {scene['path']} by {', '.join(materials['said_by'])}"
    instead = f"; the labels in {scene['path']} are not used" if "manifest_sha256" in scene and materials["source"] != "vlm" else ""
    return f"{what}; materials={materials['source']}{instead}"
