"""Paths of an object, direct and over the flat faces of a room, and its shadow on the paths of the room.

A leg connects sensor and object, directly or by reflections at a sequence of faces. A path consists of a leg to the object and a leg back.
Four steps find the paths. Ray tubes or polygons give the direct paths without the room, and with them the level of the object's echo. The
pairs of legs are chosen whose fields are strong enough at this level. For each pair, the tracer sends ray tubes from the sensor's mirror
image of the first leg to the object and computes the echo at the sensor's mirror image of the second leg. A pair of two different legs is
traced in one direction, because the other direction has the same paths reversed. Last, each hit is weighted by the field of its two legs,
which includes reflections, the edges of the faces and shadows. Every choice is made for each pose on its own. Paths object - face - object
are not modelled, and neither are paths over a face of an object that is too close to the sensor for a planar grid of tubes.
"""

import atexit
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from radartwin.compiled import compiled, fixed, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation import poses as poses_module
from radartwin.simulation import pruning, visibility
from radartwin.simulation.backends import tube_paths
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.tube_paths import Target
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.flat import legs as legs_module
from radartwin.simulation.flat import polygons, shadows, silhouette
from radartwin.simulation.flat.legs import DIRECT, Legs
from radartwin.simulation.flat.polygons import Polyhedron
from radartwin.simulation.flat.room import FlatRoom
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import EARLY, LEGS, PRUNE, SHADED, TRACED, both_gains, largest
from radartwin.simulation.reflection_table import lagrange_basis

AT_ONCE = 500_000  # about as many hits are traced at once before the weak ones among them are dropped; limits memory
STRONGEST = 0.5  # if direct paths are only estimated, paths below this share of the strongest one are dropped
GRAIN = 20_000  # smallest number of hits for which one thread runs `_place`
# Tubes per square wavelength for weak paths between object and room. Error: 0.03 of the signal of a metal umbrella stand, 0.10 of the
# signal of a litter bin.
SPARSE = 0.125
# At a pose with more than MANY hits, pairs of legs are weak whose echo is at most WEAK times the smallest one that matters. Effect on
# the signal of the scanned laboratory with a bookcase of 371 faces: 0.06 (half as many tubes for all pairs: 0.04). The bookcase has 8
# million hits of 16 nodes there, 20 GB with their copies, and 2.2 million with fewer tubes for the weak pairs. A body of 1.7 m that walks
# through the furnished laboratory takes 4.5 s a frame instead of 13.3 s; the error of its signal against four times as many tubes rises
# from 0.026 to 0.040.
MANY, WEAK = 2_000_000, 10.0
BISTATIC = 4.0  # assumed largest ratio of an object's bistatic to its monostatic echo


def group_paths(
    settings: TraceSettings, group: Target, room: FlatRoom | None, radar: Radar, sensor_poses: np.ndarray, object_poses: np.ndarray, *,
    least: np.ndarray | None = None, ball: tuple[np.ndarray, float] | None = None, prune: float = PRUNE, direct: bool = True,
) -> list[Paths]:  # fmt: skip
    """Return the direct paths of an object, and its paths with the room.

    Args:
        group: triangles of the object in its own frame, and their reflection table.
        room: faces that reflect, and surfaces that hide the object. None: free space.
        sensor_poses, object_poses: (F, 4, 4) to the world.
        least: (F,) amplitude at each pose below which pairs of legs are dropped; None: only those below the share `pruning.LEGS` of the
            direct field are dropped.
        ball: centre (3,) and radius in metres of a ball that contains the object in every frame. Legs are searched for the ball and cached.
        prune: paths whose amplitude is below this times the strongest path of their pose are dropped.
        direct: whether to return the direct paths. If False, they only give the level relative to which the other paths are pruned.
    """
    alone, over = _found(settings, group, room, radar, sensor_poses, object_poses, least, ball, prune, direct)
    return [Paths.concatenate(alone), Paths.concatenate(over or [alone[0].where(slice(0))])]


