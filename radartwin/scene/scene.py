"""Define the scene, a collection of surfaces in a world frame with z up, in metres."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from radartwin.errors import PoseError, SceneError
from radartwin.materials import Layered
from radartwin.scene.mesh_checks import MAX_EXTENT_M, inside_solid
from radartwin.scene.storage import read_scene, write_scene
from radartwin.scene.surface import Surface

__all__ = ["Scene", "Surface"]


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """Hold the surfaces of a room, of an object, or of both, in metres in a world frame with z up.

    Iterating over a scene gives its surfaces, `room + target` joins two scenes, and `Scene.load(folder)` reads a scene folder, such as one
    that `radartwin reconstruct` wrote.

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
                raise SceneError(f"a scene consists of Surface, not {type(surface).__name__}; use Surface(mesh, material)")
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
        """Lowest and highest corner of the scene's bounding box, (2, 3), in metres; zeros for a scene without surfaces."""
        if not self.surfaces:
            return np.zeros((2, 3))
        corners = np.array([s.mesh.bounds for s in self.surfaces])
        return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])

    def only(self, kind: Literal["object", "room"]) -> Scene:
        """Return a scene with only the surfaces of the given kind ("object" or "room")."""
        return Scene((s for s in self.surfaces if s.kind == kind), self.provenance)

    def without(self, names: Iterable[str]) -> Scene:
        """Return a scene without the surfaces with the given names; an unknown name raises SceneError."""
        names = set(names)
        if unknown := sorted(names - set(self.names)):
            raise SceneError(f"the scene has no surface '{unknown[0]}'; it has {', '.join(sorted(set(self.names)))}")
        return Scene((s for s in self.surfaces if s.name not in names), self.provenance)

    def placed(self, poses: np.ndarray, source: str) -> np.ndarray:
        """Return poses (..., 4, 4) in the coordinates of this scene.

        A scan far from its origin was moved by `offset_m` of the provenance. Of the given poses and the poses moved by the same offset, the
        function returns those that are nearer to the room.

        Raises:
            PoseError: a pose is more than MAX_EXTENT_M from the room.
        """
        offset = np.array(self.provenance.get("offset_m", (0.0, 0.0, 0.0)))
        low, high = self.bounds
        here, moved = np.array(poses, dtype=np.float64), np.array(poses, dtype=np.float64)
        moved[..., :3, 3] = here[..., :3, 3] - offset

        def away_m(poses: np.ndarray) -> np.ndarray:
            positions = poses[..., :3, 3].reshape(-1, 3)
            return np.linalg.norm(positions - np.clip(positions, low, high), axis=1)

        nearest = min(here, moved, key=lambda candidate: away_m(candidate).max())
        if len(self) and (away := away_m(nearest)).max() > MAX_EXTENT_M:
            position = here.reshape(-1, 4, 4)[away.argmax(), :3, 3]
            at, centre = (", ".join(f"{x:.2f}" for x in place) for place in (position, (low + high) / 2 + offset))
            raise PoseError(f"{source}: ({at}) m is {away.max():.0f} m from the room at ({centre}) m; use the scan's coordinates")
        return nearest

    def check_sensor(self, positions: np.ndarray) -> None:
        """Raise an error if the sensor is inside a solid. A solid is a watertight mesh of positive volume.

        A room is not a solid, because separate walls are not watertight, and a closed room mesh with normals into the room has negative
        volume.

        Args:
            positions: (F, 3) world positions of the sensor in F frames, or (3,) for a single frame, metres.
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
        """Write `scene.glb` and then `manifest.json` into `folder`, each file atomically, and return the folder.

        Raises:
            SceneError: the scene has no surfaces.
            OutputError: the folder cannot be written.
        """
        return write_scene(self.surfaces, self.provenance, Path(folder))

    @classmethod
    def load(cls, path: str | Path, material: str | Layered | None = None) -> Scene:
        """Read a scene folder, or a plain mesh file whose surfaces all have the same material.

        The coordinates of a plain .glb, .ply or .obj are taken as metres with z up. For files with different units or axes, or with
        defects, use `radartwin reconstruct`, which also separates surfaces.

        Args:
            path: scene folder with `scene.glb` and `manifest.json` (or the path of either file), or a plain .glb, .ply or .obj file.
            material: material of a plain mesh; None for a scene folder, which defines its own materials.
        Raises:
            MissingError: the path, or a file of the folder, does not exist.
            MeshError: a mesh is unreadable, empty, too large, or has NaN vertices.
            SceneError: `material` is None for a plain mesh, or the manifest does not match the geometry in `scene.glb`.
        """
        return cls(*read_scene(Path(path), material))
