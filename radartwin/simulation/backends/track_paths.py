"""Paths along a track, which is a line of sensor poses through a room at rest: at one pose, on one recording, or on many drives.

The poses share what takes long to compute. The sequences of faces and edges that give strong paths are searched once for the track, and the
paths of these sequences are computed exactly at every pose. The paths between objects and the room are numerous. Over centimetres, their
amplitudes change slowly, but their phases turn by radians. They are traced only at some poses (places) and moved to the poses around each
place. The move keeps the amplitudes; the new lengths, directions and rates of change are exact for the first and last points of a path.
The mirror point of a flat face moves with the radar: a box on a floor, 0.5 to 1 m away, had an error of 0.3 to 0.5 of its paths over the
floor. Clutter of flat faces is therefore traced at every pose, except for the drives of one track (`sparse`).
Moved paths that the radar cannot resolve become one path (`merging`). Paths of the flat room and direct echoes are not moved, because the
phase between edge waves and specular echo changes within millimetres (error of moved paths: 0.23 of the signal).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from radartwin.compiled import compiled, shared_out
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import diffuse, geometry, pruning, variant
from radartwin.simulation import poses as poses_module
from radartwin.simulation.backends import tube_paths
from radartwin.simulation.backends.coupling import SPARSE, group_paths, shadows_of_movers
from radartwin.simulation.backends.static_scene import StaticScene, static_scene, target
from radartwin.simulation.backends.trace_settings import SPACING_M, TraceSettings
from radartwin.simulation.flat.room import FlatRoom, Searched
from radartwin.simulation.merging import merged
from radartwin.simulation.paths import Paths, from_arrays, made_once, to_arrays, traced_once
from radartwin.simulation.signal.synthesis import received
from radartwin.store.digest import array_digest
from radartwin.store.recent import Recent

# Tubes per square wavelength for paths between object and room of a moving radar, relative to the density of the direct echo. Error: 0.10
# of their signal for a metal can in the laboratory; with half as many tubes: 0.21.
OVER_ROOM = 0.5
MOVED = 16_000_000  # number of amplitudes that are moved at once (256 MB)
TURNED_RAD = np.deg2rad(3.0)  # largest turn of a pose against its place, whose antenna gives polarisation and pruning of the paths
BEYOND_M = 0.04  # extension of the track at both ends of the nominal drive, because an actual drive may start earlier or end later
DENSE_M = 0.01  # spacing of the poses of a track that stands for all drives along it
TOGETHER = 5  # largest number of places traced at once; limits memory
RESTING = 12  # number of resting objects, such as the parts of a turntable's stand, whose paths are cached
# Fields of the radar that do not change the noiseless samples of one chirp of a resting radar.
UNREAD_AT_REST = (
    "name", "num_chirps", "chirp_interval", "frame_rate_hz", "noise_figure_db", "transmit_power_dbm", "phase_noise",
)  # fmt: skip
ASIDE_M = 0.015  # placement error of an object: three standard deviations
BALL_M, BALL_STEP = 0.1, 1.5  # smallest radius of the balls around objects for which legs are searched, and ratio of successive radii


@dataclass(frozen=True, eq=False)
class TracedPlaces:
    """Hold the paths that are traced at P places.

    Attributes:
        places: (P, 4, 4) sensor poses.
        parts: paths at these poses.
        place_of: returns the index (F,) of the place whose paths belong to each of F sensor poses (F, 4, 4).
    """

    places: np.ndarray
    parts: Sequence[Paths]
    radar: Radar
    place_of: Callable[[np.ndarray], np.ndarray]

    @cached_property
    def _gains(self) -> list[np.ndarray]:
        """Return the antenna gain (N,) of the paths of each part."""
        return [pruning.both_gains(self.radar, part.departure, part.arrival) for part in self.parts]

    def seen(self, poses: np.ndarray, frame_rate_hz: float) -> list[Paths]:
        """Return the paths for a sensor that drives through `poses` (F, 4, 4), as several `Paths` objects of F poses each.

        Paths that the radar cannot resolve are merged (`radartwin.simulation.merging`). About MOVED amplitudes are moved at once, because
        there are many more paths before they are merged.
        """
        velocity = np.einsum("fji,fj->fi", poses[:, :3, :3], poses_module.relative(poses, None, frame_rate_hz)[1])
        place = self.place_of(poses)
        frame, there = poses[:, :3, :3], self.places[place, :3, :3]
        shift = np.einsum("fji,fj->fi", there, poses[:, :3, 3] - self.places[place, :3, 3])
        rotation = np.swapaxes(frame, 1, 2) @ there
        out = []
        for part, gain in zip(self.parts, self._gains, strict=True):
            amplitudes = np.cumsum(np.bincount(part.pose, minlength=len(self.places))[place]) * part.amplitude.shape[1]
            blocks = np.split(np.arange(len(poses)), np.flatnonzero(np.diff(amplitudes // MOVED)) + 1)
            moved = [self._carried(part, gain, place[block], shift[block], rotation[block], velocity[block]) for block in blocks]
            out.append(Paths.concatenate([
                replace(paths, poses=len(poses), pose=paths.pose + block[0]) for paths, block in zip(moved, blocks, strict=True)
            ]))  # fmt: skip
        return out

    def _carried(
        self, part: Paths, gain: np.ndarray, place: np.ndarray, shift: np.ndarray, rotation: np.ndarray, velocity: np.ndarray
    ) -> Paths:
        """Move the paths of the nearest traced sensor position (index (F,)) to each of F sensor poses, and merge them.

        Args:
            gain: (N,) antenna gain of the paths of `part`.
            shift: (F, 3) from place to pose, in the sensor frame at the place.
            rotation: (F, 3, 3) from this frame to the sensor frame at the pose.
            velocity: (F, 3) of the sensor in the sensor frame at the pose.
        """
        assert part.mirror is None
        first = np.searchsorted(part.pose, np.arange(len(self.places) + 1))
        count = first[place + 1] - first[place]
        start = np.concatenate([[0], np.cumsum(count)])
        total = int(start[-1])
        amplitude, bounces = np.empty((total, part.amplitude.shape[1]), complex), np.empty(total, part.bounces.dtype)
        length, way = np.empty((2, total)), np.empty((2, total, 3))
        rate = np.empty(total)
        read = (part.amplitude, part.bounces, part.length_in_m, part.length_out_m, part.departure, part.arrival)
        shared_out(_carry, len(place), start, first[place], shift, rotation, velocity, *read, amplitude, bounces, length, way, rate)
        pose = np.repeat(np.arange(len(place)), count)
        moved = Paths(len(place), pose, bounces, amplitude, part.frequencies_hz, length[0], length[1], way[0], way[1], rate)
        return merged(moved, self.radar, gain[np.arange(total) + (first[place] - start[:-1])[pose]])


@dataclass(frozen=True, eq=False)
class Shaded:
    """Hold the static paths that bodies can shade, and the level (F,) of the strongest of all static paths at each of F poses."""

    parts: list[Paths]
    strongest: np.ndarray

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Return all fields as named arrays, which the array cache can store."""
        return to_arrays(self.parts) | {"strongest": self.strongest}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> "Shaded":
        """Rebuild the object from the result of `to_arrays`. Raises ValueError, LookupError or TypeError if the arrays do not fit."""
        return Shaded(from_arrays(arrays), arrays["strongest"])


