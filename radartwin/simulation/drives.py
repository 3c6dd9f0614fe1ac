"""Paths of many drives along one track, on which the sensor moves past a resting object in a resting room.

Repeated drives along one nominal drive differ by centimetres, which changes the phase of echoes by radians. The drives can therefore not
share traced paths unchanged, but they share two results. First, the sequences of faces and edges that give strong paths are searched once
for the track. The paths of these sequences are then computed exactly at every pose of every drive. Second, the paths of clutter (the small
or curved static objects of the room), and the paths between an object and the room, are traced only at sensor positions with a spacing of 4
cm along the track, and moved to the other poses (`places`). Paths of the flat room and direct echoes of a target are not moved but traced
at every pose, because the phase between edge waves and specular echo changes within millimetres (error of moved paths: 0.23 of the signal).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import diffuse, geometry, pruning, variant
from radartwin.simulation import poses as poses_module
from radartwin.simulation.backends.mitsuba import MitsubaBackend, static_scene, target
from radartwin.simulation.backends.static_scene import Surroundings, shadows_of_mover
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.flat.room import Searched
from radartwin.simulation.merging import merged
from radartwin.simulation.paths import Paths
from radartwin.simulation.places import OVER_ROOM, SPACING_M, TURNED_RAD, TracedPlaces
from radartwin.simulation.signal.synthesis import received
from radartwin.store.recent import Recent

# As OVER_ROOM, for clutter. Error: 0.03 of the signal of a metal umbrella stand, 0.10 of the signal of a litter bin.
CLUTTER_OVER_ROOM = 0.125
BEYOND_M = 0.04  # extension of the track at both ends of the nominal drive, because an actual drive may start earlier or end later
TOGETHER = 20  # largest number of places traced at once; limits memory
RESTING = 12  # number of resting objects, such as the parts of a turntable's stand, whose paths are cached
ASIDE_M = 0.015  # placement error of an object: three standard deviations
BALL_M, BALL_STEP = 0.1, 1.5  # smallest radius of the balls around objects for which legs are searched, and ratio of successive radii


def nearest(places: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return the index (F,) of the place nearest to each of F sensor poses (F, 4, 4). The places (P, 4, 4) are equally spaced on a line."""
    along = places[-1, :3, 3] - places[0, :3, 3]
    where = (poses[:, :3, 3] - places[0, :3, 3]) @ along / (along @ along) * (len(places) - 1)
    return np.clip(np.round(where), 0, len(places) - 1).astype(int)


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


def places_along(poses: np.ndarray, spacing_m: float, offset: float = 0.0) -> np.ndarray:
    """Return P equally spaced sensor poses (P, 4, 4) along a straight nominal drive (F, 4, 4) and beyond both ends of its line. Both ways
    of a drive there and back share these poses. All returned poses have the heading of the drive's first pose.

    All returned poses are shifted forward by `offset` times their spacing.
    """
    way, along = _line(poses)
    beyond = int(np.ceil(BEYOND_M / spacing_m))
    low, high = (int(np.ceil(end / spacing_m - 1e-9)) for end in (-along.min(), along.max()))
    steps = (np.arange(-low - beyond, high + beyond + 1) + offset) * spacing_m
    out = np.repeat(poses[:1], len(steps), axis=0)
    out[:, :3, 3] = poses[0, :3, 3] + steps[:, None] * way
    return out


def _in_turn(parts: Sequence[Paths | None], chosen: Sequence[np.ndarray], poses: int) -> Paths:
    """Join `Paths` objects to one `Paths` object of `poses` poses. `chosen` has the increasing indices of the poses of each object."""
    shifted = [replace(part, poses=poses, pose=index[part.pose]) for part, index in zip(parts, chosen, strict=True) if part is not None]
    return Paths.concatenate(shifted)


def _joined(places: np.ndarray, chosen: Sequence[np.ndarray], some: Sequence[Sequence[Paths]], radar: Radar) -> TracedPlaces:
    """Return the TracedPlaces of the paths `some` that were traced at the places with the increasing indices `chosen`."""
    longest = max(len(parts) for parts in some)
    parts = [_in_turn([parts[k] if k < len(parts) else None for parts in some], chosen, len(places)) for k in range(longest)]
    return TracedPlaces(places, parts, radar, partial(nearest, places))


