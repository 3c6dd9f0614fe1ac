"""A scene: surfaces, each a triangle mesh in metres with what it is made of. Arrays in, arrays out.

World frame: z up, metres. On disk a scene is a folder of two files: `scene.glb` holds the geometry in world coordinates
(one mesh per surface, float32, so positions round-trip to about 1 um at 10 m) and `manifest.json` says what each mesh
is: name, material, roughness, role and provenance. The manifest carries the SHA-256 of the geometry it describes and is
written last, so a folder that was interrupted or edited by halves is refused instead of being mislabelled.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import trimesh

from radartwin.errors import MeshError, MissingError, SceneError
from radartwin.files import write_atomically
from radartwin.scene.checks import check_mesh, inside_solid
from radartwin.scene.mesh_file import read_meshes

if TYPE_CHECKING:
    from radartwin.materials import Layered

Role = Literal["auto", "object", "room"]

OBJECT_EXTENT_M = 0.5  # role "auto": at most this large is an object (the largest of the twelve is a 0.3 m bottle)
FORMAT, VERSION = "radartwin-scene", 1


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """A mesh and what it is made of.

    Args:
        mesh: triangles in metres, world frame (or the object's own frame when `simulate(motion=...)` moves it).
        material: a name of `radartwin.materials` or a `Layered` stack, outermost layer first.
        name: what motion, labels and reports call it; several surfaces may share one name and then move together.
        roughness_m: standard deviation of the surface height.
        role: "object" is traced with wavelength-scale tubes, "room" with wide ones; "auto" decides by size.
        provenance: where the material comes from (source, confidence, stand-in), kept in the manifest.
    Raises:
        MeshError: not a mesh, empty, NaN, or an extent over 100 m.
        MaterialError: an unknown material.
        SceneError: a negative roughness or unknown role.
    """

    mesh: trimesh.Trimesh
    material: str | Layered
    name: str = ""
    roughness_m: float = 0.0
    role: Role = "auto"
    provenance: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        where = f"surface '{self.name}'" if self.name else "surface"
        check_mesh(self.mesh, where)
        if isinstance(self.material, str):  # a Layered has checked its own layers
            from radartwin import materials

            materials.check_name(self.material)
        if not (np.isfinite(self.roughness_m) and self.roughness_m >= 0):
            raise SceneError(f"{where}: roughness_m is {self.roughness_m}; give a finite height deviation >= 0 in metres")
        if self.role not in ("auto", "object", "room"):
            raise SceneError(f"{where}: role is {self.role!r}; choose auto, object or room")

    @property
    def kind(self) -> Literal["object", "room"]:
        """The role with "auto" resolved by the largest extent."""
        if self.role != "auto":
            return self.role
        return "object" if float(self.mesh.extents.max()) <= OBJECT_EXTENT_M else "room"

    def replaced(self, **changes: Any) -> Surface:
        """A copy with some fields changed, e.g. `surface.replaced(material="concrete")`."""
        return dataclasses.replace(self, **changes)

    def moved(self, pose: np.ndarray) -> Surface:
        """A copy with its mesh carried by a 4x4 rigid transform; the role is kept as resolved before the move."""
        return dataclasses.replace(self, mesh=self.mesh.copy().apply_transform(pose), role=self.kind)


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """Surfaces of one place. Iterable; `room + target` joins two scenes.

    >>> import trimesh
    >>> scene = Scene([Surface(trimesh.creation.box((0.1, 0.1, 0.1)), "metal", "box")])
    >>> [(s.name, s.kind) for s in scene]
    [('box', 'object')]
    """

    surfaces: tuple[Surface, ...]
    provenance: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __init__(self, surfaces: Iterable[Surface] = (), provenance: Mapping[str, Any] | None = None) -> None:
        surfaces = tuple(surfaces)
        for surface in surfaces:
            if not isinstance(surface, Surface):
                raise SceneError(f"a scene is made of Surface, not {type(surface).__name__}; use Surface(mesh, material)")
        object.__setattr__(self, "surfaces", surfaces)
        object.__setattr__(self, "provenance", dict(provenance or {}))

    def __iter__(self):
        return iter(self.surfaces)

    def __len__(self) -> int:
        return len(self.surfaces)

    def __add__(self, other: Scene) -> Scene:
        return Scene(self.surfaces + other.surfaces, {**self.provenance, **other.provenance})

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(s.name for s in self.surfaces)

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner, (2, 3) metres; zeros for a scene without surfaces."""
        if not self.surfaces:
            return np.zeros((2, 3))
        corners = np.array([s.mesh.bounds for s in self.surfaces])
        return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])

    def only(self, kind: Literal["object", "room"]) -> Scene:
        """The surfaces of one kind."""
        return Scene((s for s in self.surfaces if s.kind == kind), self.provenance)

    def without(self, names: Iterable[str]) -> Scene:
        """The scene less the named surfaces.

        Raises:
            SceneError: a name the scene does not have.
        """
        names = set(names)
        if unknown := sorted(names - set(self.names)):
            raise SceneError(f"the scene has no surface '{unknown[0]}'; it has {', '.join(sorted(set(self.names)))}")
        return Scene((s for s in self.surfaces if s.name not in names), self.provenance)

    def check_sensor(self, positions: np.ndarray) -> None:
        """Refuse a sensor inside a solid: a watertight mesh of positive volume.

        A room with inward normals has negative volume, one of separate walls is not watertight; both are fine.

        Args:
            positions: (F, 3) world positions, or (3,).
        Raises:
            SceneError: naming the surface and the frame.
        """
        positions = np.atleast_2d(np.asarray(positions, dtype=np.float64))
        for index, surface in enumerate(self.surfaces):
            inside = inside_solid(surface.mesh, positions)
            if inside.any():
                frame = int(np.argmax(inside))
                at = ", ".join(f"{x:.3g}" for x in positions[frame])
                raise SceneError(
                    f"the sensor at ({at}) m, frame {frame}, is inside surface '{surface.name or index}'; "
                    "move the sensor, or turn the mesh's normals inwards if it is a room"
                )

    def save(self, folder: str | Path) -> Path:
        """Write `scene.glb` and `manifest.json` into `folder`, each atomically, the manifest last.

        Returns:
            The folder.
        Raises:
            SceneError: nothing to write.
            OutputError: the folder cannot be written.
        """
        if not self.surfaces:
            raise SceneError("the scene has no surfaces, so there is nothing to save")
        out = trimesh.Scene()
        entries = []
        for index, surface in enumerate(self.surfaces):
            key = f"s{index:05d}"
            mesh = trimesh.Trimesh(surface.mesh.vertices, surface.mesh.faces, vertex_normals=surface.mesh.vertex_normals, process=False)
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
            "provenance": dict(self.provenance),
            "surfaces": entries,
        }
        folder = Path(folder)
        text = json.dumps(manifest, indent=1, allow_nan=False) + "\n"
        write_atomically(folder / "scene.glb", glb)
        write_atomically(folder / "manifest.json", text.encode())
        return folder

    @classmethod
    def load(cls, path: str | Path, material: str | Layered | None = None) -> Scene:
        """Read a scene folder, or a plain mesh file with one material for everything.

        A plain .glb, .ply or .obj is taken as it is: metres, z up. `radartwin reconstruct` handles units, axes, defects
        and separate surfaces.

        Args:
            path: folder with `scene.glb` and `manifest.json` (or either of the two files), or a .glb, .ply, .obj file.
            material: what a plain mesh is made of; not for a folder, which carries its own labels.
        Raises:
            MissingError: the path, or a part of the folder, is not there.
            MeshError: an unreadable, empty, NaN or over-large mesh.
            SceneError: a plain mesh without `material`, or a manifest that does not fit its geometry.
        """
        path = Path(path)
        if not path.exists():
            raise MissingError(f"scene {path} is not there; give a scene folder or a .glb, .ply or .obj file")
        if path.name == "manifest.json" or (path.name == "scene.glb" and (path.parent / "manifest.json").exists()):
            path = path.parent
        if path.is_dir():
            if material is not None:
                raise SceneError(f"scene {path} carries its own materials; relabel it through a material source instead of material=")
            return _load_folder(path)
        return _load_plain(path, material)


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
    from radartwin.materials import Layered

    return Layered(layers=layers, backing=backing)


