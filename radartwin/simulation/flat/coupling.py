"""Paths between an object and a room of flat faces.

A leg connects sensor and object, directly or by reflections at a sequence of faces. A path consists of a leg to the object and a leg back.
For each pair of legs with a strong enough field, the tracer sends ray tubes from the sensor's mirror image of the first leg to the object
and computes the echo at the sensor's mirror image of the second leg. The ray tubes of all pairs and poses form one grid. A pair of two
different legs is traced in one direction, because the other direction has the same paths reversed. Each hit is then weighted by the field
of its two legs, which includes reflections, the edges of the faces and shadows. Paths object - face - object are not modelled.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from radartwin.compiled import compiled, fixed, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation import poses as poses_module
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.curved.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.flat import legs as legs_module
from radartwin.simulation.flat import polygons
from radartwin.simulation.flat.legs import DIRECT, Legs
from radartwin.simulation.flat.room import FlatRoom
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import EARLY, LEGS, TARGET_ERROR, TRACED, both_gains, largest, strong_masks
from radartwin.simulation.reflection_table import ReflectionTable, lagrange_basis

COUPLED = 3_000_000  # largest number of paths between a small static object and the room at all traced poses; limits memory
STRONGEST = 0.5  # if direct paths are only estimated, paths below this share of the strongest one are dropped
GRAIN = 20_000  # smallest number of hits for which one thread runs `_place`
BISTATIC = 4.0  # assumed largest ratio of an object's bistatic to its monostatic echo


class CoupledWarning(UserWarning):
    """Warn that paths between an object and the room are left out because there are too many."""


def group_paths(
    room: FlatRoom | None,
    built: Geometry,
    table: ReflectionTable,
    sensor_poses: np.ndarray,
    object_poses: np.ndarray,
    radar: Radar,
    *,
    max_bounces: int,
    cell_m: float,
    prune: float,
    coupled: bool = True,
    coupled_cell_m: float | None = None,
    least: float = 0.0,
    ball: tuple[np.ndarray, float] | None = None,
    direct: bool = True,
) -> list[Paths] | None:
    """Trace the direct paths of an object and its paths with the room; None if the object is too close for a planar grid of tubes.

    Args:
        room: faces that reflect, and surfaces that hide the object. None: free space. built, table: geometry and reflection of the object
            in its own frame.
        sensor_poses, object_poses: (F, 4, 4) to the world.
        cell_m: width of a tube on the object. coupled_cell_m: width for paths with the room's faces; None: cell_m.
        prune: drop paths whose amplitude is below this times the strongest path of their pose.
        coupled: whether to trace paths that reflect at object and room. If False, the room only hides the object.
        least: amplitude below which pairs of legs are dropped.
        ball: centre (3,) and radius in metres of a ball that contains the object in every frame. Legs are searched for the ball and cached.
        direct: whether to return the direct paths. If False, the function only estimates their level, relative to which it prunes the other
            paths.
    """
    by_tubes = polygons.of(built, table) is None
    if not by_tubes:
        table = polygons.with_nodes(table, radar)
    share, most = LEGS, np.inf
    longest = max_bounces - 1 if coupled else 0
    if room is not None and least > 0:
        alone = group_paths(  # without the room, because an object hidden from the sensor may be visible from an image
            None, built, table, sensor_poses, object_poses, radar, max_bounces=1, cell_m=cell_m, prune=prune
        )
        if alone is None:
            return None
        loudest = BISTATIC * max((_loudest(part, radar) for part in alone), default=0.0)
        share = max(LEGS, least / loudest) if loudest > 0 else np.inf
        longest = longest if share < 1 else 0
        most = COUPLED / max(1, sum(len(part) for part in alone))
    frames = len(sensor_poses)
    centre = object_poses[:, :3, :3] @ built.centre + object_poses[:, :3, 3]
    radius = float(np.linalg.norm(built.corners.reshape(-1, 3) - built.centre, axis=1).max(initial=0))
    if ball is not None:
        centre, radius = np.repeat(ball[0][None], frames, axis=0), ball[1]
    elif np.ptp(sensor_poses[:, :3, 3], axis=0).max() == 0:  # before a resting sensor, nearby object positions share one place
        step = radius / 2
        centre, radius = np.round(centre / max(step, 1e-9)) * step, radius + np.sqrt(3) / 2 * step
    seen = np.concatenate([sensor_poses[:, :3, 3], centre, sensor_poses[:, :3, 2]], axis=1)
    places, place_of = np.unique(np.round(seen, 9), axis=0, return_inverse=True)
    place_of = place_of.ravel()
    legs = Legs.of_free_space(len(places), table.frequencies_hz)
    if room is not None:
        find = legs_module.found_once if ball is not None or len(places) == 1 else legs_module.find
        legs = find(room, places[:, :6], places[:, 6:], radius, table.frequencies_hz, longest, share)
    pose, out_leg, back_leg = _pairs(legs, place_of, frames, max_bounces, share, most)
    ends = [_End.of(legs, leg, pose, sensor_poses, object_poses, radar) for leg in (out_leg, back_leg)]
    out, back = ends
    straight = (out_leg == DIRECT) & (back_leg == DIRECT)
    reflections = legs.order[out_leg] + legs.order[back_leg]
    strength = legs.share[place_of[pose], out_leg] * legs.share[place_of[pose], back_leg]
    found: dict[bool, tuple[Hits, np.ndarray]] = {}
    strongest = np.zeros(frames)
    coupled_cell_m, share_of_pair = coupled_cell_m or cell_m, max(TRACED, EARLY * prune)
    for over, cell in ((False, cell_m if direct else coupled_cell_m), (True, coupled_cell_m)):
        rows = np.flatnonzero(straight != over)
        if not len(rows):
            continue
        weakest = prune * strongest[pose[rows]] / np.maximum(strength[rows], 1e-30)  # the ray tracer multiplies this by EARLY
        estimated = not (over or direct)
        limits = max_bounces - reflections[rows], weakest, STRONGEST if estimated else share_of_pair
        part = _traced(built, table, ends, rows, cell, *limits)
        if part is None:
            return None
        level = largest(part.amplitude) * strength[part.pose] * (part.bounce + reflections[part.pose] <= max_bounces)
        if estimated and by_tubes:
            level *= (cell_m / cell) ** 2  # the amplitude of a tube grows with its cross-section
        np.maximum.at(strongest, pose[part.pose], level)
        if not estimated:
            found[over] = part, level
        del part, level  # lists of millions of hits take gigabytes
    parts, firsts, crosses = [], [], []
    for over in (False, True):
        hits = Hits.none(len(table.frequencies_hz))
        if over in found:
            hits, level = found.pop(over)
            hits = hits.where((level > 0) & (level >= EARLY * prune * strongest[pose[hits.pose]]))
        row, frame = hits.pose, pose[hits.pose]
        amplitude, nodes, rate = hits.amplitude, table.frequencies_hz, np.zeros(len(row))
        sides = (out_leg, out, hits.departure, hits.first_m), (back_leg, back, hits.arrival, hits.length_out_m)
        placed = [end.placed(row, frame, object_poses, direction, length, rate) for _, end, direction, length in sides]
        (departure, _), (arrival, _) = placed
        if over or legs.disturbed:
            nodes = legs.frequencies_hz
            if not np.array_equal(nodes, table.frequencies_hz):
                amplitude = amplitude @ lagrange_basis(table.frequencies_hz, nodes)
            for (leg, *_), (_, point) in zip(sides, placed, strict=True):
                legs.weigh(amplitude, place_of[frame], leg[row], point)
        parts.append(Paths(
            frames, frame, hits.bounce + reflections[row], amplitude, nodes, hits.length_in_m, hits.length_out_m, departure, arrival, rate,
        ))  # fmt: skip
        firsts.append(hits.first_m)
        crosses.append((out_leg != back_leg)[row])
    del hits, sides, placed, amplitude, rate, departure, arrival
    kept, masks = [], strong_masks(parts, radar, prune)
    for first, cross, mask in zip(firsts, crosses, masks, strict=True):
        keep = np.flatnonzero(mask)
        keep = keep[np.argsort(parts[0].pose[keep], kind="stable")]
        kept.append(_both_ways(parts.pop(0).where(keep), first[keep], cross[keep]))
    return kept


def _both_ways(part: Paths, first_m: np.ndarray, cross: np.ndarray) -> Paths:
    """Return the given paths and, for each path with two different legs (connections of sensor and object), also the reversed path."""
    if not cross.any():
        return part
    there, first = part.where(cross), first_m[cross]
    lengths = {"length_in_m": there.length_m - first, "length_out_m": first}
    return Paths.concatenate([part, replace(there, departure=there.arrival, arrival=there.departure, **lengths)])


def _traced(
    built: Geometry, table: ReflectionTable, ends: "list[_End]", rows: np.ndarray, cell_m: float, bounces: np.ndarray, least: np.ndarray,
    prune: float,
) -> Hits | None:  # fmt: skip
    """Trace the object for the chosen pairs of an outgoing and a returning leg, with at most `bounces` (rows,) reflections at the object.

    Hits below the amplitude `least` (rows,), and hits below `prune` times the strongest hit of their pair, may be missing.

    An object of flat faces is traced by its polygons, any other object by ray tubes. Return None if an object that needs tubes is too close
    to the sensor for a planar ray grid.
    """
    body = polygons.of(built, table)
    if body is not None:
        out, back = ends
        hits = polygons.paths(body, table, out.place[rows], back.place[rows], out.axis[rows], back.axis[rows], int(bounces.max()))
        return replace(hits, pose=rows[hits.pose])
    grid = tube_grid.towards(built.hull_points(), ends[0].place[rows], built.centre, cell_m, built.grid_shift)
    if grid is None:
        return None
    transmit, receive = (Antennas(end.place[rows], end.axis[rows]) for end in ends)
    options = TraceOptions(int(bounces.max()), prune=prune, bounces=bounces, least=least)
    hits = tubes.trace(built, table, grid, transmit, receive, options)
    return replace(hits, pose=rows[hits.pose])


@dataclass(frozen=True)
class _End:
    """Hold the sensor's mirror images of N legs (connections of sensor and object by reflections at faces), in the object's frame.

    Attributes:
        place, velocity: (N, 3) position and velocity (m/s) of the image. axis: (N, 3) axis of its antenna.
        turn: (N, 3, 3) rotation of directions at the image to the sensor's frame.
    """

    place: np.ndarray
    velocity: np.ndarray
    axis: np.ndarray
    turn: np.ndarray

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
        arrays = (row, frame, objects, self.place, self.velocity, self.turn, direction, length)
        shared_out(_place, len(row), *map(fixed, arrays), turned, point, rate, grain=GRAIN)
        return turned, point


@compiled
def _place(first, last, row, frame, objects, place, velocity, turn, direction, length, turned, point, rate) -> None:
    """Compute `_End.placed` for the hits `first` to `last` - 1."""
    at = np.empty(3)
    for n in range(first, last):
        r, f = row[n], frame[n]
        for i in range(3):
            at[i] = place[r, i] + direction[n, i] * length[n]
            rate[n] -= direction[n, i] * velocity[r, i]
        for i in range(3):
            turned[n, i] = turn[r, i, 0] * direction[n, 0] + turn[r, i, 1] * direction[n, 1] + turn[r, i, 2] * direction[n, 2]
            point[n, i] = objects[f, i, 0] * at[0] + objects[f, i, 1] * at[1] + objects[f, i, 2] * at[2] + objects[f, i, 3]


def _loudest(part: Paths, radar: Radar) -> float:
    """Return the largest magnitude of the coherent sum of a pose's paths, with the element gain, over all poses and frequency nodes."""
    turned = part.amplitude * np.exp(2j * np.pi / SPEED_OF_LIGHT * part.length_m[:, None] * part.frequencies_hz)
    turned *= both_gains(radar, part.departure, part.arrival)[:, None]
    total = np.zeros((part.poses, turned.shape[1]), complex)
    np.add.at(total, part.pose, turned)
    return float(np.abs(total).max(initial=0.0))


