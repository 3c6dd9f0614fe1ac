"""An object in a room of panels: traced from the sensor and from its images, received at the sensor and at its images.

A leg is a way between sensor and object: direct, or over a sequence of panels. For every pair of legs that could matter the object is
traced from the first one's image and received at the second one's, all pairs and poses in one launch; each hit is then weighted by
what its two legs carry there, the panels' Fresnel factors, reflections and obstacles included (`images.evaluate` on a grid
around the object, linear in between). Paths object - panel - object are left out: they need a hollow object or a third mirror.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.simulation import images, tubes
from radartwin.simulation import launch as launch_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.panel_room import PanelRoom, key_places
from radartwin.simulation.paths import Paths
from radartwin.simulation.reflection_table import ReflectionTable, lagrange_basis

SHARE = 0.01  # pairs of legs that carry less than this of the direct pair are left out
LONGEST_LEG = 2  # panels
LEG_PRUNE = 5e-3  # of the strongest way to the object, while legs are looked for
MARGIN = 0.3
REACH = 8.0  # Fresnel coordinate beyond which obstacles are not looked at: 0.03 of a leg at most
LINEAR = 0.03  # by which a leg may differ at the object's centre from linear between the corners of its cube, of itself
COARSE = 0.01  # ... or of the direct leg, whichever is more
GRID_M = 0.04  # between the places around the object where a leg is evaluated that differs by more
POINTS_AT_ONCE = 100_000
DIRECT = -1
SCOUT_PRUNE = 2e-4  # while tracing, before antenna gains are known
SHORT_M = 1e-4  # by which a test of the direct way stops before the object


@dataclass(frozen=True)
class _Legs:
    """What legs carry at U distinct places of sensor and object.

    Attributes:
        sequences: over panels. low: (U, 3), size: metres: the cube around the object at each place.
        frequencies_hz: (Q,). carried: {(place, sequence): (n, n, n, Q) complex} on a grid over the cube, the field along the projected axis
            of the image with the Fresnel factor, for exp(+j k L).
        share: (U, S) of a leg's largest field over length to the direct one's.
    """

    sequences: images.Sequences
    low: np.ndarray
    size: float
    frequencies_hz: np.ndarray
    carried: dict[tuple[int, int], np.ndarray]
    share: np.ndarray

    def at(self, place: np.ndarray, sequence: np.ndarray, point: np.ndarray) -> np.ndarray:
        """(N, Q) carried by legs (N,) to points (N, 3) of the world; 1 for the direct leg."""
        out = np.ones((len(point), len(self.frequencies_hz)), complex)
        code = np.where(sequence == DIRECT, -1, place * len(self.sequences) + sequence)
        order = np.argsort(code, kind="stable")
        starts = np.flatnonzero(np.diff(code[order], prepend=-2))
        for mine in np.split(order, starts)[1:] if len(order) else ():
            if code[mine[0]] >= 0:
                u, s = int(place[mine[0]]), int(sequence[mine[0]])
                out[mine] = _interpolated(self.carried[u, s], (point[mine] - self.low[u]) / self.size)
        return out


def _interpolated(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(N, Q): values (n, n, n, Q) on a regular grid over the unit cube at points x (N, 3), linear along each axis."""
    side = len(values)
    x = np.clip(x * (side - 1), 0, side - 1 - 1e-9)
    cell = x.astype(int)
    share = x - cell
    total = np.zeros((len(x), values.shape[-1]), complex)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, share, 1 - share), axis=1)
        total += weight[:, None] * values[tuple((cell + corner).T)]
    return total


