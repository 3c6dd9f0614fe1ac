"""Simulate scenes on Mitsuba 3: flat faces with edges for rooms of flat surfaces, and ray tubes for small or curved surfaces.

- In a room of flat surfaces, the simulator computes paths of reflections and edge diffractions exactly (`flat.room`), at any pose.
- In a room that is not flat, the simulator traces ray tubes (`tube_paths`). If the setting `rays` is given, it does so in every room.
- In a room of flat surfaces, and in any scene with moving parts, the simulator traces each object in the object's own frame, for all poses
  in a few batches. The simulator traces direct paths and paths that also reflect at flat faces (`coupling`).
- If the sensor moves, the simulator traces the paths between resting objects and the room at some of the sensor's positions, and moves them
  to the other positions (`track_paths`).
- Objects cast shadows on the paths of the room and on each other (`flat.shadows`).
- Rough surfaces scatter diffusely from a cloud of points, whose positions are fixed on the surface (`diffuse`).

If the sensor is at rest, the simulator traces the static surfaces only once and stores their paths in a cache. The simulator does not model
paths between two groups of surfaces that move differently.
"""

import atexit
from dataclasses import dataclass, field, replace

import numpy as np

from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation import diffuse, variant
from radartwin.simulation import poses as poses_module
from radartwin.simulation.backends.static_scene import static_scene, target
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.flat.room import Searched
from radartwin.simulation.paths import Paths
from radartwin.simulation.poses import ObjectPoses
from radartwin.store.recent import Recent

_tracks: Recent[Track] = Recent(1)  # the last track, which all blocks of a recording share
atexit.register(_tracks.clear)


@dataclass(frozen=True)
class Traced:
    """Hold the paths of a scene in four parts. The signals of all paths add up.

    Attributes:
        static: paths of the static surfaces. The paths of a flat room include their points (`Paths.points`).
        groups: paths of each group of surfaces that move together, by the names of these surfaces.
        shadows: the changes of the static paths in the shadows of all groups.
        diffuse: diffuse paths of all rough surfaces.
    """

    static: list[Paths]
    groups: dict[tuple[str, ...], list[Paths]]
    shadows: list[Paths]
    diffuse: list[Paths]

    def parts(self) -> list[Paths]:
        """Return all paths as the list that `Backend.paths` returns, without points."""
        moving = [part for group in self.groups.values() for part in group]
        return [replace(part, points=None) for part in (*self.static, *moving, *self.shadows, *self.diffuse) if len(part)]


@dataclass(frozen=True)
class MitsubaBackend:
    """Trace scenes by flat faces with edges and by ray tubes with physical optics, on Mitsuba 3."""

    settings: TraceSettings = field(default_factory=TraceSettings)
    name = "mitsuba"

    def paths(
        self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses | None = None, track: np.ndarray | None = None
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
        motion: ObjectPoses | None = None,
        track: np.ndarray | None = None,
        searched: Searched | None = None,
    ) -> "Traced":
        """Trace the paths as `paths` does, and return them in the four parts of `Traced`.

        Args:
            searched: sequences of faces and edges for a flat room; None searches for them. The other arguments are those of `paths`.
        """
        variant.activate(self.settings.variant)
        motion = motion or {}
        track = sensor_poses if track is None else track
        surfaces = [s for s in scene.surfaces if s.name not in motion]
        static = static_scene(surfaces, radar) if surfaces else None
        key = id(static), radar, track.tobytes(), self.settings, id(searched)
        along = _tracks.get(key, 1, lambda: Track(static or [], radar, track, self.settings, searched=searched))
        sensor = sensor_poses[:1] if along.still else sensor_poses
        still, movers, bodies, traced = None, [], [], Traced([], {}, [], [])
        if static is not None:
            traced.static.extend(along.static(sensor)[0])
            still = diffuse.Body(surfaces, static.geometry, np.eye(4)[None])
        for names in poses_module.rigid_groups(motion):
            poses = motion[names[0]]
            frames = slice(1) if along.still and poses_module.at_rest(poses) else slice(None)
            members = [s for s in scene.surfaces if s.name in names]
            group = target(members, radar)
            traced.groups[tuple(names)] = along.group(group, sensor_poses[frames], poses[frames])
            bodies.append((group.geometry, poses[frames]))
            movers.append(diffuse.Body(members, group.geometry, poses))
        traced.shadows.extend(along.shadows(bodies, sensor))
        if self.settings.diffuse and any(surface.roughness_m > 0 for surface in scene.surfaces):
            traced.diffuse.extend(diffuse.of_scene(still, movers, radar, sensor_poses))
        return traced