def _load_folder(folder: Path) -> Scene:
    for part in ("manifest.json", "scene.glb"):
        if not (folder / part).is_file():
            raise MissingError(f"scene folder {folder} has no {part}; write it with Scene.save or radartwin reconstruct")
    glb = (folder / "scene.glb").read_bytes()
    try:
        manifest = json.loads((folder / "manifest.json").read_text())
        entries: Sequence[Mapping[str, Any]] = manifest["surfaces"]
        if manifest["format"] != FORMAT or manifest["version"] != VERSION:
            raise KeyError("format")
    except (ValueError, KeyError, TypeError) as error:
        raise SceneError(f"{folder / 'manifest.json'} is not a {FORMAT} version {VERSION} manifest; save the scene again") from error
    if manifest.get("sha256") != hashlib.sha256(glb).hexdigest():
        raise SceneError(f"{folder / 'scene.glb'} is not the geometry its manifest.json describes; save the scene again")
    meshes = read_meshes(io.BytesIO(glb), "glb", folder / "scene.glb")
    surfaces = []
    for entry in entries:
        missing = [key for key in ("geometry", "material") if key not in entry]
        if missing or entry["geometry"] not in meshes:
            what = f"without {missing[0]}" if missing else f"naming geometry {entry['geometry']!r} that scene.glb lacks"
            raise SceneError(f"{folder / 'manifest.json'} has a surface {what}; save the scene again")
        surfaces.append(
            Surface(
                meshes[entry["geometry"]],
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
            f"{path} carries no material labels; pass material=NAME for one uniform material, "
            "or turn it into a labelled scene with radartwin reconstruct"
        )
    return Scene([Surface(mesh, material, name) for name, mesh in meshes.items()], {"source": path.name})
