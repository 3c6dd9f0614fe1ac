"""Build the configured scene, in the world frame of radartwin/scene/rooms, and describe it for the provenance of a recording.

The target's origin is the point at which the radar aims.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.config.materials import MaterialsConfig, UniformMaterials
from radartwin.config.scene import ROOMS, ScanScene, SceneConfig
from radartwin.errors import ConfigError
from radartwin.io.one_line import plural
from radartwin.label.material_sources import material_source
from radartwin.label.surface_labels import belongs_to_room
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.storage import MANIFEST, scene_folder
from radartwin.scene.viewer.colouring import material_label

TARGET = "target"  # name of the target's surfaces
LISTED = 4  # materials that `materials_line` names


def build_target(config: SceneConfig, contents: str = "filled") -> tuple[Surface, ...]:
    """Return the target's surfaces, all named TARGET and facing -x towards the radar (`contents`: see `Entry.surfaces`)."""
    size = config.target_size_m
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    if config.target == "none":
        return ()
    if config.target == "corner_reflector":
        mesh = objects.trihedral(size)
    elif config.target == "plate":
        mesh = objects.plate(size, size)
    elif config.target == "sphere":
        mesh = objects.sphere(size / 2)
    else:
        entry = objects.entry(config.target)
        turned[2, 3] = -entry.aim_m
        return entry.surfaces(turned, name=TARGET, contents=contents)
    return (Surface(mesh.apply_transform(turned), "metal", TARGET, role="object"),)


def lowest_m(target: Sequence[Surface]) -> float:
    """Return the height in metres of the target's lowest point above its origin (negative); 0 without a target."""
    return min((float(surface.mesh.bounds[0, 2]) for surface in target), default=0.0)


def build_room(scene: SceneConfig, materials: MaterialsConfig, seed: int = 0) -> Scene:
    """Build the room without the target, with materials from the configured source. `seed` draws random materials."""
    if isinstance(scene, ScanScene):
        room = load_scan(Path(scene.path), materials)
    elif scene.name in ROOMS:
        room = rooms.room(scene.name, **scene.room_options())
    else:
        return rooms.void() if scene.name == "void" else rooms.empty()
    return material_source(materials.source, **materials.arguments(seed))(room)


def load_scan(path: Path, materials: MaterialsConfig) -> Scene:
    """Load a scanned room from a labelled scene folder, or from a mesh file without labels. Raises UserError, see `Scene.load`."""
    if not path.exists() or scene_folder(path) is not None:
        return Scene.load(path)
    if materials.source == "scene":
        raise ConfigError(
            f"{path} carries no material labels; make it a scene with radartwin reconstruct {path} --out FOLDER, "
            "or add materials=uniform materials.material=NAME for one material"
        )
    return Scene.load(path, material=materials.material if isinstance(materials, UniformMaterials) else UniformMaterials.material)


def add_layout(config: SceneConfig, room: Scene, sensor_pose: np.ndarray) -> Scene:
    """Place the objects of the configured layout file or sentence in the room. Raises UserError if it cannot be read or placed."""
    if not (config.layout or config.sentence):
        return room
    from radartwin.scene.layouts.grammar import parse
    from radartwin.scene.layouts.layout import Layout
    from radartwin.scene.layouts.place import furnish

    return furnish(room, Layout.load(config.layout) if config.layout else parse(str(config.sentence)), sensor_pose)


def describe_room(room: Scene, scene: SceneConfig, materials: MaterialsConfig) -> dict[str, Any]:
    """Describe the room, without the target, in JSON values for the provenance of a recording.

    Returns:
        "scene": {name; of a scan also name and SHA-256 of its file}. "materials": {source; said_by: number of surfaces for each labeller;
        surfaces: number of surfaces for each material, largest first}.
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
    """Return the result of `describe_room` as a sentence, or an empty string for a scene without a room."""
    scene, materials = provenance["scene"], provenance["materials"]
    counts: dict[str, int] = materials["surfaces"]
    if not counts:
        return ""
    listed = [f"{label} on {count}" for label, count in list(counts.items())[:LISTED]]
    listed += [f"others on {sum(list(counts.values())[LISTED:])}"] if len(counts) > LISTED else []
    text = f"materials of the room's {plural(sum(counts.values()), 'surface')}: {', '.join(listed)}"
    if materials["source"] == "scene":
        return f"{text}; as labelled in {scene['path']} by {', '.join(materials['said_by'])}"
    unused = f"; the labels in {scene['path']} are not used" if "manifest_sha256" in scene and materials["source"] != "vlm" else ""
    return f"{text}; materials={materials['source']}{unused}"
