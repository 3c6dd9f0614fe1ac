"""Define the surface: a triangle mesh in metres with its material."""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import trimesh

from radartwin.errors import MaterialError, SceneError
from radartwin.materials import Layered, check_name
from radartwin.scene.checks import check_mesh

Role = Literal["auto", "object", "room"]

# Limits of role "auto". A surface below any of these limits is an object.
OBJECT_EXTENT_M = 0.5  # length; the largest of the twelve catalogue objects is a 0.3 m bottle
OBJECT_WIDTH_M = 0.2  # width, for any length; at 3 m about ten ray tubes of role "room" fit side by side
CURVED_EXTENT_M = 2.0  # length of a curved mesh; a larger mesh with bent edges is a flat surface with scan noise


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Hold a mesh with its material.

    Args:
        mesh: triangles in metres, world frame (or the object's own frame if `simulate(motion=...)` moves it).
        material: a name of `radartwin.materials` or a `Layered` stack, outermost layer first.
        name: name in motion, labels and reports; surfaces of one name move together.
        roughness_m: standard deviation of the surface height.
        role: "object" is traced with wavelength-scale tubes, "room" with wide tubes; "auto" decides by size.
        provenance: origin of the material (source, confidence, whether it is a substitute), stored in the manifest.
    Raises:
        MeshError: the mesh is not a triangle mesh, is empty, has NaN vertices, or spans over 100 m.
        MaterialError: the material is unknown.
        SceneError: the roughness is negative or the role is unknown.
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
        if isinstance(self.material, str):
            check_name(self.material)
        elif not isinstance(self.material, Layered):
            raise MaterialError(f"{where}: material is {self.material!r}; give a name of radartwin.materials or a Layered stack")
        elif not self.material.layers and self.material.backing in ("air", "vacuum"):
            raise MaterialError(f"{where}: material is a Layered without layers before {self.material.backing}, which reflects nothing")
        roughness = self.roughness_m
        if isinstance(roughness, bool) or not isinstance(roughness, numbers.Real) or not 0 <= roughness < np.inf:
            raise SceneError(f"{where}: roughness_m is {roughness!r}; give a finite height deviation >= 0 in metres")
        if self.role not in ("auto", "object", "room"):
            raise SceneError(f"{where}: role is {self.role!r}; choose auto, object or room")

    @property
    def kind(self) -> Literal["object", "room"]:
        """Role of the surface. "auto" becomes "room" for a large, wide and flat mesh, and "object" for any other mesh."""
        if self.role != "auto":
            return self.role
        _, width, length = sorted(float(extent) for extent in self.mesh.extents)
        if length <= OBJECT_EXTENT_M or width <= OBJECT_WIDTH_M:
            return "object"
        return "object" if length <= CURVED_EXTENT_M and self.is_curved() else "room"

    def is_curved(self) -> bool:
        """Return whether more than a fifth of the edges bend by 0.5 to 30 degrees, as in a tessellated curved surface but not in a box."""
        angles = np.degrees(self.mesh.face_adjacency_angles)
        return bool(len(angles) and ((angles > 0.5) & (angles < 30)).mean() > 0.2)

    def replaced(self, **changes: Any) -> Surface:
        """Return a copy with some fields changed, e.g. `surface.replaced(material="concrete")`."""
        return dataclasses.replace(self, **changes)

    def moved(self, pose: np.ndarray) -> Surface:
        """Return a copy with its mesh moved by a (4, 4) rigid transform; role "auto" is resolved before the move."""
        return dataclasses.replace(self, mesh=self.mesh.copy().apply_transform(pose), role=self.kind)
