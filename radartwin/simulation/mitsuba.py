"""Paths of a scene by tubes on Mitsuba 3: static surfaces in one frame, each moving group in its own.

Small or moving surfaces ("object") get tubes of about a wavelength over their bounding box, large ones ("room") wide tubes over the
sphere; a tube belongs to whichever kind it hits first, so nothing is counted twice. A static scene seen by a sensor at rest is traced for
one pose. A moving group is traced by itself in its own coordinates, all poses in few launches, with the static surfaces as occluders.
Not modelled here: paths between a moving group and the room, and the shadow a moving object casts on the room.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import launch as launch_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation import reflection_table, tubes, variant
from radartwin.simulation.paths import Paths

WIDTH_RULE = 0.3  # room tubes are this times sqrt(wavelength x distance) wide; flat walls would stand 1, furniture would not
FARTHEST_M = 12.0  # beyond the range fold nothing sharpens the room's grid
NEAREST_M = 0.5
MAX_AROUND = 6_000_000
PRUNE = 1e-3  # of the strongest path of a pose and launch, antennas included: moves the signal of the furnished lab by 0.2 %
AT_REST = 1e-12  # largest change of a pose that is no motion
ROOM = 0  # cluster of the large surfaces
ROOMS_KEPT = 4  # static path sets in memory, some tens of megabytes each
SCOUT_PRUNE = 2e-4  # while tracing, before antenna gains are known


_traced: dict[str, Paths] = {}  # by digest of geometry, reflection, poses and settings; oldest first


@dataclass(frozen=True)
class TraceSettings:
    """How finely to trace.

    Attributes:
        max_bounces: reflections per path.
        rays: tubes per pose over the sphere for the room, or over the objects where there is no room; None: WIDTH_RULE.
        rays_per_wavelength2: tubes per square wavelength on objects.
        variant: "auto", "llvm" or "cuda".
    """

    max_bounces: int = 4
    rays: int | None = None
    rays_per_wavelength2: float = 1.0
    variant: str = "auto"


@dataclass(frozen=True)
class MitsubaBackend:
    """Tubes with physical optics on Mitsuba 3."""

    settings: TraceSettings = TraceSettings()
    name: ClassVar[str] = "mitsuba"

    def paths(self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None = None) -> list[Paths]:
        """Paths of every static part and moving group.

        Args:
            scene: surfaces; those named in `motion` in their own frames.
            radar: waveform (band and carrier) and whether its elements see backwards.
            sensor_poses: (F, 4, 4) sensor to world.
            motion: (F, 4, 4) object-to-world poses by surface name.
        Returns:
            One Paths per part, of F poses, or of one pose that holds for all frames.
        """
        variant.activate(self.settings.variant)
        motion = motion or {}
        static = [s for s in scene.surfaces if s.name not in motion]
        resting = bool((np.abs(sensor_poses - sensor_poses[:1]) < AT_REST).all())
        parts = []
        room = geometry_module.build([s.mesh for s in static])
        if static:
            poses = sensor_poses[:1] if resting else sensor_poses
            parts.append(self._static_paths_once(static, room, radar, poses))
        for names in _groups(motion):
            surfaces = [s for s in scene.surfaces if s.name in names]
            poses = motion[names[0]]
            parts.append(self._group_paths(surfaces, room if static else None, radar, sensor_poses, poses))
        return parts

    def _static_paths_once(self, static: Sequence[Surface], built: geometry_module.Geometry, radar: Radar, poses: np.ndarray) -> Paths:
        """Static paths, kept in memory: frames, objects and repetitions in the same room trace it once."""
        table = _table(static, radar)
        parts = (built.corners, built.normals, built.surface, table.te, table.tm, table.frequencies_hz, poses)
        total = hashlib.sha256(repr((self.settings, radar.element, radar.frame_rate_hz, [s.kind for s in static])).encode())
        for part in parts:
            total.update(np.ascontiguousarray(part).tobytes())
        key = total.hexdigest()
        if key not in _traced:
            while len(_traced) >= ROOMS_KEPT:
                _traced.pop(next(iter(_traced)))
            _traced[key] = self._static_paths(static, built, table, radar, poses)
        return _traced[key]

    def _static_paths(
        self,
        static: Sequence[Surface],
        built: geometry_module.Geometry,
        table: reflection_table.ReflectionTable,
        radar: Radar,
        poses: np.ndarray,
    ) -> Paths:
        labels: dict[object, int] = {}
        kinds = [labels.setdefault(s.name or i, len(labels) + 1) if s.kind == "object" else ROOM for i, s in enumerate(static)]
        cluster = np.asarray(kinds)[built.surface]
        sensor, velocity = poses_module.relative(poses, None, radar.frame_rate_hz)
        launches: list[tuple[launch_module.Launch, int]] = []
        if (cluster == ROOM).any():
            faces = 5 if radar.element != "isotropic" else 6
            rays = self.settings.rays or _room_rays(built, sensor[:, :3, 3], radar.wavelength_m)
            launches += [(one, ROOM) for one in launch_module.all_around(sensor[:, :3, 3], sensor[:, :3, :3], rays, faces)]
        alone = not (cluster == ROOM).any()
        for label in range(1, len(labels) + 1):
            part = geometry_module.Geometry(
                built.corners[cluster == label], built.normals[cluster == label], built.surface[cluster == label]
            )
            if len(part.corners):
                launches += [(one, label) for one in self._object_launches(part, sensor, radar, alone)]
        return self._collect(built, table, launches, sensor, velocity, cluster, None, radar)

    def _group_paths(
        self,
        surfaces: Sequence[Surface],
        room: geometry_module.Geometry | None,
        radar: Radar,
        sensor_poses: np.ndarray,
        poses: np.ndarray,
    ) -> Paths:
        built = geometry_module.build([s.mesh for s in surfaces])
        sensor, velocity = poses_module.relative(sensor_poses, poses, radar.frame_rate_hz)
        still = room is None or float(np.abs(poses - poses[:1]).max()) < AT_REST
        if still and float(np.abs(sensor - sensor[:1]).max()) < AT_REST:  # seen alike, and hidden alike, in every frame
            sensor, velocity, poses = sensor[:1], velocity[:1], poses[:1]
        occluder = None if room is None else tubes.Occluder(room, poses[:, :3, :3], poses[:, :3, 3])
        launches = [(one, ROOM + 1) for one in self._object_launches(built, sensor, radar, room is None)]
        return self._collect(built, _table(surfaces, radar), launches, sensor, velocity, None, occluder, radar)

    def _object_launches(
        self, built: geometry_module.Geometry, sensor: np.ndarray, radar: Radar, alone: bool
    ) -> list[launch_module.Launch]:
        """Tubes over a compact target; around the sensor where it is too close for one planar grid."""
        source = sensor[:, :3, 3]
        cell = radar.wavelength_m / np.sqrt(self.settings.rays_per_wavelength2)
        points = built.hull_points()
        if alone and self.settings.rays:
            one = launch_module.towards(points, source[:1], built.centre, cell, built.grid_shift)
            if one is not None:
                cell *= np.sqrt(one.per_pose / self.settings.rays)
        grid = launch_module.towards(points, source, built.centre, cell, built.grid_shift)
        if grid is not None:
            return [grid]
        reach = max(NEAREST_M, float(np.linalg.norm(points - source.mean(0), axis=1).max()))
        rays = min(MAX_AROUND, int(6 * (2 * reach / cell) ** 2))
        return launch_module.all_around(source, sensor[:, :3, :3], rays)

    def _collect(
        self,
        built: geometry_module.Geometry,
        table: reflection_table.ReflectionTable,
        launches: Sequence[tuple[launch_module.Launch, int]],
        sensor: np.ndarray,
        velocity: np.ndarray,
        cluster: np.ndarray | None,
        occluder: tubes.Occluder | None,
        radar: Radar,
    ) -> Paths:
        """Trace launches and express the hits in the sensor's frame."""
        antenna = tubes.Antennas(sensor[:, :3, 3], sensor[:, :3, 2])
        parts: dict[int, list[Paths]] = {}
        for one, label in launches:
            hits = tubes.trace(
                built, table, one, antenna, antenna,
                max_bounces=self.settings.max_bounces, cluster=cluster, first_hit=label, occluder=occluder, prune=SCOUT_PRUNE,
                hats=label == ROOM,
            )  # fmt: skip
            turn = sensor[hits.pose, :3, :3]
            departure, arrival = (np.einsum("nij,ni->nj", turn, d) for d in (hits.departure, hits.arrival))
            rate = -np.einsum("ni,ni->n", hits.departure + hits.arrival, velocity[hits.pose])
            part = Paths(
                len(sensor), hits.pose, hits.bounce, hits.amplitude, table.frequencies_hz, hits.length_in_m, hits.length_out_m,
                departure, arrival, rate,
            )  # fmt: skip
            parts.setdefault(label, []).append(part)
        # Each cluster is pruned by itself: an object's many small tubes are each far below a wall's flash, their sum is not.
        kept = []
        for group in parts.values():
            joined = Paths.concatenate(group)
            gain = element_gain(radar.element, joined.departure) * element_gain(radar.element, joined.arrival)
            kept.append(joined.where(joined.stands_out(PRUNE, gain)))
        return kept[0] if len(kept) == 1 else Paths.concatenate(kept)


def _table(surfaces: Sequence[Surface], radar: Radar) -> reflection_table.ReflectionTable:
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    return reflection_table.build([(s.material, s.roughness_m) for s in surfaces], radar.start_frequency_hz, high)


def _groups(motion: Mapping[str, np.ndarray]) -> list[list[str]]:
    """Names that move alike, and so keep their place to one another."""
    groups: list[list[str]] = []
    for name, poses in motion.items():
        for group in groups:
            if np.array_equal(motion[group[0]], poses):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def _room_rays(built: geometry_module.Geometry, positions: np.ndarray, wavelength_m: float) -> int:
    """Tubes over the sphere by the width rule at the farthest surface."""
    corners = built.corners.reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    away = np.maximum(np.abs(positions - low), np.abs(positions - high))
    distance = float(np.clip(np.linalg.norm(away, axis=1).max(), NEAREST_M, FARTHEST_M))
    return min(MAX_AROUND, int(6 * (2 / (WIDTH_RULE * np.sqrt(wavelength_m / distance))) ** 2))
