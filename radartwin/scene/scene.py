"""A scene: surfaces, each a triangle mesh in metres with what it is made of. Arrays in, arrays out.

World frame: z up, metres. How a scene lies on the disk is in `radartwin.scene.storage`.
"""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import trimesh

from radartwin.errors import MaterialError, SceneError
from radartwin.scene.checks import check_mesh, inside_solid

if TYPE_CHECKING:
    from radartwin.materials import Layered

Role = Literal["auto", "object", "room"]

OBJECT_EXTENT_M = 0.5  # role "auto": at most this large is an object (the largest of the twelve is a 0.3 m bottle)
OBJECT_WIDTH_M = 0.2  # ... and so is what is longer but this narrow: some ten of a room's tubes at 3 m
CURVED_EXTENT_M = 2.0  # ... and what is curved up to this size; beyond it, a scan's noise, which bends every edge


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
        self._check_material(where)
        roughness = self.roughness_m
        if isinstance(roughness, bool) or not isinstance(roughness, numbers.Real) or not 0 <= roughness < np.inf:
            raise SceneError(f"{where}: roughness_m is {roughness!r}; give a finite height deviation >= 0 in metres")
        if self.role not in ("auto", "object", "room"):
            raise SceneError(f"{where}: role is {self.role!r}; choose auto, object or room")

    def _check_material(self, where: str) -> None:
        from radartwin import materials

        if isinstance(self.material, str):
            materials.check_name(self.material)
        elif not isinstance(self.material, materials.Layered):  # which has checked its own layers
            raise MaterialError(f"{where}: material is {self.material!r}; give a name of radartwin.materials or a Layered stack")
        elif not self.material.layers and self.material.backing in ("air", "vacuum"):
            raise MaterialError(f"{where}: material is a Layered without layers before {self.material.backing}, which reflects nothing")

    @property
    def kind(self) -> Literal["object", "room"]:
        """The role with "auto" resolved by shape: wide tubes suit what is large, wide and flat; all else is an object."""
        if self.role != "auto":
            return self.role
        _, width, length = sorted(float(extent) for extent in self.mesh.extents)
        if length <= OBJECT_EXTENT_M or width <= OBJECT_WIDTH_M:
            return "object"
        return "object" if length <= CURVED_EXTENT_M and self.is_curved() else "room"

    def is_curved(self) -> bool:
        """Whether a fifth of the edges bend by 0.5 to 30 degrees, as a tessellated curve's do and a box's do not."""
        angles = np.degrees(self.mesh.face_adjacency_angles)
        return bool(len(angles) and ((angles > 0.5) & (angles < 30)).mean() > 0.2)

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
        from radartwin.scene.storage import save_scene

        return save_scene(self, Path(folder))

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
        from radartwin.scene.storage import load_scene

        return load_scene(Path(path), material)
