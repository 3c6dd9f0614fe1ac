"""Paths of a scene on Mitsuba 3: what is flat by panel images, what is small or curved by tubes, what moves in its own frame.

Static surfaces, seen by a sensor at rest, are traced for one pose and kept. A room of flat panels needs no tubes: its paths are exact
images with Fresnel factors (`panel_room`), at any pose. A room that is not flat, or whose `rays` are given, is traced by wide
tubes over the sphere, small things in it by tubes of about a wavelength over their bounding box; a tube belongs to whichever it
hits first, so nothing is counted twice. Beside panels, and wherever something moves, small things are traced in their own coordinates,
all poses in few launches, directly and by way of the panels (`coupling`). Rough surfaces add a cloud of scatterers fixed in the
world (`diffuse`). Not modelled: the shadow of a moving object on the room, and paths between two groups.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.sparse.csgraph import connected_components

from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import diffuse, path_cache, pruning, reflection_table, variant
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.curved.hits import Antennas, Occluder, TraceOptions
from radartwin.simulation.flat import coupling, panel_room
from radartwin.simulation.paths import Paths

WIDTH_RULE = 0.3  # room tubes are this times sqrt(wavelength x distance) wide; flat walls would stand 1, furniture would not
FARTHEST_M = 12.0  # beyond the range fold nothing sharpens the room's grid
NEAREST_M = 0.5
MAX_AROUND = 6_000_000
PRUNE = 1e-3  # of the strongest path of a pose and launch, antennas included: moves the signal of the furnished lab by 0.2 %
# Of the room's strongest path: what pairs of legs between small static things and the room may carry and be left out; in the cluttered
# atrium this changes the signal by 0.002.
PAIRS = 1e-2
AT_REST = 1e-12  # largest change of a pose that is no motion
ROOM = 0  # cluster of the large surfaces
NEIGHBOUR_M = 0.05  # small things closer than this are traced together
SCOUT_PRUNE = 2e-4  # while tracing, before antenna gains are known


@dataclass(frozen=True)
class TraceSettings:
    """How finely to trace.

    Attributes:
        max_bounces: reflections per path.
        rays: tubes per pose over the sphere for the room, or over the objects where there is no room; None: WIDTH_RULE.
        rays_per_wavelength2: tubes per square wavelength on objects.
        variant: "auto", "llvm" or "cuda".
        room: "panels" by images, "tubes", or "auto": panels where the room is flat and no `rays` are given.
        coupling: paths between objects and the room's panels.
        diffuse: the scatter of rough surfaces.
        coupled_rays_per_wavelength2: tubes on objects on their ways over the room, of which there are many; None: as many as on objects.
    """

    max_bounces: int = 4
    rays: int | None = None
    rays_per_wavelength2: float = 1.0
    variant: str = "auto"
    room: str = "auto"
    coupling: bool = True
    diffuse: bool = True
    coupled_rays_per_wavelength2: float | None = None

    def __post_init__(self) -> None:
        if self.room not in ("auto", "panels", "tubes"):
            raise InputError(f"room must be auto, panels or tubes, not {self.room!r}")
        for name in ("coupling", "diffuse"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} must be True or False, not {getattr(self, name)!r}")
        if self.room == "panels" and self.rays is not None:
            raise InputError(f"rays={self.rays!r} are of tubes, which room='panels' does not use; leave one of the two out")


@dataclass(frozen=True)
class Still:
    """The static surfaces of a scene: triangles, reflection and panels."""

    surfaces: list[Surface]
    geometry: geometry_module.Geometry
    room: panel_room.PanelRoom


@dataclass(frozen=True)
class MitsubaBackend:
    """Tubes and panel images with physical optics on Mitsuba 3."""

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
            Parts to be added up, each of F poses, or of one pose that holds for all frames.
        """
        variant.activate(self.settings.variant)
        motion = motion or {}
        static = [s for s in scene.surfaces if s.name not in motion]
        resting = bool((np.abs(sensor_poses - sensor_poses[:1]) < AT_REST).all())
        parts: list[Paths] = []
        still = None
        if static:
            still = self.still(static, radar)
            parts += self.static_paths_once(still, radar, sensor_poses[:1] if resting else sensor_poses)
        for names in _groups(motion):
            surfaces = [s for s in scene.surfaces if s.name in names]
            poses = motion[names[0]]
            seen_alike = slice(None)
            if resting and bool((np.abs(poses - poses[:1]) < AT_REST).all()):  # and hidden alike, in every frame
                seen_alike = slice(1)
            room, occluder = (None, None) if still is None else (still.room.beside(), still.geometry)
            built, table = geometry_module.build([s.mesh for s in surfaces]), reflection(surfaces, radar)
            parts += self.group_paths(built, table, room, occluder, radar, sensor_poses[seen_alike], poses[seen_alike])
        return [part for part in parts if len(part)]

    @staticmethod
    def still(surfaces: list[Surface], radar: Radar) -> Still:
        """What rests, built for tracing; a variant must be active."""
        built = geometry_module.build([s.mesh for s in surfaces])
        return Still(surfaces, built, panel_room.build(surfaces, built, reflection(surfaces, radar)))

    def static_paths_once(self, still: Still, radar: Radar, poses: np.ndarray) -> list[Paths]:
        """Static paths, kept: frames, objects, repetitions and chirp timings in the same room trace it once."""
        built, table = still.geometry, still.room.table
        spec = {
            "settings": replace(self.settings, variant=variant.activate(self.settings.variant)),
            "surfaces": [(s.kind, s.name, s.roughness_m, str(s.material)) for s in still.surfaces],
            # Of the radar, static paths depend on these three and on the table. The frame rate matters only where the radar moves.
            "element": radar.element,
            "wavelength_m": radar.wavelength_m,
            "frame_rate_hz": radar.frame_rate_hz if len(poses) > 1 else 0.0,
        }
        arrays = {
            "corners": built.corners, "normals": built.normals, "surface": built.surface, "te": table.te, "tm": table.tm,
            "frequencies_hz": table.frequencies_hz, "poses": poses,
        }  # fmt: skip
        return path_cache.traced_once(spec, arrays, lambda: self._static_parts(still, radar, poses))

    def _static_parts(self, still: Still, radar: Radar, poses: np.ndarray) -> list[Paths]:
        parts: list[Paths] = []
        if self.by_panels(still):
            velocity = poses_module.relative(poses, None, radar.frame_rate_hz)[1]
            parts.append(still.room.paths(poses, velocity, radar, self.settings.max_bounces, PRUNE))
            parts += self.small_things(still, radar, poses, PAIRS * float(pruning.level(parts[0], radar).max(initial=0.0)))
        else:
            parts.append(self._tube_paths(still.surfaces, still.geometry, still.room.table, radar, poses))
        return parts + self.scattered(still, radar, poses)

    def by_panels(self, still: Still) -> bool:
        """Whether images of panels stand for the room."""
        return self.settings.room == "panels" or (
            self.settings.room == "auto" and self.settings.rays is None and still.room.is_flat(still.surfaces)
        )

    def small_things(self, still: Still, radar: Radar, poses: np.ndarray, least: float) -> list[Paths]:
        """Paths by way of what is small or curved in a room of panels; `least`: amplitude that does not matter."""
        unmoved = np.tile(np.eye(4), (len(poses), 1, 1))
        done: list[int] = []  # of two small things, the first is traced over the panels of the second, not the other way round
        parts: list[Paths] = []
        for cluster in _clusters(still.surfaces, np.unique(still.geometry.surface[still.room.compact])):
            mine = np.isin(still.geometry.surface, cluster) & still.room.compact
            things, others = (geometry_module.subset(still.geometry, chosen) for chosen in (mine, ~mine))
            parts += self.group_paths(things, still.room.table, still.room.beside(cluster, done), others, radar, poses, unmoved, least)
            done += cluster
        return parts

    def scattered(self, still: Still, radar: Radar, poses: np.ndarray) -> list[Paths]:
        """The diffuse cloud of rough surfaces."""
        cloud = diffuse.cloud(still.surfaces) if self.settings.diffuse else None
        if cloud is None or not len(cloud):
            return []
        velocity = poses_module.relative(poses, None, radar.frame_rate_hz)[1]
        return [diffuse.paths(cloud, diffuse.strengths(still.surfaces, radar), still.geometry, radar, poses, velocity)]

    def _tube_paths(
        self,
        static: Sequence[Surface],
        built: geometry_module.Geometry,
        table: reflection_table.ReflectionTable,
        radar: Radar,
        poses: np.ndarray,
    ) -> Paths:
        small = _clusters(static, np.array([i for i, surface in enumerate(static) if surface.kind == "object"], int))
        kinds = np.full(len(static), ROOM)
        for label, members in enumerate(small, ROOM + 1):
            kinds[members] = label
        cluster = kinds[built.surface]
        sensor, velocity = poses_module.relative(poses, None, radar.frame_rate_hz)
        launches: list[tuple[tube_grid.TubeGrid, int]] = []
        if (cluster == ROOM).any():
            faces = 5 if radar.element != "isotropic" else 6
            rays = self.settings.rays or _room_rays(built, sensor[:, :3, 3], radar.wavelength_m)
            launches += [(one, ROOM) for one in tube_grid.all_around(sensor[:, :3, 3], sensor[:, :3, :3], rays, faces)]
        alone = not (cluster == ROOM).any()
        for label in range(ROOM + 1, ROOM + 1 + len(small)):
            part = geometry_module.subset(built, cluster == label)
            if len(part.corners):
                launches += [(one, label) for one in self._object_launches(part, sensor, radar, alone)]
        return self._collect(built, table, launches, sensor, velocity, cluster, None, radar)

    def group_paths(
        self,
        built: geometry_module.Geometry,
        table: reflection_table.ReflectionTable,
        room: panel_room.PanelRoom | None,
        occluder: geometry_module.Geometry | None,
        radar: Radar,
        sensor_poses: np.ndarray,
        poses: np.ndarray,
        least: float = 0.0,
        ball: tuple[np.ndarray, float] | None = None,
        prune: float = PRUNE,
    ) -> list[Paths]:
        """Paths by way of surfaces that keep their place to one another, in a room or not; `least`, `ball` and `prune` as in `coupling`."""
        coupled = room if room is not None and room.usable.any() and self.settings.coupling and self.settings.max_bounces > 1 else None
        over_room = self.settings.coupled_rays_per_wavelength2
        found = coupling.group_paths(
            coupled, built, table, sensor_poses, poses, radar,
            max_bounces=self.settings.max_bounces, cell_m=self._cell(built, sensor_poses, poses, radar, room is None),
            occluder=occluder, prune=prune, least=least, ball=ball,
            coupled_cell_m=None if over_room is None else radar.wavelength_m / float(np.sqrt(over_room)),
        )  # fmt: skip
        if found is not None:
            return found
        sensor, velocity = poses_module.relative(sensor_poses, poses, radar.frame_rate_hz)
        hidden = None if occluder is None else Occluder(occluder, poses[:, :3, :3], poses[:, :3, 3])
        launches = [(one, ROOM + 1) for one in self._object_launches(built, sensor, radar, room is None)]
        return [self._collect(built, table, launches, sensor, velocity, None, hidden, radar)]

    def _cell(self, built: geometry_module.Geometry, sensor_poses: np.ndarray, poses: np.ndarray, radar: Radar, alone: bool) -> float:
        """Width of a tube on an object, metres; by `rays` where there is nothing else to trace."""
        cell = radar.wavelength_m / np.sqrt(self.settings.rays_per_wavelength2)
        if alone and self.settings.rays:
            source = (poses_module.inverse(poses[:1]) @ sensor_poses[:1])[:, :3, 3]
            one = tube_grid.towards(built.hull_points(), source, built.centre, cell, built.grid_shift)
            if one is not None:
                cell *= np.sqrt(one.per_pose / self.settings.rays)
        return float(cell)

    def _object_launches(self, built: geometry_module.Geometry, sensor: np.ndarray, radar: Radar, alone: bool) -> list[tube_grid.TubeGrid]:
        """Tubes over a compact target; around the sensor where it is too close for one planar grid."""
        source = sensor[:, :3, 3]
        cell = radar.wavelength_m / np.sqrt(self.settings.rays_per_wavelength2)
        points = built.hull_points()
        if alone and self.settings.rays:
            one = tube_grid.towards(points, source[:1], built.centre, cell, built.grid_shift)
            if one is not None:
                cell *= np.sqrt(one.per_pose / self.settings.rays)
        grid = tube_grid.towards(points, source, built.centre, cell, built.grid_shift)
        if grid is not None:
            return [grid]
        reach = max(NEAREST_M, float(np.linalg.norm(points - source.mean(0), axis=1).max()))
        rays = min(MAX_AROUND, int(6 * (2 * reach / cell) ** 2))
        return tube_grid.all_around(source, sensor[:, :3, :3], rays)

    def _collect(
        self,
        built: geometry_module.Geometry,
        table: reflection_table.ReflectionTable,
        launches: Sequence[tuple[tube_grid.TubeGrid, int]],
        sensor: np.ndarray,
        velocity: np.ndarray,
        cluster: np.ndarray | None,
        occluder: Occluder | None,
        radar: Radar,
    ) -> Paths:
        """Trace launches and express the hits in the sensor's frame."""
        antenna = Antennas(sensor[:, :3, 3], sensor[:, :3, 2])
        # Each cluster is pruned by itself: an object's many small tubes are each far below a wall's flash, their sum is not.
        pruners: dict[int, pruning.Pruner] = {}
        parts: dict[int, list[Paths]] = {}
        for one, label in launches:
            options = TraceOptions(self.settings.max_bounces, cluster, label, occluder=occluder, prune=SCOUT_PRUNE, hats=label == ROOM)
            hits = tubes.trace(built, table, one, antenna, antenna, options)
            turn = sensor[hits.pose, :3, :3]
            departure, arrival = (np.einsum("nij,ni->nj", turn, d) for d in (hits.departure, hits.arrival))
            rate = -np.einsum("ni,ni->n", hits.departure + hits.arrival, velocity[hits.pose])
            part = Paths(
                len(sensor), hits.pose, hits.bounce, hits.amplitude, table.frequencies_hz, hits.length_in_m, hits.length_out_m,
                departure, arrival, rate,
            )  # fmt: skip
            parts.setdefault(label, []).append(pruners.setdefault(label, pruning.Pruner(radar, PRUNE, len(sensor))).add(part))
        kept = [pruners[label].add(Paths.concatenate(group)) for label, group in parts.items()]
        return kept[0] if len(kept) == 1 else Paths.concatenate(kept)


def _clusters(surfaces: Sequence[Surface], chosen: np.ndarray) -> list[list[int]]:
    """Chosen surfaces, by index, in groups of what stands closer than NEIGHBOUR_M; these see each other."""
    if not len(chosen):
        return []
    box = np.array([surfaces[i].mesh.bounds for i in chosen])
    apart = np.maximum(box[:, None, 0] - box[None, :, 1], box[None, :, 0] - box[:, None, 1]).max(axis=2)
    number, of = connected_components(apart < NEIGHBOUR_M, directed=False)
    return [chosen[of == k].tolist() for k in range(number)]


def reflection(surfaces: Sequence[Surface], radar: Radar) -> reflection_table.ReflectionTable:
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