def group_paths(
    room: PanelRoom | None,
    built: Geometry,
    table: ReflectionTable,
    sensor_poses: np.ndarray,
    object_poses: np.ndarray,
    radar: Radar,
    *,
    max_bounces: int,
    cell_m: float,
    occluder: Geometry | None,
    prune: float,
) -> list[Paths] | None:
    """Paths by way of an object: direct ones, and those over the room's panels; None where no planar grid of tubes holds the object.

    Args:
        room: panels; None for free space. built, table: the object in its own frame.
        sensor_poses, object_poses: (F, 4, 4) to the world.
        cell_m: width of a tube on the object.
        occluder: static geometry that hides the object on direct legs.
    """
    frames = len(sensor_poses)
    sensor = sensor_poses[:, :3, 3]
    centre = object_poses[:, :3, :3] @ built.centre + object_poses[:, :3, 3]
    places, place_of = np.unique(np.round(np.concatenate([sensor, centre], axis=1), 9), axis=0, return_inverse=True)
    place_of = place_of.ravel()
    axes = sensor_poses[_first_of(place_of, len(places)), :3, 2]
    legs = None if room is None else _legs(room, places, axes, built, table, max_bounces)
    pose, out_leg, back_leg = _pairs(legs, place_of, frames, max_bounces)
    out_map, back_map = _maps(legs, out_leg), _maps(legs, back_leg)
    source, source_velocity = _seen(out_map, pose, sensor_poses, object_poses, radar)
    target, target_velocity = _seen(back_map, pose, sensor_poses, object_poses, radar)
    turn = object_poses[pose, :3, :3]
    up = sensor_poses[pose, :3, 2]
    transmit, receive = (
        tubes.Antennas(at, np.einsum("nji,nj->ni", turn, np.einsum("nij,nj->ni", flip, up)))
        for at, (flip, _) in ((source, out_map), (target, back_map))
    )
    grid = launch_module.towards(built.hull_points(), source, built.centre, cell_m, built.grid_shift)
    if grid is None:
        return None
    hits = tubes.trace(built, table, grid, transmit, receive, max_bounces=max_bounces, prune=SCOUT_PRUNE)
    row = hits.pose
    world = object_poses[pose[row]]
    first = _point(world, source[row], hits.departure, hits.first_m)
    last = _point(world, target[row], hits.arrival, hits.length_out_m)
    order = hits.bounce.copy()
    if legs is not None:
        panels_met = np.append(legs.sequences.order, 0)  # the direct leg comes last
        order += panels_met[out_leg[row]] + panels_met[back_leg[row]]
    keep = order <= max_bounces
    if occluder is not None:
        origin = sensor_poses[pose[row], :3, 3]
        for leg, point in ((out_leg, first), (back_leg, last)):
            direct = np.flatnonzero(keep & (leg[row] == DIRECT))
            keep[direct] &= _free(occluder, origin[direct], point[direct])
    rotation = np.swapaxes(sensor_poses[pose[row], :3, :3], 1, 2)
    departure, arrival = (  # a chain of mirrors is undone by its transpose
        np.einsum("nij,nkj,nkl,nl->ni", rotation, flip[row], world[:, :3, :3], d, optimize=True)
        for d, (flip, _) in ((hits.departure, out_map), (hits.arrival, back_map))
    )
    rate = -np.einsum("ni,ni->n", hits.departure, source_velocity[row]) - np.einsum("ni,ni->n", hits.arrival, target_velocity[row])
    straight = (out_leg[row] == DIRECT) & (back_leg[row] == DIRECT)
    parts = []
    for chosen in (keep & straight, keep & ~straight):
        amplitude, nodes = hits.amplitude[chosen], table.frequencies_hz
        if legs is not None and not chosen[straight].any():
            mine = row[chosen]
            nodes = legs.frequencies_hz
            amplitude = amplitude @ lagrange_basis(table.frequencies_hz, nodes)
            for leg, point in ((out_leg, first), (back_leg, last)):
                amplitude = amplitude * legs.at(place_of[pose[mine]], leg[mine], point[chosen])
        parts.append(
            Paths(
                frames, pose[row[chosen]], order[chosen], amplitude, nodes, hits.length_in_m[chosen], hits.length_out_m[chosen],
                departure[chosen], arrival[chosen], rate[chosen],
            )
        )  # fmt: skip
    return _pruned(parts, radar, prune)


def _pruned(parts: list[Paths], radar: Radar, prune: float) -> list[Paths]:
    """Parts without paths below a share of the strongest of their pose in all of them, ordered by pose."""
    level = [
        np.abs(p.amplitude).max(axis=1, initial=0) * element_gain(radar.element, p.departure) * element_gain(radar.element, p.arrival)
        for p in parts
    ]
    strongest = np.zeros(parts[0].poses)
    for part, one in zip(parts, level, strict=True):
        np.maximum.at(strongest, part.pose, one)
    kept = [p.where((one >= prune * strongest[p.pose]) & (one > 0)) for p, one in zip(parts, level, strict=True)]
    return [p.where(np.argsort(p.pose, kind="stable")) for p in kept]