class Track:
    """Trace paths along a track through one room.

    Args:
        surfaces: static surfaces of the room, or these surfaces prepared for tracing; empty for free space.
        radar: waveform, frame rate and element pattern.
        poses: (T, 4, 4) sensor poses of the track. Every pose that is traced later is one of them, or at most SPACING_M/2 from one.
        settings: of the tracer.
        sparse: whether many drives share the track. The paths of clutter (the small or curved static objects of the room) are then traced
            with fewer tubes, and the direct ones are moved too.
        searched: sequences of faces and edges that were found in a room whose geometry differs by much less than a wavelength; None
            searches for them.
    """

    def __init__(
        self, surfaces: Sequence[Surface] | StaticScene, radar: Radar, poses: np.ndarray, settings: TraceSettings, sparse: bool = False,
        searched: Searched | None = None,
    ):  # fmt: skip
        variant.activate(settings.variant)
        prepared = surfaces if isinstance(surfaces, StaticScene) else static_scene(list(surfaces), radar) if len(surfaces) else None
        self._room, self._radar, self._poses, self._settings, self._sparse = prepared, radar, poses, settings, sparse
        self._given = searched
        self._latest: tuple[bytes, list[Paths], list[np.ndarray]] = (b"", [], [])
        self._latest_shaded: tuple[bytes, Shaded] = (b"", Shaded([], np.zeros(0)))
        self._sampled: tuple[tuple[bytes, str], np.ndarray] = ((b"", ""), np.zeros(0))
        self._of_place: dict[int, list[Paths]] = {}  # the paths of the clutter at the places that are traced
        self._resting: Recent[tuple[Sequence[Surface], list[Paths]]] = Recent(RESTING)  # with surfaces, so that their ids stay in use

    @staticmethod
    def of_drives(
        surfaces: Sequence[Surface], radar: Radar, nominal: np.ndarray, settings: TraceSettings, offset: float = 0.0,
        searched: Searched | None = None,
    ) -> "Track":  # fmt: skip
        """Return the track that all drives along a straight nominal drive (F, 4, 4) share.

        Repeated drives along one nominal drive differ by centimetres, which changes the phase of echoes by radians.

        Args:
            offset: shift of the places along the track, as a fraction of their spacing. Different offsets give independent tracing errors.
            surfaces, radar, settings, searched: as in the class.
        """
        still = poses_module.at_rest(nominal)
        poses = nominal[:1] if still else along_line(nominal, DENSE_M, offset * SPACING_M / DENSE_M)
        return Track(surfaces, radar, poses, settings, True, searched)

    @cached_property
    def searched(self) -> Searched | None:
        """Return the strong sequences of faces and edges along the track; None if the room is traced by tubes."""
        if self._given is not None or self._room is None or not self._by_faces:
            return self._given
        settings = self._settings
        return self._room.searched(self._poses, self._radar, settings.max_bounces, settings.prune, settings.diffractions)

    @cached_property
    def surroundings(self) -> FlatRoom | None:
        """Return the room around objects that do not belong to it; None in free space."""
        return None if self._room is None else self._room.beside(flat=self._room.is_flat)

    @cached_property
    def _by_faces(self) -> bool:
        """Return whether the room is traced by flat faces with edges, not by ray tubes."""
        settings = self._settings
        return settings.room == "panels" or (
            settings.room == "auto" and settings.rays is None and self._room is not None and self._room.is_flat
        )

    @cached_property
    def _places(self) -> np.ndarray:
        """Return the poses (P, 4, 4) of the track at which paths between objects and room are traced."""
        return self._poses[covering(self._poses, self._settings.place_spacing_m or SPACING_M)]

    @cached_property
    def still(self) -> bool:
        """Return whether the sensor rests."""
        return poses_module.at_rest(self._poses)

    def static(self, poses: np.ndarray, on_disk: bool = True) -> tuple[list[Paths], list[np.ndarray]]:
        """Return the paths of the room at rest at poses (F, 4, 4), and their levels. The paths of faces and edges include their points.

        The last result is cached. The paths that a resting radar sees are stored for all frames, objects, repetitions and chirp timings.

        Args:
            on_disk: whether to store paths also in the folder of the array cache. The paths of a cluttered room take up to 1 GB.
        """
        assert self._room is not None
        key = poses.tobytes()
        if self._latest[0] != key:
            if self.still:
                parts = traced_once(self._described(poses), {"poses": poses}, lambda: self._static(poses), on_disk)
            else:
                parts = self._static(poses)
            self._latest = key, parts, [pruning.level(part, self._radar) for part in parts]
        return self._latest[1:]

    def _described(self, poses: np.ndarray) -> dict[str, Any]:
        """Return all that determines the paths of the room at rest, as part of a cache key."""
        room, searched = self._room, self._given
        assert room is not None
        return {
            "settings": replace(self._settings, variant=variant.activate(self._settings.variant)),
            "surfaces": [(s.kind, s.name, s.roughness_m, s.correlation_m, str(s.material)) for s in room.surfaces],
            "geometry": room.geometry.digest,
            "track": array_digest(self._poses),  # for which the sequences of faces and edges are searched
            "sparse": self._sparse,
            "searched": None if searched is None else {name: array_digest(array) for name, array in searched.to_arrays().items()},
            **room.described(self._radar, poses),
        }

    def _shaded(self, poses: np.ndarray) -> Shaded:
        """Return the paths of the room that bodies can shade, at poses (F, 4, 4). The last result is cached. The array cache stores the
        result of a resting radar, which takes a thousandth of the disk space of all paths.
        """

        def make() -> Shaded:
            parts, levels = self.static(poses, on_disk=False)
            return Shaded([part for part in parts if part.points is not None], self._loudest_of(parts, len(poses), levels))

        key = poses.tobytes()
        if self._latest_shaded[0] != key:
            if self.still:
                spec = {"shaded": self._described(poses)}
                shaded = made_once(spec, {"poses": poses}, make, Shaded.to_arrays, Shaded.from_arrays)
            else:
                shaded = make()
            self._latest_shaded = key, shaded
        return self._latest_shaded[1]

    def _static(self, poses: np.ndarray) -> list[Paths]:
        room, settings, radar = self._room, self._settings, self._radar
        assert room is not None
        if not self._by_faces:
            return [tube_paths.room_paths(room.surfaces, tube_paths.Target(room.geometry, room.table), settings, radar, poses)]
        walls = room.room_paths(poses, radar, settings.max_bounces, settings.prune, self.searched)
        if self.still or settings.place_spacing_m == 0:  # every pose is a place, with all tubes
            clutter = room.object_paths(settings, poses, radar, pruning.PAIRS * self._loudest_of(walls, len(poses)))
            return [*walls, *((merged(part, radar) for part in clutter) if self._sparse else clutter)]
        if not self._sparse:
            alone = room.object_paths(replace(settings, coupling=False), poses, radar, flat=False)
            least = pruning.PAIRS * self._loudest_of(walls, len(poses))
            flat = room.object_paths(self._thinned(OVER_ROOM), poses, radar, least, flat=True)
            walls = [*walls, *(merged(part, radar) for paths in (alone, flat) for part in paths)]
            if not settings.coupling or settings.max_bounces == 1:
                return walls
        return [*walls, *self._clutter(poses).seen(poses, radar.frame_rate_hz)]

    @cached_property
    def _loudest(self) -> np.ndarray:
        """Return the level (P,) of the strongest path of the flat room at each place."""
        assert self._room is not None
        walls = self._room.room_paths(self._places, self._radar, self._settings.max_bounces, self._settings.prune, self.searched)
        return self._loudest_of(walls, len(self._places))

    def _loudest_of(self, parts: Sequence[Paths], poses: int, levels: Sequence[np.ndarray] | None = None) -> np.ndarray:
        levels = [pruning.level(part, self._radar) for part in parts] if levels is None else levels
        return pruning.strongest(parts, levels, poses)

    def _clutter(self, poses: np.ndarray) -> TracedPlaces:
        """Return the paths of the clutter at the places that are nearest to the poses of a drive (F, 4, 4).

        Each place is traced once for all drives. Direct paths are included if the track is sparse.
        """
        room, index, sparse = self._room, np.unique(self._place_of(poses)), self._sparse
        assert room is not None
        settings = self._thinned(SPARSE if sparse else OVER_ROOM)
        least = (pruning.PAIRS_OF_DRIVES if sparse else pruning.PAIRS) * self._loudest
        # Places are traced in fixed groups, so that the paths of a place do not depend on what was traced before.
        places = np.arange(len(self._places))
        for block in np.array_split(places, -(-len(places) // TOGETHER)):
            if not set(block) & set(index) or int(block[0]) in self._of_place:
                continue
            found = room.object_paths(settings, self._places[block], self._radar, least[block], sparse, None if sparse else False)
            parts = [pruning.pruned(part, self._radar, pruning.CLUTTER) if sparse else part for part in found]
            self._of_place |= {place: [part.frames(k, k + 1) for part in parts] for k, place in enumerate(block)}
        return self._joined([index[k : k + 1] for k in range(len(index))], [self._of_place[place] for place in index])

    def _thinned(self, share: float) -> TraceSettings:
        """Return settings with a share of the tubes for paths between object and room, unless the settings give their density."""
        settings = self._settings
        if settings.coupled_rays_per_wavelength2 is not None:
            return settings
        return replace(settings, coupled_rays_per_wavelength2=share * settings.rays_per_wavelength2)

    def _place_of(self, poses: np.ndarray) -> np.ndarray:
        """Return the index (F,) of the place that is closest to each of F sensor poses (F, 4, 4)."""
        return closest(self._places, self._settings.place_spacing_m or SPACING_M, poses)

    def _joined(self, indices: Sequence[np.ndarray], traced: Sequence[Sequence[Paths]]) -> TracedPlaces:
        """Return the TracedPlaces of the paths `traced` that were traced at the places with the increasing `indices`.

        Paths with the same frequency nodes become one `Paths` object.
        """
        alike: dict[bytes, list[Paths]] = {}
        for of, index in zip(traced, indices, strict=True):
            for part in of:
                moved = replace(part, poses=len(self._places), pose=index[part.pose])
                alike.setdefault(part.frequencies_hz.tobytes(), []).append(moved)
        return TracedPlaces(self._places, [Paths.concatenate(parts) for parts in alike.values()], self._radar, self._place_of)

    def room(self, poses: np.ndarray) -> list[Paths]:
        """Return all paths of the room without other objects, for a drive through `poses` (F, 4, 4)."""
        if self._room is None:
            return []
        body = diffuse.Body(self._room.surfaces, self._room.geometry, np.eye(4)[None])
        rough = diffuse.of_scene(body, [], self._radar, poses) if self._settings.diffuse else []
        return [*(replace(part, points=None) for part in self.static(poses, on_disk=False)[0]), *rough]

    def room_samples(self, poses: np.ndarray, elements: str = "exact") -> np.ndarray:
        """Return the samples (F or 1, C, T, R, N) of the room without objects, for sensor poses (F, 4, 4); the last result is cached.

        All chirps of a resting radar are equal, so that the array cache stores one chirp for all chirp timings.
        """
        key = poses.tobytes(), elements
        if self._sampled[0] != key:
            radar = self._radar

            def make(radar: Radar = radar) -> np.ndarray:
                return received(self.room(poses), radar, len(poses), elements=elements, oscillator=None)

            if self.still and self._room is not None:
                read_fields = {name: value for name, value in vars(radar).items() if name not in UNREAD_AT_REST}
                spec = {"samples": self._described(poses), "radar": read_fields, "elements": elements}
                chirp = made_once(
                    spec, {"poses": poses}, lambda: make(replace(radar, num_chirps=1)), lambda iq: {"iq": iq}, lambda arrays: arrays["iq"]
                )
                self._sampled = key, np.broadcast_to(chirp, (len(chirp), radar.num_chirps, *chirp.shape[2:]))
            else:
                self._sampled = key, make()
        return self._sampled[1]

    def over_room(self, surfaces: Sequence[Surface], drive: np.ndarray | None = None, aside: np.ndarray | None = None) -> TracedPlaces:
        """Trace the paths that include both a compact resting object and the room, along the track.

        Args:
            drive: (F, 4, 4) sensor poses of the only drive for which the result is used. The paths are then traced only at the places
                that are nearest to one of these poses.
            aside: as in `moving`.
        """
        index = np.arange(len(self._places)) if drive is None else np.unique(self._place_of(drive))
        blocks = np.array_split(index, -(-len(index) // TOGETHER))
        settings, at_rest = self._thinned(OVER_ROOM), np.eye(4)[None]
        traced = [self._moving(settings, surfaces, self._places[block], at_rest, aside, direct=False)[1:] for block in blocks]
        return self._joined(blocks, traced)

    def moving(
        self, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray, coupled: bool = True, aside: np.ndarray | None = None,
        shadow: bool = True, direct: bool = True,
    ) -> list[Paths]:  # fmt: skip
        """Trace a compact object at `poses` (F, 4, 4) from sensor poses `sensor` (F, 4, 4). A single pose holds for all frames.

        Args:
            coupled: whether to include paths between the object and the room. The object does not hide diffuse paths of the room, because
                `room` does not know the object.
            aside: (3,) metres from the nominal to the actual object position. Legs that reflect at faces of the room are searched for a
                ball around the nominal position, so that all objects placed there share these legs.
            shadow: whether to include the changes of the flat room's paths in the shadow of the object (`shadow`).
            direct: whether to include the direct and the diffuse paths of the object.
        """
        settings = self._settings if coupled else replace(self._settings, coupling=False)
        traced = self._moving(settings, surfaces, sensor, poses, aside, direct)
        parts = [merged(part, self._radar) for part in (traced if direct else traced[1:])]
        if shadow:
            parts += self.shadow(surfaces, sensor, poses)
        if not (self._settings.diffuse and direct):
            return parts
        body = diffuse.Body(surfaces, geometry.build([s.mesh for s in surfaces]), poses)
        others = [] if self._room is None else [diffuse.Body(self._room.surfaces, self._room.geometry, np.eye(4)[None])]
        return [*parts, diffuse.mover_paths(body, others, self._radar, sensor)]

    def shadow(self, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray) -> list[Paths]:
        """Return the paths that add the shadow of an object to the paths of the room; arguments as in `moving`."""
        if self._room is None:
            return []
        return self.shadows([(geometry.build([s.mesh for s in surfaces]), poses_module.repeated(poses, len(sensor)))], sensor)

    def shadows(self, bodies: Sequence[tuple[geometry.Geometry, np.ndarray]], sensor: np.ndarray) -> list[Paths]:
        """Return the paths that add the shadows of bodies to the paths of the room from sensor poses `sensor`.

        Args:
            bodies: as in `coupling.shadows_of_movers`.
        """
        if self._room is None or not bodies:
            return []
        shaded = self._shaded(sensor)
        levels = [pruning.level(part, self._radar) for part in shaded.parts]
        return shadows_of_movers(shaded.parts, levels, shaded.strongest, bodies, sensor, self._room.room.wavenumber)

    def at_rest(self, surfaces: Sequence[Surface], sensor: np.ndarray, coupled: bool) -> list[Paths]:
        """Return the paths of `moving` for an object at rest before a radar at rest. The paths of the RESTING objects that were used last
        are cached.

        Two calls share paths only if they pass the same `Surface` objects.
        """
        key = tuple(map(id, surfaces)), sensor.tobytes(), coupled
        return self._resting.get(key, 1, lambda: (surfaces, self.moving(surfaces, sensor, np.eye(4)[None], coupled)))[1]

    def group(self, group: tube_paths.Target, sensor: np.ndarray, poses: np.ndarray) -> list[Paths]:
        """Return the paths of surfaces that move together, at poses (F, 4, 4), from sensor poses `sensor` (F, 4, 4)."""
        return group_paths(self._settings, group, self.surroundings, self._radar, sensor, poses)

    def _moving(
        self, settings: TraceSettings, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray, aside: np.ndarray | None,
        direct: bool = True,
    ) -> list[Paths]:  # fmt: skip
        group = target(list(surfaces), self._radar)
        built = group.geometry
        frames = max(len(sensor), len(poses))
        sensor, poses = poses_module.repeated(sensor, frames), poses_module.repeated(poses, frames)
        centres = poses[:, :3, :3] @ built.centre + poses[:, :3, 3]
        size = BALL_M * BALL_STEP ** np.ceil(np.log(max(built.radius_m, 1e-6) / BALL_M) / np.log(BALL_STEP))
        step = size / 2
        logged = centres[0] if aside is None else centres[0] - aside
        ball = (np.round(logged / step) * step + 0.0, float(size + np.sqrt(3) / 2 * step + ASIDE_M))
        wanders = float(np.linalg.norm(centres - ball[0], axis=1).max()) + built.radius_m > ball[1]
        return group_paths(
            settings, group, self.surroundings, self._radar, sensor, poses, ball=None if wanders else ball, prune=pruning.THING,
            direct=direct,
        )  # fmt: skip


def _line(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the unit direction (3,) from the first to the farthest pose of a drive (F, 4, 4), and the distance (F,) of each pose from
    the first pose along this direction.
    """
    at = poses[:, :3, 3] - poses[0, :3, 3]
    away = np.linalg.norm(at, axis=1)
    length = float(away.max())
    way = at[away.argmax()] / length if length > 0 else np.eye(3)[0]
    return way, at @ way


def straight(poses: np.ndarray) -> bool:
    """Return whether a drive (F, 4, 4) keeps to one line and heading, in one direction or there and back, so that a track can represent
    it.
    """
    way, along = _line(poses)
    aside = np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3] - along[:, None] * way, axis=1)
    turned = np.arccos(np.clip((np.einsum("fij,ij->f", poses[:, :3, :3], poses[0, :3, :3]) - 1) / 2, -1, 1))
    return bool(aside.max() <= 0.5 * SPACING_M and turned.max() <= TURNED_RAD)


def along_line(poses: np.ndarray, spacing_m: float, offset: float = 0.0) -> np.ndarray:
    """Return P equally spaced sensor poses (P, 4, 4) along a straight nominal drive (F, 4, 4) and beyond both ends of its line.

    Both ways of a drive there and back share these poses, which have the heading of the drive's first pose. All are shifted forward by
    `offset` times their spacing.
    """
    way, along = _line(poses)
    beyond = int(np.ceil(BEYOND_M / spacing_m))
    low, high = (int(np.ceil(end / spacing_m - 1e-9)) for end in (-along.min(), along.max()))
    steps = (np.arange(-low - beyond, high + beyond + 1) + offset) * spacing_m
    out = np.repeat(poses[:1], len(steps), axis=0)
    out[:, :3, 3] = poses[0, :3, 3] + steps[:, None] * way
    return out


_covered: Recent[np.ndarray] = Recent(1)  # the places of the last track, which all blocks of a recording share


def covering(poses: np.ndarray, spacing_m: float) -> np.ndarray:
    """Return indices (P,) of poses (F, 4, 4), the places. Each pose is at most half of `spacing_m` from a place and turned by at most
    TURNED_RAD against it. A pose that is both moved and turned is closer to its place. Dense poses on a line have places that are about
    `spacing_m` apart. The last result is cached.
    """

    def find() -> np.ndarray:
        points, reach = _points(poses, spacing_m), 0.5 * spacing_m * (1 + 1e-9)
        places, left = [], np.arange(len(poses))
        while len(left):
            beyond = np.linalg.norm(points[left[0] :] - points[left[0]], axis=1) > reach
            places.append(left[0] + (int(beyond.argmax()) if beyond.any() else len(beyond)) - 1)
            left = left[np.linalg.norm(points[left] - points[places[-1]], axis=1) > reach]
        return np.array(places)

    return _covered.get((array_digest(poses), spacing_m), 1, find)


def closest(places: np.ndarray, spacing_m: float, poses: np.ndarray) -> np.ndarray:
    """Return the index (F,) of the place that is closest to each of F sensor poses (F, 4, 4), for P places (P, 4, 4)."""
    return np.asarray(KDTree(_points(places, spacing_m)).query(_points(poses, spacing_m))[1])


def _points(poses: np.ndarray, spacing_m: float) -> np.ndarray:
    """Return the positions, scaled headings and scaled antenna axes (F, 9) of poses (F, 4, 4). A turn by TURNED_RAD is at least as far as
    half of `spacing_m`.
    """
    turned = 0.5 * spacing_m / TURNED_RAD * np.concatenate([poses[:, :3, 0], poses[:, :3, 2]], axis=1)
    return np.concatenate([poses[:, :3, 3], turned], axis=1)


@compiled
def _carry(
    low, high, start, first, shift, rotation, velocity, amplitude, bounces, length_in, length_out, departure, arrival,
    amplitude_to, bounces_to, length_to, way_to, rate_to,
):  # fmt: skip
    """For each sensor pose from `low` to `high`, move the paths of the nearest traced sensor position (place) to this pose and write them
    to the arrays `*_to`.
    """
    moved = np.empty(3)
    for f in range(low, high):
        for row in range(start[f], start[f + 1]):
            n = first[f] + row - start[f]
            for q in range(amplitude.shape[1]):
                amplitude_to[row, q] = amplitude[n, q]
            bounces_to[row] = bounces[n]
            total = 0.0
            for end in range(2):
                length = length_in[n] if end == 0 else length_out[n]
                size = 0.0
                for i in range(3):
                    moved[i] = length * (departure[n, i] if end == 0 else arrival[n, i]) - shift[f, i]
                    size += moved[i] ** 2
                size = np.sqrt(size)
                length_to[end, row] = size
                for i in range(3):
                    turned = (rotation[f, i, 0] * moved[0] + rotation[f, i, 1] * moved[1] + rotation[f, i, 2] * moved[2]) / size
                    way_to[end, row, i] = turned
                    total -= turned * velocity[f, i]
            rate_to[row] = total
