"""The static surfaces of a scene, prepared for tracing: which are flat faces, which are traced by tubes, and which block paths.

Large flat surfaces form a room of flat faces. Paths reflect at these faces and are diffracted at their edges. Objects up to
OBJECT_EXTENT_M, thin bodies, and surfaces that are curved, are traced by physical optics on their own. For the paths of the room, the
opaque ones of these bodies are obstacles whose outlines cast smooth shadows. A room whose large surfaces are not flat is traced by tubes as
a whole.
"""

import atexit
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import trimesh

from radartwin.radar.chirp import Radar
from radartwin.scene.surface import OBJECT_EXTENT_M, Surface
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation import reflection_table
from radartwin.simulation.backends import coupling
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.tube_paths import Target, clusters
from radartwin.simulation.flat import faces as faces_module
from radartwin.simulation.flat import obstacles, polygons, shadows, silhouette
from radartwin.simulation.flat.room import FlatRoom, RoomWarning, Searched
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths, made_once
from radartwin.simulation.reflection_table import ReflectionTable
from radartwin.store.recent import Recent

FLAT_SHARE = 0.98  # smallest fraction of a flat room's area that belongs to flat faces
MAX_FACES = 20_000  # rooms with more flat faces are traced by tubes, with a warning; a room of 10,000 takes minutes (decision 018)
# A body that fits into a cylinder with this radius is an object even if it is long. Its faces span less than a Fresnel zone at 0.2 m. For
# such faces, physical optics and shadows are more accurate than edges. Behind frames with bars of 1 cm, the echo of a wall then has errors
# below 0.2 dB; with edges, the errors were 2.9 and 2.1 dB. Behind boxes of 2 cm, the error is 0.02 of the echo; with edges, it was 1.5 of
# the echo.
THIN_M = 0.0115


# Prepared static surfaces, which together have at most CACHED_FACES faces.
_static_scenes: "Recent[StaticScene]" = Recent(geometry_module.CACHED_FACES)
atexit.register(_static_scenes.clear)


