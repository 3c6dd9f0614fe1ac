"""Many drives along one track: a sensor that moves through a room at rest, past a thing at rest.

Drives that follow one log differ by centimetres, their echoes by radians, so nothing traced for one serves another as it is. What can be
shared is: which panel sequences matter along the track, scouted once and evaluated exactly at every pose of every drive; and paths by way
of clutter, and of a thing by way of the room, traced at places along the track and carried from the nearest one to wherever the sensor is:
lengths, directions and rates exactly for the points they meet first and last, amplitudes as they are. Neither panel images are carried nor
the echoes straight back from a thing under test: the waves from an edge turn against the flash beside it within millimetres, which left
0.23 of the signal.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import poses as poses_module
from radartwin.simulation import pruning, variant
from radartwin.simulation.backends.mitsuba import MitsubaBackend, StaticScene, Surroundings, target
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.tube_paths import PRUNE
from radartwin.simulation.paths import Paths

SPACING_M = 0.04  # between places along a track
OVER_ROOM = 0.25  # tubes a square wavelength on a thing's ways over the room, carried: 0.03 of all it returns; half as many, 0.06
CLUTTER_OVER_ROOM = 0.125  # on clutter's; against one: 0.03 of a metal umbrella stand's, 0.10 of a litter bin's
PAIRS = 0.1  # ten times what a radar at rest leaves out of clutter's ways over the room
BEYOND_M = 0.04  # both ends of the nominal drive: the actual one starts early or rolls on
CLUTTER_PRUNE = 1e-2  # of the strongest path by way of a piece of clutter: 0.003 of its signal straight back, 0.01 of it over the room
THING_PRUNE = 3e-3  # of the strongest path by way of a thing; against a third of it 0.006 of its signal
SCOUT_SHARE = 0.3  # of the last prune: what is a little less at one place may be more at the next
TOGETHER = 8  # places traced in one go, which bounds memory
TURNED_RAD = np.deg2rad(3.0)  # that a shared drive may swerve: what is carried was judged by the element pattern at the start's heading
ASIDE_M = 0.015  # by which hands put things beside their marks: three standard deviations
BALL_M, BALL_STEP = 0.1, 1.5  # balls that legs are found for: so large, and so much larger from one size to the next


@dataclass(frozen=True, eq=False)
class Track:
    """Paths at places (P, 4, 4) of the sensor, evenly along a line."""

    places: np.ndarray
    parts: Sequence[Paths]

    def seen(self, poses: np.ndarray, frame_rate_hz: float) -> list[Paths]:
        """Parts of F poses, from a sensor that drives through `poses` (F, 4, 4)."""
        velocity = np.einsum("fji,fj->fi", poses[:, :3, :3], poses_module.relative(poses, None, frame_rate_hz)[1])
        along = self.places[-1, :3, 3] - self.places[0, :3, 3]
        where = (poses[:, :3, 3] - self.places[0, :3, 3]) @ along / (along @ along) * (len(self.places) - 1)
        place = np.clip(np.round(where), 0, len(self.places) - 1).astype(int)
        frame, there = poses[:, :3, :3], self.places[place, :3, :3]
        shift = np.einsum("fji,fj->fi", there, poses[:, :3, 3] - self.places[place, :3, 3])
        return [self._carried(part, place, shift, np.swapaxes(frame, 1, 2) @ there, velocity) for part in self.parts]

    def _carried(self, part: Paths, place: np.ndarray, shift: np.ndarray, turn: np.ndarray, velocity: np.ndarray) -> Paths:
        """Paths at the place (F,) nearest to every pose, moved to it.

        Args:
            shift: (F, 3) of the sensor, in its frame at the place. turn: (F, 3, 3) from there to its frame at the pose.
            velocity: (F, 3) in the latter.
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
        shared_out(_carry, len(place), start, first[place], shift, turn, velocity, *read, amplitude, bounces, length, way, rate)
        pose = np.repeat(np.arange(len(place)), count)
        return Paths(len(place), pose, bounces, amplitude, part.frequencies_hz, length[0], length[1], way[0], way[1], rate)


@compiled
def _carry(
    low, high, start, first, shift, turn, velocity, amplitude, bounces, length_in, length_out, departure, arrival,
    amplitude_to, bounces_to, length_to, way_to, rate_to,
):  # fmt: skip
    """Paths of poses low..high from the places next to them."""
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
                    turned = (turn[f, i, 0] * moved[0] + turn[f, i, 1] * moved[1] + turn[f, i, 2] * moved[2]) / size
                    way_to[end, row, i] = turned
                    total -= turned * velocity[f, i]
            rate_to[row] = total


def straight(poses: np.ndarray) -> bool:
    """Whether a drive (F, 4, 4) is one that can be shared: along one line, one way, facing as at its start."""
    at, way = poses[:, :3, 3] - poses[0, :3, 3], poses[-1, :3, 3] - poses[0, :3, 3]
    length = float(np.linalg.norm(way))
    along = at @ (way / length) if length > 0 else np.zeros(len(at))
    aside = np.linalg.norm(at - along[:, None] * (way / length if length > 0 else way), axis=1)
    turned = np.arccos(np.clip((np.einsum("fij,ij->f", poses[:, :3, :3], poses[0, :3, :3]) - 1) / 2, -1, 1))
    back = float(np.diff(along).min(initial=0.0))
    return bool(aside.max() <= 0.5 * SPACING_M and turned.max() <= TURNED_RAD and back >= -0.5 * SPACING_M)