def _found(
    settings: TraceSettings, group: Target, room: FlatRoom | None, radar: Radar, sensor_poses: np.ndarray, object_poses: np.ndarray,
    least: np.ndarray | None, ball: tuple[np.ndarray, float] | None, prune: float, direct: bool, sharp_only: bool = False,
    known: tuple[Legs, np.ndarray] | None = None,
) -> tuple[list[Paths], list[Paths]]:  # fmt: skip
    """Return the parts of the direct paths and of those with the room; arguments as in `group_paths`. `sharp_only` traces only the pairs
    with a sharp leg, by ray tubes also if all faces of the object are flat. `known` is the result of `_legs`, if the caller has it.
    """
    body, frames, density = None if sharp_only else polygons.of(*group), len(sensor_poses), settings.coupled_rays_per_wavelength2
    group = group if body is None else Target(group.geometry, polygons.with_nodes(group.table, radar))
    source = (poses_module.inverse(object_poses[:1]) @ sensor_poses[:1])[:, :3, 3]
    cell_m = tube_paths.cell_m(group.geometry, settings, source, radar, room is None)
    coupled_cell_m = cell_m if density is None else radar.wavelength_m / float(np.sqrt(density))
    direct_cell_m = cell_m if direct else coupled_cell_m

    # 1. Level: the direct paths without the room, in which the object may be hidden from the sensor but not from an image of it.
    free = Legs.of_free_space(1, group.table.frequencies_hz)
    alone = _Pairs.of(free, np.arange(frames), np.zeros((3, frames), int), sensor_poses, object_poses, radar)
    estimated = not direct and least is None
    close = np.zeros(frames, bool) if body is not None else alone.near(group)
    seen = np.flatnonzero(~close | direct)  # a pose that is too close for paths over the room needs no level
    hits = _traced(
        group, body, alone.where(seen), direct_cell_m, settings.max_bounces, None, STRONGEST if estimated else max(TRACED, EARLY * prune)
    )
    hits = replace(hits, pose=seen[hits.pose])
    share = np.full(frames, LEGS)
    if least is not None and room is not None:
        echo = BISTATIC * _loudest(alone.weighed(hits, group.table.frequencies_hz, object_poses), radar)
        share = np.maximum(LEGS, np.divide(least, echo, out=np.full(frames, np.inf), where=echo > 0))

    # 2. Choice: the legs, and the pairs of legs whose field exceeds the share.
    coupled = room is not None and settings.coupling and bool(room.usable.any()) and bool((share < 1).any())
    longest = settings.max_bounces - 1 if coupled else 0
    legs, place = known or _legs(room, group, sensor_poses, object_poses, ball, longest, float(share.min()))
    pairs = _Pairs.of(legs, *_strong_pairs(legs, place, settings.max_bounces, share), sensor_poses, object_poses, radar)
    sharp: list[Paths] = []
    if body is None:
        pairs = pairs.where(~(close[pairs.frame] | pairs.near(group)) & (pairs.sharp | (not sharp_only)))
    elif pairs.sharp.any():  # the integrals along the sides of a polygon assume that the field is smooth over it
        pairs = pairs.where(~pairs.sharp | alone.near(group)[pairs.frame] | pairs.near(group))
        same = (legs, place) if least is None else None  # the tubes' level gives another share
        sharp = _found(settings, group, room, radar, sensor_poses, object_poses, least, ball, prune, False, True, same)[1]

    # 3. Trace: a path counts if its field is not too weak beside the strongest one of its pose.
    straight = replace(alone, legs=legs, place=place)
    level = largest(hits.amplitude) * straight.strength[hits.pose]
    # The amplitude of a tube grows with its cross-section.
    most = np.zeros(frames)
    np.maximum.at(most, hits.pose, level if body is not None else level * (cell_m / direct_cell_m) ** 2)
    # A pair has about as many hits as the pose with most direct hits. Pruned at STRONGEST, there are about 20 times fewer.
    per_pair = np.bincount(hits.pose, minlength=1).max() * (20 if estimated else 1)
    loudest, kept = np.zeros(frames), []

    def keep(block: _Pairs, hits: Hits, level: np.ndarray) -> None:
        # 4. Weight: the field of the two legs at each hit. Millions of hits take gigabytes, so that weak paths are dropped at once.
        near = np.flatnonzero((level > 0) & (level >= EARLY * (prune * most[block.frame[hits.pose]])))
        hits, level = hits.where(near), level[near]
        part = block.weighed(hits, group.table.frequencies_hz, object_poses)
        loud = pruning.level(part, radar)
        np.maximum.at(loudest, part.pose, loud)
        strong = np.flatnonzero((loud > 0) & (loud >= prune * loudest[part.pose]))
        cross = (block.out_leg != block.back_leg)[hits.pose]
        kept.append((part.where(strong), level[strong], loud[strong], hits.first_m[strong], cross[strong]))

    keep(straight, *((hits, level) if direct else (Hits.none(len(group.table.frequencies_hz)), level[:0])))
    del hits
    floor = prune * most
    many = np.bincount(pairs.frame, minlength=frames) * per_pair * (direct_cell_m / coupled_cell_m) ** 2 > MANY
    weak = many[pairs.frame] & (pairs.strength < WEAK * share[pairs.frame])
    wide_m = max(coupled_cell_m, radar.wavelength_m / float(np.sqrt(SPARSE)))
    for subset, width_m in ((pairs.where(~weak), coupled_cell_m), (pairs.where(weak), wide_m)):
        for block in subset.blocks(per_pair if body is not None else per_pair * (direct_cell_m / width_m) ** 2):
            weakest = floor[block.frame] / np.maximum(block.strength, 1e-30)  # the ray tracer multiplies this by EARLY
            hits = _traced(group, body, block, width_m, settings.max_bounces, weakest, max(TRACED, EARLY * prune))
            within = hits.bounce + block.reflections[hits.pose] <= settings.max_bounces
            level = largest(hits.amplitude) * block.strength[hits.pose] * within
            np.maximum.at(most, block.frame[hits.pose], level)
            keep(block, hits, level)
            del hits
    both: list[list[Paths]] = []
    while kept:
        part, level, loud, first, cross = kept.pop(0)
        strong = np.flatnonzero((level >= EARLY * (prune * most[part.pose])) & (loud >= prune * loudest[part.pose]))
        both.append(_both_ways(part.where(strong), first[strong], cross[strong]))
    return both[0], [*sharp, *(part for ways in both[1:] for part in ways)]


