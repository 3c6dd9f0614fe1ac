"""Move paths that were traced at some sensor poses (places) to nearby sensor poses.

Over centimetres, the amplitudes of the paths between an object and a room change slowly, but their phases turn by radians. Such paths are
numerous, so a moving radar traces them only at places, and moves the paths of a place to the poses around it. The move keeps the
amplitudes. The new lengths, directions and rates of change are exact for the first and last points of the path. If the radar cannot resolve
several moved paths, they become one path (`merging`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from radartwin.compiled import compiled, shared_out
from radartwin.radar.chirp import Radar
from radartwin.simulation import poses as poses_module
from radartwin.simulation import pruning
from radartwin.simulation.merging import merged
from radartwin.simulation.paths import Paths
from radartwin.store.digest import array_digest
from radartwin.store.recent import Recent

SPACING_M = 0.04  # distance between places on a line of dense poses; paths are moved by half of it at most
# Tubes per square wavelength for paths between object and room; in one call, relative to the density of the direct echo. Error: 0.03 of
# their signal; with half as many tubes: 0.06.
OVER_ROOM = 0.25
MOVED = 16_000_000  # number of amplitudes that are moved at once (256 MB)
TURNED_RAD = np.deg2rad(3.0)  # largest turn of a pose against its place, whose antenna gives polarisation and pruning of the paths


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
        turn = np.swapaxes(frame, 1, 2) @ there
        out = []
        for part, gain in zip(self.parts, self._gains, strict=True):
            amplitudes = np.cumsum(np.bincount(part.pose, minlength=len(self.places))[place]) * part.amplitude.shape[1]
            blocks = np.split(np.arange(len(poses)), np.flatnonzero(np.diff(amplitudes // MOVED)) + 1)
            moved = [self._carried(part, gain, place[some], shift[some], turn[some], velocity[some]) for some in blocks]
            out.append(Paths.concatenate([
                replace(one, poses=len(poses), pose=one.pose + some[0]) for one, some in zip(moved, blocks, strict=True)
            ]))  # fmt: skip
        return out

    def _carried(
        self, part: Paths, gain: np.ndarray, place: np.ndarray, shift: np.ndarray, turn: np.ndarray, velocity: np.ndarray
    ) -> Paths:
        """Move the paths of the nearest traced sensor position (index (F,)) to each of F sensor poses, and merge them.

        Args:
            gain: (N,) antenna gain of the paths of `part`.
            shift: (F, 3) from place to pose, in the sensor frame at the place.
            turn: (F, 3, 3) from this frame to the sensor frame at the pose.
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
        shared_out(_carry, len(place), start, first[place], shift, turn, velocity, *read, amplitude, bounces, length, way, rate)
        pose = np.repeat(np.arange(len(place)), count)
        moved = Paths(len(place), pose, bounces, amplitude, part.frequencies_hz, length[0], length[1], way[0], way[1], rate)
        return merged(moved, self.radar, gain[np.arange(total) + (first[place] - start[:-1])[pose]])


_covered: Recent[np.ndarray] = Recent(1)  # the places of the last track, which all blocks of a recording share


def covering(poses: np.ndarray, spacing_m: float) -> np.ndarray:
    """Return indices (P,) of poses (F, 4, 4), the places. Each pose is at most half of `spacing_m` from a place and turned by at most
    TURNED_RAD against it. A pose that is both moved and turned is closer to its place. Dense poses on a line have places that are about
    `spacing_m` apart. The last result is cached.
    """

    def find() -> np.ndarray:
        points, reach = _points(poses, spacing_m), 0.5 * spacing_m * (1 + 1e-9)
        chosen, left = [], np.arange(len(poses))
        while len(left):
            beyond = np.linalg.norm(points[left[0] :] - points[left[0]], axis=1) > reach
            chosen.append(left[0] + (int(beyond.argmax()) if beyond.any() else len(beyond)) - 1)
            left = left[np.linalg.norm(points[left] - points[chosen[-1]], axis=1) > reach]
        return np.array(chosen)

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
    low, high, start, first, shift, turn, velocity, amplitude, bounces, length_in, length_out, departure, arrival,
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
                    turned = (turn[f, i, 0] * moved[0] + turn[f, i, 1] * moved[1] + turn[f, i, 2] * moved[2]) / size
                    way_to[end, row, i] = turned
                    total -= turned * velocity[f, i]
            rate_to[row] = total