def places_along(poses: np.ndarray, spacing_m: float, offset: float = 0.0) -> np.ndarray:
    """(P, 4, 4) places along a straight nominal drive (F, 4, 4), from before its start to behind its end, facing as it starts; further on
    by `offset` of a spacing."""
    start, way = poses[0, :3, 3], poses[-1, :3, 3] - poses[0, :3, 3]
    length = float(np.linalg.norm(way))
    beyond = int(np.ceil(BEYOND_M / spacing_m))
    steps = (np.arange(-beyond, int(np.ceil(length / spacing_m)) + beyond + 1) + offset) * spacing_m
    out = np.repeat(poses[:1], len(steps), axis=0)
    out[:, :3, 3] = start + steps[:, None] * (way / length if length > 0 else np.eye(3)[0])
    return out


def _in_turn(parts: Sequence[Paths | None], poses: int) -> Paths:
    """Parts of TOGETHER poses each, one after the other, as one of all poses."""
    shifted = [replace(part, poses=poses, pose=part.pose + k * TOGETHER) for k, part in enumerate(parts) if part is not None]
    return Paths.concatenate(shifted)


class Drives:
    """Drives along one track through one room.

    Args:
        surfaces: the room, at rest; none for free space.
        radar: waveform, frame rate and element pattern.
        nominal: (F, 4, 4) the drive of the log, straight.
        settings: of the tracer; `rays` and room="tubes" are not for this.
        offset: of a spacing, by which the places are set off, so that two courses of one track do not share what carrying gets wrong.
    """

    def __init__(self, surfaces: Sequence[Surface], radar: Radar, nominal: np.ndarray, settings: TraceSettings, offset: float = 0.0):
        variant.activate(settings.variant)
        self._backend, self._radar = MitsubaBackend(settings), radar
        self._places = places_along(nominal, SPACING_M, offset)
        self._things, self._small = (
            MitsubaBackend(replace(settings, coupled_rays_per_wavelength2=tubes)) for tubes in (OVER_ROOM, CLUTTER_OVER_ROOM)
        )
        self._still = StaticScene.build(list(surfaces), radar) if len(surfaces) else None

    def room(self, poses: np.ndarray) -> list[Paths]:
        """What the room alone returns to a drive through `poses` (F, 4, 4)."""
        if self._still is None:
            return []
        if (poses == poses[0]).all():
            return self._backend.cached_static_paths(self._still, self._radar, poses[:1])
        rate = self._radar.frame_rate_hz
        velocity = poses_module.relative(poses, None, rate)[1]
        bounces = self._backend.settings.max_bounces
        images = self._still.room.paths(poses, velocity, self._radar, bounces, PRUNE, self._scouted)
        return [images, *self._clutter.seen(poses, rate), *self._backend.diffuse_paths(self._still, self._radar, poses)]

    @cached_property
    def _scouted(self):
        assert self._still is not None
        return self._still.room.scouted(self._places, self._radar, self._backend.settings.max_bounces, SCOUT_SHARE * PRUNE)

    @cached_property
    def _clutter(self) -> Track:
        still = self._still
        assert still is not None
        places = self._places
        singles = still.room.paths(places, np.zeros((len(places), 3)), self._radar, 1, PRUNE)
        loudest = float(pruning.level(singles, self._radar).max(initial=0.0))

        def traced(some: np.ndarray) -> list[Paths]:
            parts = self._small.object_paths(still, self._radar, some, PAIRS * loudest)
            return [pruning.pruned(part, self._radar, CLUTTER_PRUNE) for part in parts]

        return self._track(traced)

    @cached_property
    def _beside(self):
        return None if self._still is None else self._still.room.beside()

    def over_room(self, surfaces: Sequence[Surface], aside: np.ndarray | None = None) -> Track:
        """Paths by way of both something compact at rest in the world and the room, along the track; `aside` as in `moving`."""
        at_rest = np.eye(4)[None]
        return self._track(lambda places: self._moving(self._things, surfaces, places, at_rest, True, aside)[1:])  # without the echo itself

    def _track(self, traced: Callable[[np.ndarray], list[Paths]]) -> Track:
        """What is `traced` at places along the track, a few at once."""
        places = self._places
        some = [traced(places[low : low + TOGETHER]) for low in range(0, len(places), TOGETHER)]
        longest = max(len(parts) for parts in some)
        return Track(places, [_in_turn([parts[k] if k < len(parts) else None for parts in some], len(places)) for k in range(longest)])

    def moving(
        self, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray, coupled: bool = True, aside: np.ndarray | None = None
    ) -> list[Paths]:
        """Paths by way of something compact, in its own frame, at `poses` (F, 4, 4), seen from `sensor` (F, 4, 4); either may be one.

        Args:
            aside: (3,) metres from where the log has it to where it stands. Ways over the room are found for a ball about where the log
                has it, so that all that is put there shares them.
        """
        return self._moving(self._backend, surfaces, sensor, poses, coupled, aside)

    def _moving(
        self, backend: MitsubaBackend, surfaces: Sequence[Surface], sensor: np.ndarray, poses: np.ndarray, coupled: bool,
        aside: np.ndarray | None,
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
        room = self._beside if coupled else None
        return backend.group_paths(
            group, Surroundings(room, occluder), self._radar, sensor, poses, ball=None if wanders else ball, prune=THING_PRUNE
        )
