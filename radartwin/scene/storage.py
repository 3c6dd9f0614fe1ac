"""Write and read the surfaces of a scene folder: `scene.glb` and `manifest.json`.

`scene.glb` holds the geometry in world coordinates with z up, one mesh per surface. Coordinates are float32 numbers, which have a rounding
error of about 1 um at 10 m. `manifest.json` lists the name, material, roughness, role and provenance of each mesh, and the SHA-256 checksum
of `scene.glb`. The manifest is written last, so that the checksum reveals an interrupted write or a replaced geometry file.
"""

from __future__ import annotations

import contextlib
import hashlib
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
from radartwin.scene.mesh_checks import check_mesh
from radartwin.scene.mesh_file import offset_m, read_meshes
from radartwin.scene.surface import Surface

FORMAT, VERSION = "radartwin-scene", 1
GEOMETRY, MANIFEST = "scene.glb", "manifest.json"
# Texture coordinates are rounded to multiples of 1/UV_STEPS. glTF stores 1 - v, which these multiples make exact in float32 for up to 64
# repeats of the texture.
UV_STEPS = 2**17


def write_scene(surfaces: Sequence[Surface], provenance: Mapping[str, Any], folder: Path) -> Path:
    """Write the surfaces of a scene to a scene folder; `Scene.save` documents the errors."""
    if not surfaces:
        raise SceneError(f"the scene has no surfaces, so there is nothing to save in {folder}; add surfaces")
    out = trimesh.Scene()
    entries = []
    for index, surface in enumerate(surfaces):
        key = f"s{index:05d}"
        mesh = _with_vertex_visual(surface.mesh)
        out.add_geometry(mesh, node_name=key, geom_name=key)
        entries.append(
            {
                "geometry": key,
                "name": surface.name,
                "material": material_to_json(surface.material),
                "roughness_m": float(surface.roughness_m),
                "correlation_m": float(surface.correlation_m),
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
        "geometry": GEOMETRY,
        "sha256": hashlib.sha256(glb).hexdigest(),
        "provenance": dict(provenance),
        "surfaces": entries,
    }
    text = json.dumps(manifest, indent=1, allow_nan=False) + "\n"
    write_atomically(folder / GEOMETRY, glb)
    write_atomically(folder / MANIFEST, text.encode())
    return folder


def scene_folder(path: Path) -> Path | None:
    """Return the scene folder if `path` is a scene folder or a file in it (`scene.glb` or `manifest.json`); None for a plain mesh."""
    if path.name == MANIFEST or (path.name == GEOMETRY and (path.parent / MANIFEST).exists()):
        return path.parent
    return path if path.is_dir() else None


def is_scene(folder: Path) -> bool:
    """Return whether RadarTwin wrote the manifest in the folder."""
    with contextlib.suppress(SceneError, OSError):
        return bool(_manifest(folder / MANIFEST))
    return False


def read_scene(path: Path, material: str | Layered | None = None) -> tuple[list[Surface], dict[str, Any]]:
    """Read the surfaces and the provenance of a scene folder or a plain mesh file; `Scene.load` documents the errors."""
    if not path.exists():
        raise MissingError(f"scene {path} is not there; give a scene folder or a .glb, .ply or .obj file")
    folder = scene_folder(path)
    if folder is None:
        return _read_plain(path, material)
    if material is not None:
        raise SceneError(f"scene {folder} has its own materials; leave material out, or label the scene again with radartwin label")
    return _read_folder(folder)


def _with_vertex_visual(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the mesh with face colours converted to vertex colours, because glTF stores only textures and vertex colours."""
    visual: Any = mesh.visual
    if visual.kind == "texture":
        stored = TextureVisuals(uv=np.rint(visual.uv * UV_STEPS) / UV_STEPS, material=visual.material)
    elif visual.kind in ("vertex", "face"):
        stored = ColorVisuals(vertex_colors=visual.vertex_colors)
    else:
        stored = None
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals, visual=stored, process=False)


def material_to_json(material: str | Layered) -> str | dict[str, Any]:
    """Convert a material to a JSON value. A material name stays unchanged.

    A stack of layers becomes {"layers": [[material, thickness_m], ...], "backing": ...}.
    """
    if isinstance(material, str):
        return material
    return {"layers": [[name, float(thickness)] for name, thickness in material.layers], "backing": material.backing}


def material_from_json(value: Any) -> str | Layered:
    """Convert a JSON value from `material_to_json` back to a material.

    Raises:
        SceneError: the value is neither a material name nor a stack of layers.
    """
    if isinstance(value, str):
        return value
    try:
        layers = [(name, float(thickness)) for name, thickness in value["layers"]]
        backing = value.get("backing", "air")
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise SceneError(f"material {value!r} is neither a name nor {{layers, backing}}; give one of the two") from error
    return Layered(layers=layers, backing=backing)


def _read_folder(folder: Path) -> tuple[list[Surface], dict[str, Any]]:
    for part in (MANIFEST, GEOMETRY):
        if not (folder / part).is_file():
            raise MissingError(f"scene folder {folder} has no {part}; write it with Scene.save or radartwin reconstruct")
    manifest = _manifest(folder / MANIFEST)
    if manifest.get("sha256") != hashlib.sha256((folder / GEOMETRY).read_bytes()).hexdigest():
        raise SceneError(f"{folder / GEOMETRY} is not the geometry that {MANIFEST} describes; save the scene again")
    meshes = read_meshes(folder / GEOMETRY)
    surfaces = []
    for entry in manifest["surfaces"]:
        missing = [key for key in ("geometry", "material") if key not in entry]
        if missing or str(entry["geometry"]) not in meshes:
            what = f"without {missing[0]}" if missing else f"with geometry {entry['geometry']!r}, which {GEOMETRY} lacks"
            raise SceneError(f"{folder / MANIFEST} has a surface {what}; save the scene again")
        options = {key: entry[key] for key in ("name", "roughness_m", "correlation_m", "role", "provenance") if key in entry}
        surfaces.append(Surface(meshes[str(entry["geometry"])], material_from_json(entry["material"]), **options))
    return surfaces, manifest.get("provenance", {})


def _manifest(path: Path) -> dict[str, Any]:
    try:
        manifest = untrusted_json.read(path)
        holders = (manifest, *manifest["surfaces"])
        np.reshape(np.array(manifest.get("provenance", {}).get("offset_m", [0, 0, 0]), np.float64), 3)
        if (manifest["format"], manifest["version"]) != (FORMAT, VERSION) or not isinstance(manifest["surfaces"], list):
            raise ValueError("format")
        if not all(isinstance(holder, dict) and isinstance(holder.get("provenance", {}), dict) for holder in holders):
            raise TypeError("provenance")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SceneError(f"{path} is not a {FORMAT} version {VERSION} manifest; save the scene again") from error
    return manifest


def _read_plain(path: Path, material: str | Layered | None) -> tuple[list[Surface], dict[str, Any]]:
    meshes = read_meshes(path)
    for name, mesh in meshes.items():
        check_mesh(mesh, f"{path}" if len(meshes) == 1 else f"{path}, mesh '{name}'")
    if not meshes:
        raise MeshError(f"{path} holds no triangles; give a mesh, not a point cloud")
    if material is None:
        raise SceneError(
            f"{path} carries no material labels; make it a scene with radartwin reconstruct {path} --out FOLDER --material NAME "
            "(in Python, Scene.load takes the material of all surfaces)"
        )
    offset = offset_m(np.concatenate([mesh.bounds for mesh in meshes.values()]))
    if offset.any():
        meshes = {name: mesh.copy().apply_translation(-offset) for name, mesh in meshes.items()}
    surfaces = [Surface(mesh, material, name) for name, mesh in meshes.items()]
    return surfaces, {"source": path.name} | ({"offset_m": offset.tolist()} if offset.any() else {})
