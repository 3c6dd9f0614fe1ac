"""Labels into the manifest of a scene folder: materials, roughness and provenance change, the geometry and its colours stay as they are."""

from __future__ import annotations

import json
from pathlib import Path

from radartwin.errors import SceneError
from radartwin.io import untrusted_json
from radartwin.io.files import write_atomically
from radartwin.scene.scene import Scene
from radartwin.scene.storage import material_to_json

MANIFEST = "manifest.json"


def write_labels(folder: Path, scene: Scene) -> Path:
    """Give the scene saved in a folder the labels of `scene`, which is that scene relabelled. The manifest is replaced whole or not at all.

    Raises:
        SceneError: the folder holds another scene by now.
        OutputError: it cannot be written.
    """
    path = folder / MANIFEST
    manifest = untrusted_json.read(path)
    entries = manifest["surfaces"]
    if [entry.get("name", "") for entry in entries] != list(scene.names):
        raise SceneError(f"{path} changed while its surfaces were labelled; run the same command again, answers are kept")
    for entry, surface in zip(entries, scene, strict=True):
        entry["material"] = material_to_json(surface.material)
        entry["roughness_m"] = float(surface.roughness_m)
        entry["provenance"] = dict(surface.provenance)
    manifest["provenance"] = dict(scene.provenance)
    return write_atomically(path, json.dumps(manifest, indent=1, allow_nan=False) + "\n")