class Drives:
    """Trace drives along one track through one room.

    Args:
        surfaces: static surfaces of the room; empty for free space.
        radar: waveform, frame rate and element pattern.
        nominal: (F, 4, 4) sensor poses of the straight nominal drive.
        settings: of the tracer. `rays` must be None, and the room is traced by flat faces.
        offset: shift of the traced sensor positions along the track, as a fraction of their spacing. Different offsets give independent
            tracing errors.
        similar: drives through a room that differs by much less than a wavelength. A resting sensor then uses the sequences of faces and
            edges that were found in that room.
    """

    def __init__(
        self, surfaces: Sequence[Surface], radar: Radar, nominal: np.ndarray, settings: TraceSettings, offset: float = 0.0,
        similar: "Drives | None" = None,
    ):  # fmt: skip
        variant.activate(settings.variant)
        self._similar = similar
        self._backend, self._radar = MitsubaBackend(settings), radar
        self._places = places_along(nominal, SPACING_M, offset)
        self._things, self._small = (
            MitsubaBackend(replace(settings, coupled_rays_per_wavelength2=tubes)) for tubes in (OVER_ROOM, CLUTTER_OVER_ROOM)
        )
        self._still = static_scene(list(surfaces), radar) if len(surfaces) else None
        self._latest: tuple[bytes, list[Paths], list[np.ndarray]] = (b"", [], [])
        self._sampled: tuple[tuple[bytes, str], np.ndarray] = ((b"", ""), np.zeros(0))
        self._of_place: dict[int, list[Paths]] = {}  # the paths of the clutter at the places that are traced
        self._resting: Recent[tuple[Sequence[Surface], list[Paths]]] = Recent(RESTING)  # with surfaces, so that their ids stay in use

    def room(self, poses: np.ndarray) -> list[Paths]:
        """Return the paths of the room without the object, for a drive through `poses` (F, 4, 4)."""
        if self._still is None:
            return []
        body = diffuse.Body(self._still.surfaces, self._still.geometry, np.eye(4)[None])
        rough = diffuse.of_scene(body, [], self._radar, poses) if self._backend.settings.diffuse else []
        clutter = [] if (poses == poses[0]).all() else self._clutter(poses).seen(poses, self._radar.frame_rate_hz)
        return [*(replace(part, points=None) for part in self._walls(poses)[0]), *clutter, *rough]

    def room_samples(self, poses: np.ndarray, elements: str = "exact") -> np.ndarray:
        """Return the samples (F or 1, C, T, R, N) of the room without the object, for sensor poses (F, 4, 4); the last result is cached."""
        key = poses.tobytes(), elements
        if self._sampled[0] != key:
            self._sampled = key, received(self.room(poses), self._radar, len(poses), elements=elements, oscillator=None)
        return self._sampled[1]

    def _walls(self, poses: np.ndarray) -> tuple[list[Paths], list[np.ndarray]]:
        """Return the paths of the flat room with their points, and their levels, for a drive through `poses` (F, 4, 4).

        The last result is cached.

        For a resting sensor, the result also has the paths of the clutter.
        """
        assert self._still is not None
        key = poses.tobytes()
        if self._latest[0] != key:
            if (poses == poses[0]).all():
                searched = None if self._similar is None else self._similar._found(poses[:1])
                parts = self._backend.cached_static_paths(self._still, self._radar, poses[:1], searched)
            else:
                parts = self._still.room_paths(poses, self._radar, self._backend.settings.max_bounces, pruning.PRUNE, self._searched)
            self._latest = key, parts, [pruning.level(part, self._radar) for part in parts]
        return self._latest[1:]

    @cached_property
    def _searched(self) -> Searched | None:
        return self._found(self._places)

    def _found(self, poses: np.ndarray) -> Searched | None:
        """Return the strong sequences of faces and edges along a motion."""
        if self._still is None:
            return None
        return self._still.searched(poses, self._radar, self._backend.settings.max_bounces, pruning.PRUNE)

    @cached_property
    def _loudest(self) -> float:
        """Return the level of the strongest path of the flat room along the track."""
        assert self._still is not None
        walls = self._still.room_paths(self._places, self._radar, self._backend.settings.max_bounces, pruning.PRUNE, self._searched)
        return max(float(pruning.level(part, self._radar).max(initial=0.0)) for part in walls)

    def _clutter(self, poses: np.ndarray) -> TracedPlaces:
        """Return the paths of the clutter at the places that are nearest to the poses of a drive (F, 4, 4).

        Each place is traced once for all drives.
        """
        still, index = self._still, np.unique(nearest(self._places, poses))
        assert still is not None
        missing = np.array([place for place in index if place not in self._of_place], int)
        for block in np.array_split(missing, -(-len(missing) // TOGETHER)) if len(missing) else ():
            parts = self._small.object_paths(still, self._radar, self._places[block], pruning.PAIRS_OF_DRIVES * self._loudest)
            parts = [pruning.pruned(part, self._radar, pruning.CLUTTER) for part in parts]
            self._of_place |= {place: [part.frames(k, k + 1) for part in parts] for k, place in enumerate(block)}
        return _joined(self._places, [index[k : k + 1] for k in range(len(index))], [self._of_place[place] for place in index], self._radar)

    @cached_property
    def _beside(self):
        return None if self._still is None else self._still.beside()

    def over_room(self, surfaces: Sequence[Surface], drive: np.ndarray | None = None, aside: np.ndarray | None = None) -> TracedPlaces:
        """Trace the paths that include both a compact resting object and the room, along the track.

        Args:
            drive: (F, 4, 4) sensor poses of the only drive for which the result is used. The paths are then traced only at the places
                that are nearest to one of these poses.
            aside: as in `moving`.
        """
        at_rest = np.eye(4)[None]
        places = slice(None) if drive is None else nearest(self._places, drive)

        def traced(some: np.ndarray) -> list[Paths]:
            return self._moving(self._things, surfaces, some, at_rest, True, aside, direct=False)[1:]

        return self._track(traced, places)

    def _track(self, traced: Callable[[np.ndarray], list[Paths]], chosen: np.ndarray | slice = slice(None)) -> TracedPlaces:
        """Call `traced` for the places with the indices `chosen`, and return the traced paths as TracedPlaces."""
        places = self._places
        index = np.unique(np.arange(len(places))[chosen])
        blocks = np.array_split(index, -(-len(index) // TOGETHER))
        return _joined(places, blocks, [traced(places[block]) for block in blocks], self._radar)

    def moving(
        self, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray, coupled: bool = True, aside: np.ndarray | None = None,
        shadow: bool = True,
    ) -> list[Paths]:  # fmt: skip
        """Trace a compact object at `poses` (F, 4, 4) from sensor poses `sensor` (F, 4, 4). A single pose holds for all frames.

        Args:
            coupled: whether to include paths between the object and the room. The diffuse paths of the object are always included. The
                object does not hide diffuse paths of the room, because `room` does not know the object.
            aside: (3,) metres from the nominal to the actual object position. Legs that reflect at faces of the room are searched for a
                ball around the nominal position, so that all objects placed there share these legs.
            shadow: whether to include the changes of the flat room's paths in the shadow of the object (`shadow`).
        """
        found = [merged(part, self._radar) for part in self._moving(self._backend, surfaces, sensor, poses, coupled, aside)]
        body = diffuse.Body(surfaces, geometry.build([s.mesh for s in surfaces]), poses)
        if shadow:
            found += self.shadow(surfaces, sensor, poses)
        if not self._backend.settings.diffuse:
            return found
        others = [] if self._still is None else [diffuse.Body(self._still.surfaces, self._still.geometry, np.eye(4)[None])]
        return [*found, diffuse.mover_paths(body, others, self._radar, sensor)]

    def shadow(self, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray) -> list[Paths]:
        """Return the paths that add the shadow of an object to the paths of the flat room; arguments as in `moving`."""
        if self._still is None:
            return []
        body, there = geometry.build([s.mesh for s in surfaces]), poses_module.repeated(poses, len(sensor))
        return shadows_of_mover(*self._walls(sensor), body, sensor, there, self._still.room.wavenumber)

    def at_rest(self, surfaces: Sequence[Surface], sensor: np.ndarray, coupled: bool) -> list[Paths]:
        """Return the paths of `moving` for an object at rest before a radar at rest. The paths of the RESTING objects that were used last
        are cached.

        Two calls share paths only if they pass the same `Surface` objects.
        """
        key = tuple(map(id, surfaces)), sensor.tobytes(), coupled
        return self._resting.get(key, 1, lambda: (surfaces, self.moving(surfaces, sensor, np.eye(4)[None], coupled)))[1]

    def _moving(
        self, backend: MitsubaBackend, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray, coupled: bool,
        aside: np.ndarray | None, direct: bool = True,
    ) -> list[Paths]:  # fmt: skip
        group = target(list(surfaces), self._radar)
        built = group.geometry
        frames = max(len(sensor), len(poses))
        sensor, poses = poses_module.repeated(sensor, frames), poses_module.repeated(poses, frames)
        centres = poses[:, :3, :3] @ built.centre + poses[:, :3, 3]
        radius = float(np.linalg.norm(built.corners.reshape(-1, 3) - built.centre, axis=1).max(initial=0))
        size = BALL_M * BALL_STEP ** np.ceil(np.log(max(radius, 1e-6) / BALL_M) / np.log(BALL_STEP))
        step = size / 2
        logged = centres[0] if aside is None else centres[0] - aside
        ball = (np.round(logged / step) * step + 0.0, float(size + np.sqrt(3) / 2 * step + ASIDE_M))
        wanders = float(np.linalg.norm(centres - ball[0], axis=1).max()) + radius > ball[1]
        occluder = None if self._still is None else self._still.geometry
        if not coupled:
            backend = MitsubaBackend(replace(backend.settings, coupling=False))
        return backend.group_paths(
            group, Surroundings(self._beside, occluder), self._radar, sensor, poses, ball=None if wanders else ball, prune=pruning.THING,
            direct=direct,
        )  # fmt: skip