def _free(geometry: Geometry, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """(N,) whether nothing of a geometry stands between points (N, 3) of the world."""
    import mitsuba as mi

    if not len(start):
        return np.zeros(0, bool)
    way = stop - start
    distance = np.linalg.norm(way, axis=1)
    ray: Any = mi.Ray3f(mi.Point3f(*start.astype(np.float32).T), mi.Vector3f(*(way / distance[:, None]).astype(np.float32).T))
    ray.maxt = mi.Float((distance - SHORT_M).astype(np.float32))
    return ~geometry.scene().ray_test(ray).numpy()


def _first_of(index: np.ndarray, count: int) -> np.ndarray:
    """(count,) position at which each value of an index first stands."""
    first = np.zeros(count, int)
    first[index[::-1]] = np.arange(len(index))[::-1]
    return first


def _point(world: np.ndarray, source: np.ndarray, direction: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Points at a length along directions, (N, 3), object frame to world."""
    return np.einsum("nij,nj->ni", world[:, :3, :3], source + direction * length[:, None]) + world[:, :3, 3]


def _maps(legs: _Legs | None, leg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image map of each leg: (N, 3, 3) and (N, 3)."""
    mirror, shift = np.tile(np.eye(3), (len(leg), 1, 1)), np.zeros((len(leg), 3))
    if legs is not None:
        over = leg != DIRECT
        mirror[over], shift[over] = legs.sequences.mirror[leg[over]], legs.sequences.shift[leg[over]]
    return mirror, shift


def _seen(
    maps: tuple[np.ndarray, np.ndarray], pose: np.ndarray, sensor: np.ndarray, objects: np.ndarray, radar: Radar
) -> tuple[np.ndarray, np.ndarray]:
    """Images of the sensor in the object's frame and their velocity there, each (N, 3)."""
    mirror, shift = maps
    moments = []
    for sensor_then, objects_then in poses_module.moments(sensor, objects):
        image = np.einsum("nij,nj->ni", mirror, sensor_then[pose, :3, 3]) + shift
        moments.append(np.einsum("nji,nj->ni", objects_then[pose, :3, :3], image - objects_then[pose, :3, 3]))
    return moments[0], (moments[1] - moments[0]) / poses_module.MOMENT * radar.frame_rate_hz


def _pairs(legs: _Legs | None, place_of: np.ndarray, frames: int, max_bounces: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(frame, leg out, leg back) of everything to be traced; the direct pair of every frame always is."""
    rows = [(frame, DIRECT, DIRECT) for frame in range(frames)]
    if legs is not None and max_bounces > 1:
        order = np.concatenate([legs.sequences.order, [0]])
        of_place = []
        for share in legs.share:
            strength = np.concatenate([share, [1.0]])
            worth = np.flatnonzero(strength * strength.max() >= SHARE)
            product = strength[worth][:, None] * strength[worth][None]
            allowed = (product >= SHARE) & (order[worth][:, None] + order[worth][None] < max_bounces)
            i, j = np.nonzero(allowed)
            names = np.where(worth == len(share), DIRECT, worth)
            of_place.append([(a, b) for a, b in zip(names[i].tolist(), names[j].tolist(), strict=True) if (a, b) != (DIRECT, DIRECT)])
        rows += [(frame, a, b) for frame in range(frames) for a, b in of_place[place_of[frame]]]
    out = np.array(rows, int).reshape(-1, 3)
    out = out[np.argsort(out[:, 0], kind="stable")]
    return out[:, 0], out[:, 1], out[:, 2]


def _legs(room: PanelRoom, places: np.ndarray, axes: np.ndarray, built: Geometry, table: ReflectionTable, max_bounces: int) -> _Legs:
    """Find the legs and evaluate them around the object."""
    sensor, centre = places[:, :3], places[:, 3:]
    radius = float(np.linalg.norm(built.corners.reshape(-1, 3) - built.centre, axis=1).max())
    keys, near = key_places(places)
    chains = room.chains(sensor[keys], centre[keys], axes[keys], min(LONGEST_LEG, max_bounces - 1), LEG_PRUNE)
    known = sorted(set().union(*chains))
    ends = np.concatenate([centre - radius, centre + radius])
    prepared = images.prepare(room.panels, room.things, known, sensor, ends)
    of_key = np.array([np.isin(prepared.chain, [i for i, chain in enumerate(known) if chain in found]) for found in chains])
    active = np.array([of_key[keys_].any(axis=0) for keys_ in near])
    place, which = np.nonzero(active)
    one = images.evaluate(room.panels, room.things, prepared, room.table, which, sensor[place], axes[place], centre[place], reach=REACH)
    direct = np.linalg.norm(centre - sensor, axis=1)
    level = np.abs(one.factor) * np.linalg.norm(one.field, axis=2).max(axis=1, initial=0) * direct[place] / np.maximum(one.length_m, 1e-9)
    nodes = max(room.table.frequencies_hz, table.frequencies_hz, key=len)
    legs = _Legs(prepared, centre - radius, 2 * radius, nodes, {}, np.zeros((len(places), len(prepared))))
    # an edge of its shadow may cross the object: less than what counts, at the centre, is still looked at around it
    chosen = np.flatnonzero(level >= MARGIN * SHARE)
    chosen = chosen[_fill(legs, room, place[chosen], which[chosen], sensor, axes, 2, direct, one, chosen)]
    _fill(legs, room, place[chosen], which[chosen], sensor, axes, int(np.clip(np.ceil(2 * radius / GRID_M), 2, 6)) + 1, direct)
    for (u, s), values in legs.carried.items():
        image = prepared.mirror[s] @ sensor[u] + prepared.shift[s]
        legs.share[u, s] = np.abs(values).max() * direct[u] / max(float(np.linalg.norm(centre[u] - image)) - radius, radius)
    return legs


def _fill(
    legs: _Legs,
    room: PanelRoom,
    place: np.ndarray,
    which: np.ndarray,
    sensor: np.ndarray,
    axes: np.ndarray,
    side: int,
    direct: np.ndarray,
    centre: images.Images | None = None,
    index: np.ndarray | None = None,
) -> np.ndarray:
    """Evaluate legs on a grid of `side` points along each axis; with their values at the `centre`, the mask of those not linear over it."""
    prepared = legs.sequences
    basis = lagrange_basis(room.table.frequencies_hz, legs.frequencies_hz)
    steps = np.stack(np.meshgrid(*[np.linspace(0, legs.size, side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    bent = np.zeros(len(place), bool)
    chunk = max(1, POINTS_AT_ONCE // len(steps))
    for start in range(0, len(place), chunk):
        some = slice(start, start + chunk)
        u, s = (np.repeat(x[some], len(steps)) for x in (place, which))
        points = legs.low[u] + np.tile(steps, (len(place[some]), 1))
        value = _along_axis(room, prepared, u, s, sensor, axes, points).reshape(len(place[some]), -1, basis.shape[0])
        if centre is not None and index is not None:
            u, s = place[some], which[some]
            middle = _projected(
                prepared, u, s, sensor, axes, legs.low[u] + legs.size / 2, centre.field[index[some]], centre.factor[index[some]]
            )
            bound = np.maximum(LINEAR * np.abs(middle).max(axis=1), COARSE * centre.length_m[index[some]] / direct[u])
            bent[some] = np.abs(value.mean(axis=1) - middle).max(axis=1) > bound
            bent[some] |= np.abs(value - middle[:, None]).max(axis=(1, 2)) > np.maximum(np.abs(middle).max(axis=1), bound)
        for row, key in enumerate(zip(place[some].tolist(), which[some].tolist(), strict=True)):
            legs.carried[key] = (value[row] @ basis).reshape(side, side, side, -1)
    return bent


def _along_axis(
    room: PanelRoom, prepared: images.Sequences, u: np.ndarray, s: np.ndarray, sensor: np.ndarray, axes: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """(N, Q) carried by legs from places (N,) over sequences (N,) to points (N, 3)."""
    at = images.evaluate(room.panels, room.things, prepared, room.table, s, sensor[u], axes[u], points, reach=REACH)
    return _projected(prepared, u, s, sensor, axes, points, at.field, at.factor)


def _projected(
    prepared: images.Sequences,
    u: np.ndarray,
    s: np.ndarray,
    sensor: np.ndarray,
    axes: np.ndarray,
    points: np.ndarray,
    field: np.ndarray,
    factor: np.ndarray,
) -> np.ndarray:
    """Fields (N, Q, 3) at points along what the image's own antenna would send there, times the factor."""
    way = points - np.einsum("nij,nj->ni", prepared.mirror[s], sensor[u]) - prepared.shift[s]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    unit = images.across(np.einsum("nij,nj->ni", prepared.mirror[s], axes[u]), way)
    return np.einsum("nk,nqk->nq", unit, field).conj() * factor[:, None]
