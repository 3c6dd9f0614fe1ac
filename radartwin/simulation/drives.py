"""Many drives along one track: a sensor that moves through a room at rest, past a thing at rest.

Drives that follow one log differ by centimetres, their echoes by radians, so nothing traced for one serves another as it is. What can be
shared is: which panel sequences matter along the track, scouted once and evaluated exactly at every pose of every drive; and paths by way
of small and curved things, traced at places along the track and carried from the two next to it to wherever the sensor is (Paths.moved:
lengths exactly, amplitudes blended). Panel images are not carried: the waves from a panel's edges turn against its image within
millimetres, and blending over 2 cm left 0.23 of the signal, where it leaves 0.03 of what is only scattered.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import geometry, pruning, variant
from radartwin.simulation import poses as poses_module
from radartwin.simulation.mitsuba import PRUNE, MitsubaBackend, TraceSettings, reflection
from radartwin.simulation.paths import Paths

SPACING_M = 0.02  # between places along a track
CLUTTER_SPACING_M = 0.04
PAIRS = 0.1  # ten times what a radar at rest leaves out of clutter's ways over the room: 0.04 of the cluttered atrium's signal
BEYOND_M = 0.04  # both ends of the nominal drive: the actual one starts early or rolls on
THING_PRUNE = 3e-3  # of the strongest path by way of a thing; against a third of it 0.006 of its signal
SCOUT_SHARE = 0.3  # of the last prune: what is a little less at one place may be more at the next
TOGETHER = 8  # places traced in one go, which bounds memory
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
        before = np.clip(np.floor(where), 0, len(self.places) - 2).astype(int)
        share = np.clip(where - before, 0.0, 1.0)
        turn = np.swapaxes(poses[:, None, :3, :3], 2, 3) @ self.places[before[:, None] + [0, 1], :3, :3]
        weight = np.stack([1 - share, share], axis=1)
        return [self._carried(part, before, weight, poses, turn, velocity) for part in self.parts]

    def _carried(
        self, part: Paths, before: np.ndarray, weight: np.ndarray, poses: np.ndarray, turn: np.ndarray, velocity: np.ndarray
    ) -> Paths:
        """Paths at the two places next to every pose, `before` (F,) and the next, moved to it as Paths.moved does, and weighted (F, 2).

        Args:
            turn: (F, 2, 3, 3) from the frames at the places to the sensor's; velocity: (F, 3) in the sensor's.
        """
        assert part.mirror is None
        first = np.searchsorted(part.pose, np.arange(len(self.places) + 1))
        count = first[before + 2] - first[before]
        start = np.concatenate([[0], np.cumsum(count)])
        shift = np.einsum(
            "fkji,fkj->fki",
            self.places[before[:, None] + [0, 1], :3, :3],
            poses[:, None, :3, 3] - self.places[before[:, None] + [0, 1], :3, 3],
        )
        total = int(start[-1])
        amplitude, bounces = np.empty((total, part.amplitude.shape[1]), complex), np.empty(total, part.bounces.dtype)
        length, way = np.empty((2, total)), np.empty((2, total, 3))
        rate = np.empty(total)
        read = (part.amplitude, part.bounces, part.length_in_m, part.length_out_m, part.departure, part.arrival)
        shared_out(_carry, len(poses), start, first, before, weight, shift, turn, velocity, *read, amplitude, bounces, length, way, rate)
        return Paths(len(poses), np.repeat(np.arange(len(poses)), count), bounces, amplitude, part.frequencies_hz, *length, *way, rate)


@compiled
def _carry(
    low, high, start, first, before, weight, shift, turn, velocity, amplitude, bounces, length_in, length_out, departure, arrival,
    amplitude_to, bounces_to, length_to, way_to, rate_to,
):  # fmt: skip
    """Paths of poses low..high from the places before and behind them."""
    moved = np.empty(3)
    for f in range(low, high):
        row = start[f]
        for k in range(2):
            place = before[f] + k
            for n in range(first[place], first[place + 1]):
                for q in range(amplitude.shape[1]):
                    amplitude_to[row, q] = amplitude[n, q] * weight[f, k]
                bounces_to[row] = bounces[n]
                total = 0.0
                for end in range(2):
                    length = length_in[n] if end == 0 else length_out[n]
                    size = 0.0
                    for i in range(3):
                        moved[i] = length * (departure[n, i] if end == 0 else arrival[n, i]) - shift[f, k, i]
                        size += moved[i] ** 2
                    size = np.sqrt(size)
                    length_to[end, row] = size
                    for i in range(3):
                        turned = (turn[f, k, i, 0] * moved[0] + turn[f, k, i, 1] * moved[1] + turn[f, k, i, 2] * moved[2]) / size
                        way_to[end, row, i] = turned
                        total -= turned * velocity[f, i]
                rate_to[row] = total
                row += 1


def places_along(poses: np.ndarray, spacing_m: float) -> np.ndarray:
    """(P, 4, 4) places along a straight nominal drive (F, 4, 4), from before its start to behind its end, facing as it starts."""
    start, way = poses[0, :3, 3], poses[-1, :3, 3] - poses[0, :3, 3]
    length = float(np.linalg.norm(way))
    beyond = int(np.ceil(BEYOND_M / spacing_m))
    steps = np.arange(-beyond, int(np.ceil(length / spacing_m)) + beyond + 1) * spacing_m
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
    """

    def __init__(self, surfaces: Sequence[Surface], radar: Radar, nominal: np.ndarray, settings: TraceSettings):
        variant.activate(settings.variant)
        self._backend, self._radar, self._nominal = MitsubaBackend(settings), radar, nominal
        self._still = self._backend.still(list(surfaces), radar) if len(surfaces) else None

    def room(self, poses: np.ndarray) -> list[Paths]:
        """What the room alone returns to a drive through `poses` (F, 4, 4)."""
        if self._still is None:
            return []
        if (poses == poses[0]).all():
            return self._backend.static_paths_once(self._still, self._radar, poses[:1])
        rate = self._radar.frame_rate_hz
        velocity = poses_module.relative(poses, None, rate)[1]
        bounces = self._backend.settings.max_bounces
        images = self._still.room.paths(poses, velocity, self._radar, bounces, PRUNE, self._scouted)
        return [images, *self._clutter.seen(poses, rate), *self._backend.scattered(self._still, self._radar, poses)]

    @cached_property
    def _scouted(self):
        assert self._still is not None
        places = places_along(self._nominal, CLUTTER_SPACING_M)
        return self._still.room.scouted(places, self._radar, self._backend.settings.max_bounces, SCOUT_SHARE * PRUNE)

    @cached_property
    def _clutter(self) -> Track:
        assert self._still is not None
        places = places_along(self._nominal, CLUTTER_SPACING_M)
        still = np.zeros((len(places), 3))
        singles = self._still.room.paths(places, still, self._radar, 1, PRUNE)
        loudest = float(pruning.level(singles, self._radar).max(initial=0.0))
        return Track(places, self._backend.small_things(self._still, self._radar, places, PAIRS * loudest))

    @cached_property
    def _beside(self):
        return None if self._still is None else self._still.room.beside()

    def thing(self, surfaces: Sequence[Surface], coupled: bool = True, aside: np.ndarray | None = None) -> Track:
        """Paths by way of something compact at rest in the world along the track, and of it and the room where it is `coupled`."""
        places = places_along(self._nominal, SPACING_M)
        at_rest = np.eye(4)[None]
        some = [self.moving(surfaces, places[low : low + TOGETHER], at_rest, coupled, aside) for low in range(0, len(places), TOGETHER)]
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
        built, table = geometry.build([s.mesh for s in surfaces]), reflection(list(surfaces), self._radar)
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
        return self._backend.group_paths(
            built, table, room, occluder, self._radar, sensor, poses, ball=None if wanders else ball, prune=THING_PRUNE
        )
