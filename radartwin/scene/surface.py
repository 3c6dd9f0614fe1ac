"""Define the surface: a triangle mesh in metres with its material."""

from __future__ import annotations

import dataclasses
import numbers
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import trimesh

from radartwin.errors import MaterialError, SceneError
from radartwin.materials import CORRELATION_M, Layered, check_name
from radartwin.scene.mesh_checks import check_mesh

Role = Literal["auto", "object", "room"]

# Size limits in metres with which role "auto" decides. A surface below any of these limits is an object.
OBJECT_EXTENT_M = 0.5  # limit of the longest extent; the largest of the twelve catalogue objects is a 0.3 m bottle
# limit of the second-longest extent; about ten ray tubes of role "room" fit side by side into this width at a range of 3 m
OBJECT_WIDTH_M = 0.2
CURVED_EXTENT_M = 2.0  # limit of the longest extent of a curved mesh; larger meshes with bent edges are flat surfaces with scan noise


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Hold a triangle mesh with its material and roughness.

    Args:
        mesh: triangle mesh in metres, in the world frame (or in the object's own frame if `simulate(motion=...)` moves the surface).
        material: name of a material in `radartwin.materials`, or a `Layered` stack of materials, outermost layer first.
        name: name of the surface in motions, material labels and reports; surfaces with the same name move together.
        roughness_m: standard deviation of the surface height in metres.
        role: "object" means that the surface is traced with wavelength-scale ray tubes, "room" with wide ray tubes; "auto" decides by size.
        provenance: where the material comes from (source, confidence, whether it is a substitute), stored in the scene's manifest.
        correlation_m: correlation length of the surface height in metres, which sets the directions of diffuse scattering
            (`radartwin.materials.scatter_lobe`).
    Raises:
        MeshError: the mesh is not a triangle mesh, is empty, has NaN vertices, or spans over 100 m.
        MaterialError: the material name is unknown, or the stack of layers is empty.
        SceneError: the roughness is negative or not finite, the correlation length is not positive, or the role is unknown.
    """

    mesh: trimesh.Trimesh
    material: str | Layered
    name: str = ""
    roughness_m: float = 0.0
    role: Role = "auto"
    provenance: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    correlation_m: float = CORRELATION_M

    def __post_init__(self) -> None:
        where = f"surface '{self.name}'" if self.name else "surface"
        check_mesh(self.mesh, where)
        if isinstance(self.material, str):
            check_name(self.material)
        elif not isinstance(self.material, Layered):
            raise MaterialError(f"{where}: material is {self.material!r}; give a name of radartwin.materials or a Layered stack")
        elif not self.material.layers and self.material.backing in ("air", "vacuum"):
            raise MaterialError(
                f"{where}: material is a Layered without layers before {self.material.backing}, which reflects nothing; add a layer"
            )
        roughness = self.roughness_m
        if isinstance(roughness, bool) or not isinstance(roughness, numbers.Real) or not 0 <= roughness < np.inf:
            raise SceneError(f"{where}: roughness_m is {roughness!r}; give a finite height deviation >= 0 in metres")
        length = self.correlation_m
        if isinstance(length, bool) or not isinstance(length, numbers.Real) or not 0 < length < np.inf:
            raise SceneError(f"{where}: correlation_m is {length!r}; give a finite correlation length > 0 in metres")
        if self.role not in ("auto", "object", "room"):
            raise SceneError(f"{where}: role is {self.role!r}; choose auto, object or room")

    @property
    def kind(self) -> Literal["object", "room"]:
        """Role of the surface, where "auto" is replaced by "room" for a large, wide and flat mesh, and by "object" for any other mesh."""
        if self.role != "auto":
            return self.role
        _, width, length = sorted(float(extent) for extent in self.mesh.extents)
        if length <= OBJECT_EXTENT_M or width <= OBJECT_WIDTH_M:
            return "object"
        return "object" if length <= CURVED_EXTENT_M and self.is_curved() else "room"

    def is_curved(self) -> bool:
        """Return whether the mesh approximates a curved surface: more than a fifth of its edges bend by 0.5 to 30 degrees."""
        angles = np.degrees(self.mesh.face_adjacency_angles)
        return bool(len(angles) and ((angles > 0.5) & (angles < 30)).mean() > 0.2)

    def replaced(self, **changes: Any) -> Surface:
        """Return a copy of the surface with some fields changed, for example `surface.replaced(material="concrete")`."""
        return dataclasses.replace(self, **changes)

    def moved(self, pose: np.ndarray) -> Surface:
        """Return a copy of the surface with its mesh moved by the rigid transform `pose` (4, 4).

        The role of the copy is the `kind` of the original and never "auto", because a rotation changes the extents of the mesh.
        """
        return dataclasses.replace(self, mesh=self.mesh.copy().apply_transform(pose), role=self.kind)
