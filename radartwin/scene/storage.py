"""A scene on the disk: `scene.glb` and `manifest.json` in one folder.

`scene.glb` holds the geometry in world coordinates, z up (one mesh per surface, float32, so positions round-trip to about
1 um at 10 m); `manifest.json` says what each mesh is: name, material, roughness, role and provenance. The manifest
carries the SHA-256 of the geometry it describes and is written last, so a folder that was interrupted or edited by
halves is refused instead of being mislabelled.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals

from radartwin.errors import MeshError, MissingError, SceneError
from radartwin.io import untrusted_json
from radartwin.io.files import write_atomically
from radartwin.materials import Layered
from radartwin.scene.checks import check_mesh
from radartwin.scene.mesh_file import read_meshes
from radartwin.scene.scene import Scene, Surface

FORMAT, VERSION = "radartwin-scene", 1
GEOMETRY, MANIFEST = "scene.glb", "manifest.json"
UV_STEPS = 2**17  # of texture coordinates: glTF counts v from the top, and 1 - v of such a number is exact in float32 up to 64 repeats


def save_scene(scene: Scene, folder: Path) -> Path:
    """See `Scene.save`."""
    if not scene.surfaces:
        raise SceneError("the scene has no surfaces, so there is nothing to save")
    out = trimesh.Scene()
    entries = []
    for index, surface in enumerate(scene.surfaces):
        key = f"s{index:05d}"
        mesh = _stored(surface.mesh)
        out.add_geometry(mesh, node_name=key, geom_name=key)
        entries.append(
            {
                "geometry": key,
                "name": surface.name,
                "material": material_to_json(surface.material),
                "roughness_m": float(surface.roughness_m),
                "role": surface.role,
                "faces": len(mesh.faces),
                "provenance": dict(surface.provenance),
            }
        )
    glb = bytes(out.export(file_type="glb", include_normals=True))  # type: ignore[arg-type]
    manifest = {
        "format": FORMAT,
        "version": VERSION,
        "units": "m",
        "up": "z",
        "geometry": "scene.glb",
        "sha256": hashlib.sha256(glb).hexdigest(),
        "provenance": dict(scene.provenance),
        "surfaces": entries,
    }
    text = json.dumps(manifest, indent=1, allow_nan=False) + "\n"
    write_atomically(folder / "scene.glb", glb)
    write_atomically(folder / "manifest.json", text.encode())
    return folder


def scene_folder(path: Path) -> Path | None:
    """The scene folder that a path means, itself or that of the part it names; None for a mesh, which carries no labels."""
    if path.name == MANIFEST or (path.name == GEOMETRY and (path.parent / MANIFEST).exists()):
        return path.parent
    return path if path.is_dir() else None


def load_scene(path: Path, material: str | Layered | None = None) -> Scene:
    """See `Scene.load`."""
    if not path.exists():
        raise MissingError(f"scene {path} is not there; give a scene folder or a .glb, .ply or .obj file")
    folder = scene_folder(path)
    if folder is not None:
        path = folder
        if material is not None:
            raise SceneError(f"scene {path} carries its own materials; relabel it through a material source instead of material=")
        return _load_folder(path)
    return _load_plain(path, material)


def _stored(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A mesh as glTF holds it: with its texture, or with colours by vertex; colours by face are spread to the vertices."""
    visual: Any = mesh.visual
    if visual.kind == "texture":
        kept = TextureVisuals(uv=np.rint(visual.uv * UV_STEPS) / UV_STEPS, material=visual.material)
    elif visual.kind in ("vertex", "face"):
        kept = ColorVisuals(vertex_colors=visual.vertex_colors)
    else:
        kept = None
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals, visual=kept, process=False)


def material_to_json(material: str | Layered) -> str | dict[str, Any]:
    """A name stays a name; a stack becomes {"layers": [[material, thickness_m], ...], "backing": ...}."""
    if isinstance(material, str):
        return material
    return {"layers": [[name, float(thickness)] for name, thickness in material.layers], "backing": material.backing}


def material_from_json(value: Any) -> str | Layered:
    """The inverse of `material_to_json`.

    Raises:
        SceneError: neither form.
    """
    if isinstance(value, str):
        return value
    try:
        layers = [(name, float(thickness)) for name, thickness in value["layers"]]
        backing = value.get("backing", "air")
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise SceneError(f"material {value!r} is neither a name nor {{layers, backing}}") from error
    return Layered(layers=layers, backing=backing)


def _load_folder(folder: Path) -> Scene:
    for part in ("manifest.json", "scene.glb"):
        if not (folder / part).is_file():
            raise MissingError(f"scene folder {folder} has no {part}; write it with Scene.save or radartwin reconstruct")
    glb = (folder / "scene.glb").read_bytes()
    try:
        manifest = untrusted_json.read(folder / "manifest.json")
        entries: Sequence[Mapping[str, Any]] = manifest["surfaces"]
        if manifest["format"] != FORMAT or manifest["version"] != VERSION:
            raise KeyError("format")
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise TypeError("surfaces")
        if not all(isinstance(told.get("provenance", {}), dict) for told in (manifest, *entries)):
            raise TypeError("provenance")
    except (ValueError, KeyError, TypeError) as error:
        raise SceneError(f"{folder / 'manifest.json'} is not a {FORMAT} version {VERSION} manifest; save the scene again") from error
    if manifest.get("sha256") != hashlib.sha256(glb).hexdigest():
        raise SceneError(f"{folder / 'scene.glb'} is not the geometry its manifest.json describes; save the scene again")
    meshes = read_meshes(io.BytesIO(glb), "glb", folder / "scene.glb")
    surfaces = []
    for entry in entries:
        missing = [key for key in ("geometry", "material") if key not in entry]
        if missing or str(entry["geometry"]) not in meshes:
            what = f"without {missing[0]}" if missing else f"naming geometry {entry['geometry']!r} that scene.glb lacks"
            raise SceneError(f"{folder / 'manifest.json'} has a surface {what}; save the scene again")
        surfaces.append(
            Surface(
                meshes[str(entry["geometry"])],
                material_from_json(entry["material"]),
                entry.get("name", ""),
                entry.get("roughness_m", 0.0),
                entry.get("role", "auto"),
                entry.get("provenance", {}),
            )
        )
    return Scene(surfaces, manifest.get("provenance", {}))


def _load_plain(path: Path, material: str | Layered | None) -> Scene:
    meshes = read_meshes(path)
    for name, mesh in meshes.items():
        check_mesh(mesh, f"{path}" if len(meshes) == 1 else f"{path}, mesh '{name}'")
    if not meshes:
        raise MeshError(f"{path} holds no triangles; give a mesh, not a point cloud")
    if material is None:
        raise SceneError(
            f"{path} carries no material labels; make it a scene with radartwin reconstruct {path} --out FOLDER --material NAME "
            "(in Python, Scene.load takes one material for all of it)"
        )
    return Scene([Surface(mesh, material, name) for name, mesh in meshes.items()], {"source": path.name})