def _least_of_strongest(values: np.ndarray, most: float) -> float:
    """Return the smallest of the `most` largest values; infinity if there are no values."""
    chosen = int(min(most, len(values)))
    return float(np.partition(values, -chosen)[-chosen]) if chosen else np.inf


def _pairs(
    legs: Legs, place_of: np.ndarray, frames: int, max_bounces: int, least: float, most: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (frame, leg to the object, leg back to the sensor) of the pairs of legs to trace, with only one of each pair and its reverse.

    The result contains the pair of two direct legs for every frame. The function drops pairs of legs that are weaker than `least` times an
    undisturbed pair of two direct legs. Of the remaining pairs, the result contains the `most` strongest of each frame, and all pairs that
    are as strong as the weakest of these. The function warns if the other pairs together may exceed TARGET_ERROR of the echo in free space.
    The level in the warning is an upper limit, because the share of a leg uses the largest field over the object and the distance of the
    object's nearest point.
    """
    rows, cut, omitted = [(frame, DIRECT, DIRECT) for frame in range(frames)], 0, 0.0
    if len(legs.order) > 1 and max_bounces > 1:
        of_place = []
        for share in legs.share:
            worth = np.flatnonzero(share * share.max() >= least)
            product = share[worth][:, None] * share[worth][None]
            allowed = (product >= least) & (legs.order[worth][:, None] + legs.order[worth][None] < max_bounces)
            strong = product >= _least_of_strongest(product[allowed], most)
            weak = product[allowed & ~strong]
            cut, omitted = max(cut, len(weak)), max(omitted, float(np.linalg.norm(weak)))  # powers add up, because phases are random
            i, j = np.nonzero(allowed & strong)
            of_place.append([(a, b) for a, b in zip(worth[i].tolist(), worth[j].tolist(), strict=True) if a <= b and b != DIRECT])
        rows += [(frame, a, b) for frame in range(frames) for a, b in of_place[place_of[frame]]]
    if omitted > TARGET_ERROR:
        warnings.warn(
            f"an object has more than COUPLED = {COUPLED:,} paths over the room; in a frame, the {cut} weakest combinations of a way out "
            f"and a way back are left out, whose power is at most about {20 * np.log10(omitted):.0f} dB relative to the echo of the object "
            "in free space",
            CoupledWarning, stacklevel=2,
        )  # fmt: skip
    out = np.array(rows, int).reshape(-1, 3)
    out = out[np.argsort(out[:, 0], kind="stable")]
    return out[:, 0], out[:, 1], out[:, 2]
