"""Simulate scenes on Mitsuba 3: flat faces with edges for rooms of flat surfaces, and ray tubes for small or curved surfaces.

- In a room of flat surfaces, the simulator computes paths of reflections and edge diffractions exactly (`flat.room`), at any pose.
- In a room that is not flat, the simulator traces ray tubes (`tube_paths`). If the setting `rays` is given, it does so in every room.
- In a room of flat surfaces, and in any scene with moving parts, the simulator traces each object in the object's own frame, for all poses
  in a few batches. The simulator traces direct paths and paths that also reflect at flat faces (`coupling`).
- If the sensor moves, the simulator traces the paths between resting objects and the room at some of the sensor's positions, and moves them
  to the other positions (`places`).
- Objects cast shadows on the room's paths (`flat.silhouette`) and on each other (`flat.shadows`).
- Rough surfaces scatter diffusely from a cloud of points, whose positions are fixed on the surface (`diffuse`).

If the sensor is at rest, the simulator traces the static surfaces only once and stores their paths in a cache. The simulator does not model
paths between two groups of surfaces that move differently.
"""

import atexit
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import diffuse, pruning, reflection_table, variant
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation.backends import tube_paths
from radartwin.simulation.backends.static_scene import StaticScene, Surroundings, shadows_of_mover
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.tube_paths import Target
from radartwin.simulation.flat import coupling
from radartwin.simulation.flat.room import Searched
from radartwin.simulation.merging import merged
from radartwin.simulation.paths import Paths, traced_once
from radartwin.simulation.places import OVER_ROOM, TracedPlaces, closest, covering
from radartwin.store.digest import array_digest
from radartwin.store.recent import Recent

# Prepared static surfaces, which together have at most CACHED_FACES faces.
_static_scenes: Recent[StaticScene] = Recent(geometry_module.CACHED_FACES)
atexit.register(_static_scenes.clear)


@dataclass(frozen=True)
class Traced:
    """Hold the paths of a scene in four parts. The signals of all paths add up.

    Attributes:
        static: paths of the static surfaces. The paths of a flat room include their points (`Paths.points`).
        groups: paths of each group of surfaces that move together, by the names of these surfaces.
        shadows: for each group, the changes of the static paths in its shadow.
        diffuse: diffuse paths of all rough surfaces.
    """

    static: list[Paths]
    groups: dict[tuple[str, ...], list[Paths]]
    shadows: list[list[Paths]]
    diffuse: list[Paths]

    def parts(self) -> list[Paths]:
        """Return all paths as the list that `Backend.paths` returns, without points."""
        moving = [part for group, shadow in zip(self.groups.values(), self.shadows, strict=True) for part in (*group, *shadow)]
        return [replace(part, points=None) for part in (*self.static, *moving, *self.diffuse) if len(part)]