@dataclass(frozen=True)
class StaticScene:
    """Hold the static surfaces of a scene with their triangles and reflection coefficients."""

    surfaces: list[Surface]
    geometry: Geometry
    table: ReflectionTable

    @cached_property
    def small(self) -> np.ndarray:
        """Return a mask (F,) of the triangles that `small_faces` chooses: small objects, curved objects and thin bodies."""
        return small_faces(self.surfaces, self.geometry)

    @cached_property
    def _large(self) -> tuple[faces_module.Faces, np.ndarray]:
        """Return the flat faces of the large surfaces, and a mask (F,) of all triangles that belong to them."""
        faces, flat = faces_module.find(geometry_module.subset(self.geometry, ~self.small))
        mask = np.zeros(len(self.small), bool)
        mask[np.flatnonzero(~self.small)[flat]] = True
        return faces, mask

    @cached_property
    def is_flat(self) -> bool:
        """Return whether flat faces make up FLAT_SHARE of the area of the large surfaces, and are at most MAX_FACES."""
        faces, flat = self._large
        area = np.linalg.norm(self.geometry.area_vectors, axis=1)
        if len(faces.offset) == 0 or area[flat].sum() < FLAT_SHARE * area[~self.small].sum():
            return False
        if len(faces.offset) > MAX_FACES:
            warnings.warn(
                f"the room has {len(faces.offset)} flat faces, over MAX_FACES = {MAX_FACES}; ray tubes trace it, without edge diffraction",
                RoomWarning, stacklevel=2,
            )  # fmt: skip
            return False
        return True

    @cached_property
    def compact(self) -> np.ndarray:
        """Return a mask (F,) of the triangles to trace by tubes in a flat room: small objects, and triangles that belong to no face."""
        return ~self._large[1]

    @cached_property
    def room(self) -> FlatRoom:
        """Return the flat faces of the large surfaces as a room without small objects."""
        faces, walls = self._large[0], self.walls
        usable = np.ones(len(faces.offset), bool)
        none = np.zeros(len(self.surfaces), bool)
        return FlatRoom(faces, usable, obstacles.build(walls.corners, walls.surface), shadows.edges_of(faces), self.table, (), none)

    @cached_property
    def walls(self) -> Geometry:
        """Return the triangles of the flat faces of the large surfaces."""
        return geometry_module.subset(self.geometry, self._large[1])

    @cached_property
    def _objects(self) -> faces_module.Faces:
        """Return the flat faces of the small objects."""
        return faces_module.find(geometry_module.subset(self.geometry, self.compact))[0]

    @cached_property
    def _bodies(self) -> list[tuple[list[int], silhouette.Skin]]:
        """Return the small objects that block, with their surfaces. Objects that nearly touch are one body.

        A body that transmits casts no shadow here, because the shadow factor of an outline is that of an opaque body.
        """
        hiding = self.compact & self.table.opaque[self.geometry.surface]
        groups = clusters(self.surfaces, np.unique(self.geometry.surface[hiding]))
        masks = [hiding & np.isin(self.geometry.surface, group) for group in groups]
        return [(group, silhouette.skin(geometry_module.subset(self.geometry, mask))) for group, mask in zip(groups, masks, strict=True)]

    def beside(self, members: Sequence[int] = (), done: Sequence[int] = (), flat: bool = True) -> FlatRoom:
        """Return the room for tracing the paths of an object. The surfaces `members` of the object do not hide the object.

        Args:
            members: surfaces of the object.
            done: other objects whose paths with this object are already traced; they hide this object, but do not reflect.
            flat: whether paths may reflect at faces.
        """
        key = tuple(members), tuple(done), flat
        if key not in self._beside:
            self._beside[key] = self._without(*key)
        return self._beside[key]

    @cached_property
    def _beside(self) -> dict[tuple, FlatRoom]:
        return {}

    def _without(self, members: Sequence[int], done: Sequence[int], flat: bool) -> FlatRoom:
        room, objects = self.room, self._objects
        mine = self.compact & np.isin(self.geometry.surface, list(members))
        every = geometry_module.subset(self.geometry, ~mine)
        usable = np.concatenate([room.usable, ~np.isin(objects.surface, [*members, *done])]) & flat
        joined = faces_module.Faces.concatenate([room.faces, objects])
        edges = room.edges if flat else obstacles.build(np.zeros((0, 3, 3)), np.zeros(0, int))
        bodies, outlined = [(group, skin) for group, skin in self._bodies if not set(group) & set(members)], room.outlined.copy()
        outlined[np.array([i for group, _ in bodies for i in group], int)] = True
        outlined[self.geometry.surface[~self.compact]] = False  # the flat faces of a surface that is not compact as a whole stay obstacles
        skins = [skin for _, skin in bodies]
        return FlatRoom(joined, usable, obstacles.build(every.corners, every.surface), edges, self.table, skins, outlined)

    def searched(self, poses: np.ndarray, radar: Radar, max_bounces: int, prune: float, diffractions: int = 2) -> Searched:
        """Return the strong sequences of faces and edges of the flat room, from the array cache if it has them; arguments as in `FlatRoom`.

        The search does not depend on the small objects and on the density of ray tubes.
        """
        limits = {"max_bounces": max_bounces, "prune": prune, "diffractions": diffractions}
        spec = {"walls": self.walls.digest, **limits, **self.described(radar, poses)}
        make = partial(self.room.searched, poses, radar, **limits)
        return made_once(spec, {"poses": poses}, make, Searched.to_arrays, Searched.from_arrays)

    def described(self, radar: Radar, poses: np.ndarray) -> dict[str, Any]:
        """Return the properties of surfaces and radar that determine the paths. The frame rate matters only to a moving radar."""
        return {
            "reflection": self.table.digest,
            "element": radar.pattern,
            "antennas_m": (radar.tx_positions_m, radar.rx_positions_m),
            "wavelength_m": radar.wavelength_m,
            "frame_rate_hz": radar.frame_rate_hz if len(poses) > 1 else 0.0,
        }

    def room_paths(self, poses: np.ndarray, radar: Radar, max_bounces: int, prune: float, searched: Searched | None = None) -> list[Paths]:
        """Return the paths of the flat room, without and with edges. Their amplitudes include the shadows of the small objects.

        The arguments are those of `FlatRoom.paths` and `FlatRoom.searched`; without `searched`, the function searches for the sequences.
        """
        velocity = poses_module.relative(poses, None, radar.frame_rate_hz)[1]
        searched = self.searched(poses, radar, max_bounces, prune) if searched is None else searched
        parts = self.room.paths(poses, velocity, radar, prune, searched)
        return [self._shaded(part, poses) for part in parts]

    def _shaded(self, part: Paths, poses: np.ndarray) -> Paths:
        """Return paths of the room, whose amplitudes are multiplied by the shadow factors of the small objects."""
        assert part.points is not None
        amplitude = part.amplitude
        for _, body in self._bodies:
            factor = shadows.factors(body, poses[part.pose, :3, 3], part.points, part.mirror is not None, self.room.wavenumber)
            amplitude = amplitude * factor[:, None]
        return replace(part, amplitude=amplitude)

    def object_paths(
        self, settings: TraceSettings, poses: np.ndarray, radar: Radar, least: np.ndarray | None = None, direct: bool = True,
        flat: bool | None = None,
    ) -> Iterator[Paths]:  # fmt: skip
        """Trace the small or curved static objects in a room of flat faces one by one, because an object can have a million paths.

        Paths over the room whose amplitude is below `least` (F,) are left out. If `direct` is False, only the paths between these objects
        and the room are returned. `flat` is True for the opaque objects of flat faces alone, and False for all others.
        """
        geometry = self.geometry
        unmoved = np.tile(np.eye(4), (len(poses), 1, 1))
        done: list[int] = []  # indices of the objects that are already traced, so that paths between two objects are traced only once
        for cluster in clusters(self.surfaces, np.unique(geometry.surface[self.compact])):
            members = np.isin(geometry.surface, cluster) & self.compact
            group = Target(geometry_module.subset(geometry, members), self.table)
            if flat is None or flat == (polygons.of(*group) is not None):
                yield from coupling.group_paths(
                    settings, group, self.beside(cluster, done), radar, poses, unmoved, least=least, direct=direct
                )
            done += cluster