def shadows_of_movers(
    parts: Sequence[Paths], levels: Sequence[np.ndarray], most: np.ndarray, bodies: Sequence[tuple[Geometry, np.ndarray]],
    sensor_poses: np.ndarray, wavenumber: float,
) -> list[Paths]:  # fmt: skip
    """Return paths that add the shadows of moving bodies to static paths: copies of the shaded paths, whose amplitude is the change by the
    product of the shadows.

    A change below the share `pruning.SHADED` of the strongest path of its frame is left out.

    Args:
        parts: static paths with their points, at F sensor poses or at one pose that is valid for all F poses.
        levels: for each part, the largest amplitude (N,) of each of its N paths over the antenna elements (`pruning.level`).
        most: (F,) or (1,) level of the strongest static path of each pose.
        bodies: for each body, its triangles in its own frame, all of which block, also those of a material that transmits, and its poses
            (F, 4, 4) to the world, or one pose for all frames.
        sensor_poses: (F, 4, 4) of the sensor to the world. wavenumber: rad/m.
    """
    frames = max(len(poses) for _, poses in bodies)
    sensor_poses = np.broadcast_to(sensor_poses[:frames], (frames, 4, 4))
    seen = []  # for each body, its outline's triangles, the poses from the world to the body, and the sensor in the body's frame
    for geometry, poses in bodies:
        inverse = np.broadcast_to(poses_module.inverse(poses), (frames, 4, 4))
        seen.append((_skin(geometry), inverse, np.einsum("fij,fj->fi", inverse[:, :3, :3], sensor_poses[:, :3, 3]) + inverse[:, :3, 3]))
    most, out = np.broadcast_to(most, (frames,)), []
    for part, loudness in zip(parts, levels, strict=True):
        assert part.points is not None
        kept = [(np.zeros(0, int), np.zeros(0, int), np.zeros(0, complex))]
        for frame, row in visibility.pairs(part, frames):
            factor, weakest = np.ones(len(row), complex), SHADED * most[frame] / np.maximum(loudness[row], 1e-300)
            for body, inverse, sensor in seen:
                points = np.einsum("nij,nvj->nvi", inverse[frame, :3, :3], part.points[row]) + inverse[frame, None, :3, 3]
                factor *= shadows.factors(body, sensor[frame], points, part.mirror is not None, wavenumber, least=weakest)
            change = factor - 1
            shaded = np.abs(change) * loudness[row] > SHADED * most[frame]
            kept.append((frame[shaded], row[shaded], change[shaded]))
        frame, row, change = (np.concatenate(column) for column in zip(*kept, strict=True))
        copies = part.where(row)
        out.append(replace(copies, poses=frames, pose=frame, amplitude=copies.amplitude * change[:, None], points=None))
    return out