@dataclass(frozen=True)
class MitsubaBackend:
    """Trace scenes by flat faces with edges and by ray tubes with physical optics, on Mitsuba 3."""

    settings: TraceSettings = field(default_factory=TraceSettings)
    name = "mitsuba"

    def paths(
        self,
        scene: Scene,
        radar: Radar,
        sensor_poses: np.ndarray,
        motion: Mapping[str, np.ndarray] | None = None,
        track: np.ndarray | None = None,
    ) -> list[Paths]:
        """Trace the paths of all static surfaces and of all groups of surfaces that move together.

        Args:
            scene, radar, sensor_poses, motion: as in `radartwin.simulation.backends.backend.Backend.paths`, which also describes the
                result.
            track: (T, 4, 4) all sensor poses of a recording, of which `sensor_poses` are a part; None if they are the whole recording. The
                sequences of faces and edges are searched once for the whole track.
        """
        return self.traced(scene, radar, sensor_poses, motion, track).parts()

    def traced(
        self,
        scene: Scene,
        radar: Radar,
        sensor_poses: np.ndarray,
        motion: Mapping[str, np.ndarray] | None = None,
        track: np.ndarray | None = None,
        searched: Searched | None = None,
    ) -> "Traced":
        """Trace the paths as `paths` does, and return them in the four parts of `Traced`.

        Args:
            searched: sequences of faces and edges for a flat room; None searches for them. The other arguments are those of `paths`.
        """
        variant.activate(self.settings.variant)
        motion = motion or {}
        surfaces = [s for s in scene.surfaces if s.name not in motion]
        resting = poses_module.at_rest(sensor_poses if track is None else track)
        surroundings = Surroundings(None, None)
        still, movers, found = None, [], Traced([], {}, [], [])
        if surfaces:
            static = static_scene(surfaces, radar)
            if resting or track is None:
                found.static.extend(self.cached_static_paths(static, radar, sensor_poses[:1] if resting else sensor_poses, searched))
            else:
                bounces = self.settings.max_bounces
                searched = static.searched(track, radar, bounces, pruning.PRUNE) if self._by_faces(static) else None
                found.static.extend(self._static_paths(static, radar, sensor_poses, searched, track))
            if motion:
                surroundings = Surroundings(static.beside(flat=static.is_flat), static.geometry)
            still = diffuse.Body(surfaces, static.geometry, np.eye(4)[None])
        levels = [pruning.level(part, radar) for part in found.static] if motion else []
        for names in poses_module.rigid_groups(motion):
            poses = motion[names[0]]
            frames = slice(1) if resting and poses_module.at_rest(poses) else slice(None)
            members = [s for s in scene.surfaces if s.name in names]
            group = target(members, radar)
            found.groups[tuple(names)] = self.group_paths(group, surroundings, radar, sensor_poses[frames], poses[frames])
            if surroundings.room is not None:
                wavenumber = surroundings.room.wavenumber
                found.shadows.append(shadows_of_mover(found.static, levels, group.geometry, sensor_poses, poses[frames], wavenumber))
            else:
                found.shadows.append([])
            movers.append(diffuse.Body(members, group.geometry, poses))
        if self.settings.diffuse and any(surface.roughness_m > 0 for surface in scene.surfaces):
            found.diffuse.extend(diffuse.of_scene(still, movers, radar, sensor_poses))
        return found

    def cached_static_paths(self, static: StaticScene, radar: Radar, poses: np.ndarray, searched: Searched | None = None) -> list[Paths]:
        """Return the paths of the static surfaces.

        The simulator traces these paths once per room. All frames, objects and repetitions then use the cached paths; with a resting radar,
        all chirp timings too.

        Args:
            searched: sequences of faces and edges that were found in a flat room whose geometry differs by much less than a wavelength;
                None searches for them.
        """
        spec = {
            "settings": replace(self.settings, variant=variant.activate(self.settings.variant)),
            "surfaces": [(s.kind, s.name, s.roughness_m, str(s.material)) for s in static.surfaces],
            "geometry": static.geometry.digest,
            "searched": None if searched is None else {name: array_digest(array) for name, array in searched.to_arrays().items()},
            "frame_duration_s": radar.frame_duration_s if len(poses) > 1 else 0.0,  # merged paths depend on it
            **static.described(radar, poses),
        }
        return traced_once(spec, {"poses": poses}, lambda: self._static_paths(static, radar, poses, searched))

    def _static_paths(
        self, static: StaticScene, radar: Radar, poses: np.ndarray, searched: Searched | None, track: np.ndarray | None = None
    ) -> list[Paths]:
        settings = self.settings
        if self._by_faces(static):
            parts = static.room_paths(poses, radar, settings.max_bounces, pruning.PRUNE, searched)
            loudest = max(float(pruning.level(part, radar).max(initial=0.0)) for part in parts)
            track = poses if track is None else track
            if settings.place_spacing_m == 0 or poses_module.at_rest(track):
                return [*parts, *self.object_paths(static, radar, poses, pruning.PAIRS * loudest)]
            alone = MitsubaBackend(replace(settings, coupling=False)).object_paths(static, radar, poses)
            alone = [merged(part, radar) for part in alone]
            if not settings.coupling or settings.max_bounces == 1:
                return [*parts, *alone]
            return [*parts, *alone, *self._over_room(static, radar, poses, track, pruning.PAIRS * loudest)]
        return [tube_paths.room_paths(static.surfaces, Target(static.geometry, static.table), settings, radar, poses)]

    def _over_room(self, static: StaticScene, radar: Radar, poses: np.ndarray, track: np.ndarray, least: float) -> list[Paths]:
        """Return the paths between the small or curved static objects and the flat room, for the poses (F, 4, 4) of a moving sensor, which
        are a part of its poses `track` (T, 4, 4). They are traced at some poses of the track and moved to `poses`.
        """
        settings = self.settings
        if settings.coupled_rays_per_wavelength2 is None:
            settings = replace(settings, coupled_rays_per_wavelength2=OVER_ROOM * settings.rays_per_wavelength2)
        spacing = settings.place_spacing_m
        places = track[covering(track, spacing)]
        chosen = np.unique(closest(places, spacing, poses))
        if len(chosen) == 1 < len(places):  # `coupling` treats a single place as a resting radar, so that its paths would differ a little
            chosen = np.array([max(chosen[0] - 1, 0), max(chosen[0], 1)])
        places = places[chosen]
        parts = MitsubaBackend(settings).object_paths(static, radar, places, least, direct=False)
        return TracedPlaces(places, parts, radar, partial(closest, places, spacing)).seen(poses, radar.frame_rate_hz)

    def _by_faces(self, static: StaticScene) -> bool:
        """Return whether the room is traced by flat faces with edges, not by ray tubes."""
        settings = self.settings
        return settings.room == "panels" or (settings.room == "auto" and settings.rays is None and static.is_flat)

    def object_paths(self, static: StaticScene, radar: Radar, poses: np.ndarray, least: float = 0.0, direct: bool = True) -> list[Paths]:
        """Trace the small or curved static objects in a room of flat faces, without paths whose amplitude is below `least`. If `direct` is
        False, return only the paths between these objects and the room.
        """
        geometry = static.geometry
        unmoved = np.tile(np.eye(4), (len(poses), 1, 1))
        done: list[int] = []  # indices of the objects that are already traced, so that paths between two objects are traced only once
        parts: list[Paths] = []
        for cluster in tube_paths.clusters(static.surfaces, np.unique(geometry.surface[static.compact])):
            members = np.isin(geometry.surface, cluster) & static.compact
            objects, others = (geometry_module.subset(geometry, chosen) for chosen in (members, ~members))
            surroundings = Surroundings(static.beside(cluster, done), others)
            found = self.group_paths(Target(objects, static.table), surroundings, radar, poses, unmoved, least, direct=direct)
            parts += found if direct else found[1:]
            done += cluster
        return parts

    def group_paths(
        self,
        group: Target,
        surroundings: Surroundings,
        radar: Radar,
        sensor_poses: np.ndarray,
        poses: np.ndarray,
        least: float = 0.0,
        ball: tuple[np.ndarray, float] | None = None,
        prune: float = pruning.PRUNE,
        direct: bool = True,
    ) -> list[Paths]:
        """Trace the paths of a group of surfaces that move together.

        Args:
            group: triangles and reflection table of the surfaces.
            surroundings: static surfaces around the group.
            radar: radar whose frequency sweep and frame rate apply.
            sensor_poses: (F, 4, 4) transformations from the sensor frame to the world.
            poses: (F, 4, 4) transformations from the group's own frame to the world.
            least, ball, prune, direct: as in `radartwin.simulation.flat.coupling.group_paths`.
        """
        settings, room = self.settings, surroundings.room
        alone = room is None
        coupled = room is not None and bool(room.usable.any()) and settings.coupling and settings.max_bounces > 1
        source = (poses_module.inverse(poses[:1]) @ sensor_poses[:1])[:, :3, 3]
        density = settings.coupled_rays_per_wavelength2
        found = coupling.group_paths(
            room, group.geometry, group.table, sensor_poses, poses, radar, max_bounces=settings.max_bounces,
            cell_m=tube_paths.cell_m(group.geometry, settings, source, radar, alone), prune=prune, coupled=coupled, least=least,
            ball=ball, coupled_cell_m=None if density is None else radar.wavelength_m / float(np.sqrt(density)), direct=direct,
        )  # fmt: skip
        if found is not None:
            return found
        # An object too close for a planar grid of tubes has direct paths only.
        return [tube_paths.object_paths(group, settings, sensor_poses, poses, radar, surroundings.occluder, alone)] if direct else []


def static_scene(surfaces: list[Surface], radar: Radar) -> StaticScene:
    """Prepare static surfaces for tracing, or return the same prepared surfaces as in a previous call. A Mitsuba variant must be active."""
    geometry, table = target(surfaces, radar)
    # The meshes are copied, so that a later change of a mesh does not change the prepared surfaces.
    return _static_scenes.get(
        (geometry, id(table), *((s.name, s.role) for s in surfaces)), len(geometry.corners),
        lambda: StaticScene([s.replaced(mesh=s.mesh.copy()) for s in surfaces], geometry, table),
    )  # fmt: skip


def target(surfaces: list[Surface], radar: Radar) -> Target:
    """Prepare the triangles of the surfaces and their reflection coefficients in the radar's frequency sweep."""
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    table = reflection_table.build(
        [(s.material, s.roughness_m) for s in surfaces], radar.start_frequency_hz, high, [s.name for s in surfaces]
    )
    return Target(geometry_module.build([s.mesh for s in surfaces]), table)