def static_scene(surfaces: list[Surface], radar: Radar) -> StaticScene:
    """Prepare static surfaces for tracing, or return the same prepared surfaces as in a previous call. A Mitsuba variant must be active."""
    geometry, table = target(surfaces, radar)
    # The meshes are copied, so that a later change of a mesh does not change the prepared surfaces.
    return _static_scenes.get(
        (geometry, id(table), *((s.name, s.role, s.correlation_m) for s in surfaces)), len(geometry.corners),
        lambda: StaticScene([s.replaced(mesh=s.mesh.copy()) for s in surfaces], geometry, table),
    )  # fmt: skip


def target(surfaces: list[Surface], radar: Radar) -> Target:
    """Prepare the triangles of the surfaces and their reflection coefficients in the radar's frequency sweep."""
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    table = reflection_table.build(
        [(s.material, s.roughness_m) for s in surfaces], radar.start_frequency_hz, high, [s.name for s in surfaces]
    )
    return Target(geometry_module.build([s.mesh for s in surfaces]), table)


def small_faces(surfaces: Sequence[Surface], geometry: Geometry) -> np.ndarray:
    """Return a mask (F,) of the faces of objects up to OBJECT_EXTENT_M long, of curved objects of any size, and of thin bodies."""
    small = np.array([s.kind == "object" and (float(s.mesh.extents.max()) <= OBJECT_EXTENT_M or s.is_curved()) for s in surfaces], bool)
    mask = small[geometry.surface] if len(surfaces) else np.zeros(0, bool)
    mask[~mask] = _thin(geometry.corners[~mask])
    return mask


def _thin(corners: np.ndarray) -> np.ndarray:
    """Return a mask of the triangles (F, 3, 3) of connected bodies that fit into a cylinder with the radius THIN_M."""
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)
    mesh.merge_vertices(digits_vertex=7)
    body = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(corners))
    thin = np.zeros(len(corners), bool)
    for face_ids in np.split(np.argsort(body, kind="stable"), np.cumsum(np.bincount(body))[:-1]) if len(corners) else ():
        points = corners[face_ids].reshape(-1, 3)
        points = points - (points.min(axis=0) + points.max(axis=0)) / 2
        if _radius(points, np.linalg.svd(points, full_matrices=False)[2][:1]) <= 2 * THIN_M:
            ways = (corners[face_ids] - np.roll(corners[face_ids], 1, axis=1)).reshape(-1, 3)
            thin[face_ids] = _radius(points, ways / np.linalg.norm(ways, axis=1, keepdims=True)) <= THIN_M
    return thin


def _radius(points: np.ndarray, axes: np.ndarray) -> float:
    """Return the radius of the thinnest cylinder around points (N, 3) whose axis runs through the origin along one of axes (M, 3)."""
    along = points @ axes.T
    return float(np.sqrt(np.maximum((points**2).sum(axis=1)[:, None] - along**2, 0.0)).max(axis=0).min())