@lru_cache(maxsize=4)
def _skin(geometry: Geometry) -> silhouette.Skin:
    return silhouette.skin(geometry)


atexit.register(_skin.cache_clear)  # Mitsuba scenes of cached geometries must be freed before Mitsuba is unloaded


def _legs(
    room: FlatRoom | None, group: Target, sensor_poses: np.ndarray, object_poses: np.ndarray, ball: tuple[np.ndarray, float] | None,
    longest: int, share: float,
) -> tuple[Legs, np.ndarray]:  # fmt: skip
    """Return the legs between sensor and object, and the index (F,) of the place (a pair of a sensor and an object position) of each pose.

    Nearby positions of the object share a place. The arguments are those of `group_paths` and of `legs.find`.
    """
    built, frames, nodes = group.geometry, len(sensor_poses), group.table.frequencies_hz
    if room is None:
        return Legs.of_free_space(1, nodes), np.zeros(frames, int)
    if ball is not None:
        centre, radius = np.repeat(ball[0][None], frames, axis=0), ball[1]
    else:
        extent, step = built.radius_m, built.radius_m / 2
        centre = object_poses[:, :3, :3] @ built.centre + object_poses[:, :3, 3]
        centre, radius = np.round(centre / max(step, 1e-9)) * step, extent + np.sqrt(3) / 2 * step
    seen = np.concatenate([sensor_poses[:, :3, 3], centre, sensor_poses[:, :3, 2]], axis=1)
    places, place = np.unique(np.round(seen, 9), axis=0, return_inverse=True)
    find = legs_module.found_once if ball is not None or len(places) == 1 else legs_module.find
    return find(room, places[:, :6], places[:, 6:], radius, nodes, longest, share), place.ravel()


def _strong_pairs(legs: Legs, place: np.ndarray, max_bounces: int, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose (N,) and the place, leg to the object and leg back (3, N) of each pair of legs over the room.

    A pair's field is at least `share` (F,) times that of two undisturbed direct legs. Only one of each pair and its reverse is returned.
    """
    kinds, kind = np.unique(np.column_stack([place, share]), axis=0, return_inverse=True)
    pairs = []
    for u, least in kinds:
        strength = legs.share[int(u)]
        worth = np.flatnonzero(strength * strength.max() >= least)
        product = strength[worth][:, None] * strength[worth]
        strong = np.triu(product >= least) & (legs.order[worth][:, None] + legs.order[worth] < max_bounces)
        i, j = np.nonzero(strong & (worth != DIRECT))  # the second leg is the direct one only if both are
        pairs.append(np.stack([np.full(len(i), int(u)), worth[i], worth[j]]))
    frame = np.repeat(np.arange(len(place)), [pairs[k].shape[1] for k in kind.ravel()])
    return frame, np.concatenate([np.zeros((3, 0), int), *(pairs[k] for k in kind.ravel())], axis=1)


def _both_ways(part: Paths, first_m: np.ndarray, cross: np.ndarray) -> list[Paths]:
    """Return the given paths and, for each path with two different legs (connections of sensor and object), also the reversed path."""
    if not cross.any():
        return [part]
    there, first = part.where(cross), first_m[cross]
    return [part, replace(there, length_in_m=first, length_out_m=there.length_m - first).reversed()]


def _traced(
    group: Target, body: Polyhedron | None, pairs: "_Pairs", cell_m: float, max_bounces: int, least: np.ndarray | None, prune: float
) -> Hits:
    """Trace the object for N pairs of legs; the field `pose` of the hits is the index of the pair. An object of flat faces is traced by its
    polygons, any other object by ray tubes of the width `cell_m`.

    Hits below the amplitude `least` (N,), and hits below `prune` times the strongest hit of their pair, may be missing. A hit of a polygon
    may have more reflections than are left for its pair.
    """
    (geometry, table), out, back, left = group, pairs.out, pairs.back, max_bounces - pairs.reflections
    if body is not None:
        return polygons.paths(body, table, out.place, back.place, out.axis, back.axis, int(left.max(initial=0)))
    parts = [Hits.none(len(table.frequencies_hz))]
    for rows, grid in tube_paths.grids(geometry, out.place, np.swapaxes(out.rotation, 1, 2), cell_m):
        transmit, receive = (Antennas(end.place[rows], end.axis[rows]) for end in (out, back))
        weakest = None if least is None else least[rows]
        options = TraceOptions(int(left[rows].max()), prune=prune, bounces=left[rows], least=weakest)
        hits = tubes.trace(geometry, table, grid, transmit, receive, options)
        parts.append(replace(hits, pose=rows[hits.pose]))
    return Hits.concatenate(parts[1:] or parts)


@dataclass(frozen=True)
class _Pairs:
    """Hold N pairs of legs, one for each pose at which the pair is traced.

    Attributes:
        frame, place: (N,) pose, and place of the legs. out_leg, back_leg: (N,) leg to the object and leg back.
        out, back: the sensor's mirror images of these legs, in the object's frame.
    """

    legs: Legs
    frame: np.ndarray
    place: np.ndarray
    out_leg: np.ndarray
    back_leg: np.ndarray
    out: "_End"
    back: "_End"

    @staticmethod
    def of(legs: Legs, frame: np.ndarray, place_and_legs: np.ndarray, sensor: np.ndarray, objects: np.ndarray, radar: Radar) -> "_Pairs":
        ends = [_End.of(legs, leg, frame, sensor, objects, radar) for leg in place_and_legs[1:]]
        return _Pairs(legs, frame, *place_and_legs, *ends)

    @cached_property
    def reflections(self) -> np.ndarray:
        return self.legs.order[self.out_leg] + self.legs.order[self.back_leg]

    @cached_property
    def strength(self) -> np.ndarray:
        """Return the largest ratio (N,) of the pair's field to that of two undisturbed direct legs."""
        return self.legs.share[self.place, self.out_leg] * self.legs.share[self.place, self.back_leg]

    @cached_property
    def sharp(self) -> np.ndarray:
        """Return a mask (N,) of the pairs with a leg over faces whose field is sharp."""
        ends = [(self.legs.sharp[self.place, leg] > 0) & (leg != DIRECT) for leg in (self.out_leg, self.back_leg)]
        return ends[0] | ends[1]

    def near(self, group: Target) -> np.ndarray:
        """Return a mask (N,) of the pairs whose first mirror image is too close to the object for a planar grid of tubes."""
        return tube_grid.near(group.geometry.hull_points(), self.out.place, group.geometry.centre)

    def where(self, keep: np.ndarray) -> "_Pairs":
        frame, place, out_leg, back_leg = (values[keep] for values in (self.frame, self.place, self.out_leg, self.back_leg))
        return _Pairs(self.legs, frame, place, out_leg, back_leg, self.out.where(keep), self.back.where(keep))

    def blocks(self, per_pair: float) -> Iterator["_Pairs"]:
        """Divide the pairs into blocks of about AT_ONCE hits, if a pair has `per_pair` hits."""
        rows = max(1, int(AT_ONCE / max(per_pair, 1)))
        for first in range(0, len(self.frame), rows):
            yield self.where(np.arange(first, min(first + rows, len(self.frame))))

    def weighed(self, hits: Hits, nodes: np.ndarray, objects: np.ndarray) -> Paths:
        """Return the paths of hits at the frequencies `nodes` (Q,), with the field of their two legs, for object poses (F, 4, 4).

        The field may be written to the amplitudes of the hits.
        """
        row, legs, rate = hits.pose, self.legs, np.zeros(len(hits.pose))
        sides = (self.out, hits.departure, hits.first_m), (self.back, hits.arrival, hits.length_out_m)
        (departure, first), (arrival, last) = (end.placed(row, self.frame[row], objects, way, length, rate) for end, way, length in sides)
        amplitude = hits.amplitude
        if legs.disturbed or self.reflections.any():
            if not np.array_equal(nodes, legs.frequencies_hz):
                amplitude = amplitude @ lagrange_basis(nodes, legs.frequencies_hz)
            nodes = legs.frequencies_hz
            for leg, point in ((self.out_leg, first), (self.back_leg, last)):
                legs.weigh(amplitude, self.place[row], leg[row], point)
        return Paths(
            len(objects), self.frame[row], hits.bounce + self.reflections[row], amplitude, nodes, hits.length_in_m, hits.length_out_m,
            departure, arrival, rate,
        )  # fmt: skip


@dataclass(frozen=True)
class _End:
    """Hold the sensor's mirror images of N legs (connections of sensor and object by reflections at faces), in the object's frame.

    Attributes:
        place, velocity: (N, 3) position and velocity (m/s) of the image. axis: (N, 3) axis of its antenna.
        rotation: (N, 3, 3) of directions at the image to the sensor's frame.
    """

    place: np.ndarray
    velocity: np.ndarray
    axis: np.ndarray
    rotation: np.ndarray

    @staticmethod
    def of(legs: Legs, leg: np.ndarray, pose: np.ndarray, sensor: np.ndarray, objects: np.ndarray, radar: Radar) -> "_End":
        """Return the sensor's mirror images of N legs (connections of sensor and object), given by index (N,), at the frames `pose` (N,),
        for sensor poses (F, 4, 4).
        """
        mirror, shift = legs.mirror[leg], legs.shift[leg]
        at = []
        for sensor_then, objects_then in poses_module.moments(sensor, objects):
            image = np.einsum("nij,nj->ni", mirror, sensor_then[pose, :3, 3]) + shift
            at.append(np.einsum("nji,nj->ni", objects_then[pose, :3, :3], image - objects_then[pose, :3, 3]))
        velocity = (at[1] - at[0]) / poses_module.MOMENT * radar.frame_rate_hz
        to_object = np.swapaxes(objects[pose, :3, :3], 1, 2) @ mirror  # world to object; orthogonal, so the inverse is the transpose
        axis = np.einsum("nij,nj->ni", to_object, sensor[pose, :3, 2])
        return _End(at[0], velocity, axis, np.swapaxes(to_object @ sensor[pose, :3, :3], 1, 2))

    def where(self, keep: np.ndarray) -> "_End":
        return _End(*(values[keep] for values in (self.place, self.velocity, self.axis, self.rotation)))

    def placed(
        self, row: np.ndarray, frame: np.ndarray, objects: np.ndarray, direction: np.ndarray, length: np.ndarray, rate: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return, for H hits, the direction (H, 3) at the sensor and the point (H, 3) in the world where the hit's line meets the object.

        Args:
            row, frame: (H,) leg and frame of each hit. objects: (F, 4, 4) poses of the object.
            direction, length: (H, 3) direction of the line from the mirror image in the object's frame, and (H,) its length in metres.
            rate: (H,) rate of change of the path's length in m/s; the function subtracts the part of this end.
        """
        turned, point = np.empty_like(direction), np.empty_like(direction)
        arrays = (row, frame, objects, self.place, self.velocity, self.rotation, direction, length)
        shared_out(_place, len(row), *map(fixed, arrays), turned, point, rate, grain=GRAIN)
        return turned, point


@compiled
def _place(first, last, row, frame, objects, place, velocity, rotation, direction, length, turned, point, rate) -> None:
    """Compute `_End.placed` for the hits `first` to `last` - 1."""
    at = np.empty(3)
    for n in range(first, last):
        r, f = row[n], frame[n]
        for i in range(3):
            at[i] = place[r, i] + direction[n, i] * length[n]
            rate[n] -= direction[n, i] * velocity[r, i]
        for i in range(3):
            turned[n, i] = rotation[r, i, 0] * direction[n, 0] + rotation[r, i, 1] * direction[n, 1] + rotation[r, i, 2] * direction[n, 2]
            point[n, i] = objects[f, i, 0] * at[0] + objects[f, i, 1] * at[1] + objects[f, i, 2] * at[2] + objects[f, i, 3]


def _loudest(paths: Paths, radar: Radar) -> np.ndarray:
    """Return the largest magnitude (F,) of the coherent sum of each pose's paths, with the element gain, over all frequency nodes."""
    turned = paths.amplitude * np.exp(2j * np.pi / SPEED_OF_LIGHT * paths.length_m[:, None] * paths.frequencies_hz)
    turned *= both_gains(radar, paths.departure, paths.arrival)[:, None]
    total = np.zeros((paths.poses, turned.shape[1]), complex)
    np.add.at(total, paths.pose, turned)
    return np.abs(total).max(axis=1)
