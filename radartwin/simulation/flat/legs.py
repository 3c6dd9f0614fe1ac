"""Legs: connections of sensor and object by reflections at panels of a room, with the field of each leg around the object.

Sequences of reflecting panels with the same mirror image of the sensor form one leg, because the sum of their fields is smooth although
each field is not. Examples are the two orders of reflection at two walls that meet, and the pieces of a single wall. A leg is evaluated at
the corners of a cube around the object, and on a finer grid where the field is not linear between the corners.
"""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from radartwin.compiled import compiled
from radartwin.simulation.flat import images
from radartwin.simulation.flat.panel_room import PanelRoom, key_places
from radartwin.simulation.reflection_table import lagrange_basis

DIRECT = -1
SHARE = 0.02  # pairs of legs with a field below this times the direct leg's field are dropped, and therefore also such legs
LONGEST = 2  # largest number of panels per leg
PRUNE = 5e-3  # threshold in the search for legs, relative to the strongest path to the object
MARGIN = 0.3  # factor on SHARE at the object's centre, because the edge of a leg's shadow may cross the object
REACH = 8.0  # Fresnel coordinate beyond which obstacles are ignored (error: at most 0.03 of a leg's field)
LINEAR = 0.03  # a finer grid is used if the field at the object's centre deviates more than this from the mean of the cube's corners
COARSE = 0.02  # the same limit relative to the direct leg's field; the larger limit applies
GRID_M = 0.05  # spacing of the finer grid
ABOVE_M = 1e-4  # a leg's field is evaluated at least this far above the last panel
POINTS_AT_ONCE = 100_000
KEPT = 64  # number of cache entries, each for a few places
_kept: "OrderedDict[tuple, tuple[PanelRoom, Legs]]" = OrderedDict()  # an entry also holds the room, so that no other room gets its id


@dataclass(frozen=True)
class Legs:
    """Hold the fields of G legs for U pairs of sensor position and object position (places). A leg connects sensor and object by
    reflections at wall panels.

    Attributes:
        order: (G,) number of panels. mirror, shift: (G, 3, 3), (G, 3); the image of a point x is mirror x + shift.
        low, size: lowest corner (U, 3) and edge length in metres of the cube around the object, for each pair of sensor position and
            object position.
        frequencies_hz: (Q,). carried: {(place, leg): (n, n, n, Q) complex field} on a grid over the cube, along the projected axis of the
            image and including the Fresnel factor, for exp(+j k L).
        share: (U, G) largest ratio of a leg's field to the direct leg's field, both divided by path length.
    """

    order: np.ndarray
    mirror: np.ndarray
    shift: np.ndarray
    low: np.ndarray
    size: float
    frequencies_hz: np.ndarray
    carried: Mapping[tuple[int, int], np.ndarray]
    share: np.ndarray

    def maps(self, leg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the image maps (mirror (N, 3, 3) and shift (N, 3)) of legs (N,), which may be DIRECT."""
        mirror, shift = np.concatenate([self.mirror, np.eye(3)[None]]), np.concatenate([self.shift, np.zeros((1, 3))])
        return mirror[leg], shift[leg]

    def panels_met(self, leg: np.ndarray) -> np.ndarray:
        """Return the number of panels (N,) of legs (N,); 0 for the direct leg."""
        return np.append(self.order, 0)[leg]

    def strength(self, place: np.ndarray, leg: np.ndarray) -> np.ndarray:
        """Return the attribute `share` (N,) of N pairs of a place and a leg: the largest ratio of the leg's field to the direct leg's
        field. The ratio is 1 for the direct leg.
        """
        return np.concatenate([self.share, np.ones((len(self.share), 1))], axis=1)[place, leg]

    def weigh(self, amplitude: np.ndarray, place: np.ndarray, leg: np.ndarray, point: np.ndarray) -> None:
        """Multiply amplitudes (N, Q) in place by the fields of legs (N,) at points (N, 3) in the world. The direct leg has field 1."""
        over = np.flatnonzero(leg != DIRECT)
        code = place[over] * len(self.order) + leg[over]
        order = np.argsort(code, kind="stable")
        for mine in np.split(over[order], np.flatnonzero(np.diff(code[order])) + 1) if len(over) else ():
            u = int(place[mine[0]])
            _weigh(self.carried[u, int(leg[mine[0]])], (point[mine] - self.low[u]) / self.size, mine, amplitude)


@compiled
def _weigh(values: np.ndarray, x: np.ndarray, rows: np.ndarray, amplitude: np.ndarray) -> None:
    """Multiply rows of `amplitude` (N, Q) by values (n, n, n, Q) on the unit cube, interpolated linearly at x (rows, 3)."""
    side = values.shape[0]
    low, share = np.zeros(3, np.int64), np.zeros(3)
    for i in range(len(rows)):
        for k in range(3):
            place = min(max(x[i, k], 0.0), 1.0) * (side - 1)
            low[k] = min(int(place), side - 2)
            share[k] = place - low[k]
        for q in range(values.shape[3]):
            total = 0j
            for corner in range(8):
                a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
                weight = (share[0] if a else 1 - share[0]) * (share[1] if b else 1 - share[1]) * (share[2] if c else 1 - share[2])
                total += weight * values[low[0] + a, low[1] + b, low[2] + c, q]
            amplitude[rows[i], q] *= total


def find(
    room: PanelRoom, places: np.ndarray, axes: np.ndarray, radius: float, frequencies_hz: np.ndarray, longest: int, least: float = SHARE
) -> Legs:
    """Find the strong connections (legs) of sensor and object by reflections at wall panels, and compute their fields.

    Args:
        places: (U, 6) positions of sensor and object centre, metres. axes: (U, 3) the sensor's antenna axis.
        radius: of the ball about the object's centre that contains it. frequencies_hz: nodes of the object's reflection table.
        longest: largest number of panels at which a leg reflects. least: legs whose field is below this times the direct leg's field are
            dropped.
    """
    sensor, centre = places[:, :3], places[:, 3:]
    keys, near = key_places(places)
    chains = room.chains(sensor[keys], centre[keys], axes[keys], min(LONGEST, longest), PRUNE * least / SHARE)
    known = sorted(set().union(*chains))
    prepared = images.prepare(room.panels, room.things, known, sensor, np.concatenate([centre - radius, centre + radius]))
    of_key = np.array([np.isin(prepared.chain, [i for i, chain in enumerate(known) if chain in found]) for found in chains])
    place, which = np.nonzero(np.array([of_key[nearest].any(axis=0) for nearest in near]))
    direct = np.linalg.norm(centre - sensor, axis=1)
    nodes = max(room.table.frequencies_hz, frequencies_hz, key=len)

    maps = np.concatenate([prepared.order[:, None], prepared.mirror.reshape(-1, 9), prepared.shift], axis=1)
    first, group = np.unique(np.round(maps, 6), axis=0, return_index=True, return_inverse=True)[1:]
    group = group.ravel()
    order, mirror, shift = prepared.order[first], prepared.mirror[first], prepared.shift[first]
    view = _View(room, prepared, sensor, axes)
    middle = view.carried(place, which, centre[place])
    # sum of the sequences' fields per place and leg
    codes, code = np.unique(place * max(len(first), 1) + group[which], return_inverse=True)
    at_centre = _summed(middle, code, len(codes))
    u, g = codes // max(len(first), 1), codes % max(len(first), 1)
    length = np.linalg.norm(np.einsum("nij,nj->ni", mirror[g], sensor[u]) + shift[g] - centre[u], axis=1)
    loudest = np.zeros(len(codes))
    np.maximum.at(loudest, code, np.abs(middle).max(axis=1, initial=0))
    wanted = loudest * direct[u] / np.maximum(length, 1e-9) >= MARGIN * least
    carried: dict[tuple[int, int], np.ndarray] = {}
    fine = int(np.clip(np.ceil(2 * radius / GRID_M), 2, 4)) + 1
    basis = lagrange_basis(room.table.frequencies_hz, nodes)
    for side in (2, fine):
        rows = np.flatnonzero(wanted[code])
        steps = np.stack(np.meshgrid(*[np.linspace(-radius, radius, side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        kept, index = np.unique(code[rows], return_inverse=True)
        total = np.zeros((len(kept), len(steps), len(room.table.frequencies_hz)), complex)
        chunk = max(1, POINTS_AT_ONCE // len(steps))
        for start in range(0, len(rows), chunk):
            some = rows[start : start + chunk]
            points = (centre[place[some]][:, None] + steps).reshape(-1, 3)
            value = view.carried(np.repeat(place[some], len(steps)), np.repeat(which[some], len(steps)), points)
            np.add.at(total, index[start : start + chunk], value.reshape(len(some), len(steps), -1))
        for row, k in enumerate(kept):
            carried[int(u[k]), int(g[k])] = (total[row] @ basis).reshape(side, side, side, -1)
        size = np.abs(at_centre[kept]).max(axis=1)
        bound = np.maximum(LINEAR * size, COARSE * length[kept] / direct[u[kept]])
        bent = np.abs(total.mean(axis=1) - at_centre[kept]).max(axis=1, initial=0) > bound
        bent |= np.abs(total - at_centre[kept][:, None]).max(axis=(1, 2), initial=0) > np.maximum(size, bound)
        wanted[:] = False
        wanted[kept[bent]] = True
    share = np.zeros((len(places), len(first)))
    for (i, leg), values in carried.items():
        image = mirror[leg] @ sensor[i] + shift[leg]
        share[i, leg] = np.abs(values).max() * direct[i] / max(float(np.linalg.norm(centre[i] - image)) - radius, radius)
    return Legs(order, mirror, shift, centre - radius, 2 * radius, nodes, carried, share)


def found_once(room: PanelRoom, places: np.ndarray, axes: np.ndarray, radius: float, frequencies_hz: np.ndarray, *how: float) -> Legs:
    """Call `find`, with a cache of the last KEPT calls."""
    key = (id(room), places.tobytes(), axes.tobytes(), radius, frequencies_hz.tobytes(), *how)
    if key not in _kept:
        _kept[key] = (room, find(room, places, axes, radius, frequencies_hz, *how))  # pyright: ignore[reportArgumentType]
        while len(_kept) > KEPT:
            _kept.popitem(last=False)
    _kept.move_to_end(key)
    return _kept[key][1]


def _summed(values: np.ndarray, index: np.ndarray, count: int) -> np.ndarray:
    """Sum values (N, Q) by index (N,) to an array (count, Q)."""
    total = np.zeros((count, values.shape[1]), complex)
    np.add.at(total, index.ravel(), values)
    return total


@dataclass(frozen=True)
class _View:
    """Compute the fields of paths that start at the sensor positions (U, 3) with the antenna axes (U, 3) and reflect at sequences of
    panels.
    """

    room: PanelRoom
    prepared: images.Sequences
    sensor: np.ndarray
    axes: np.ndarray

    def carried(self, place: np.ndarray, which: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the fields (N, Q) of N paths along the polarisation of the image's antenna. Path n starts at a sensor position (index
        (N,)), reflects at a sequence of panels (index (N,)), and ends at a point (N, 3).
        """
        room, prepared, source, axis = self.room, self.prepared, self.sensor[place], self.axes[place]
        # The field of a panel ends at its plane, so values above and below cannot be interpolated. Points behind the plane have the value
        # on the plane, which is small beyond the panel's edges.
        last = prepared.panel[which, prepared.order[which] - 1]
        side = prepared.side[which, prepared.order[which] - 1]
        height = side * (np.einsum("ni,ni->n", points, room.panels.normal[last]) - room.panels.offset[last])
        points = points + (np.maximum(ABOVE_M - height, 0) * side)[:, None] * room.panels.normal[last]
        at = images.evaluate(room.panels, room.things, prepared, room.table, which, source, axis, points, reach=REACH)
        way = points - np.einsum("nij,nj->ni", prepared.mirror[which], source) - prepared.shift[which]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        unit = images.across(np.einsum("nij,nj->ni", prepared.mirror[which], axis), way)
        return np.einsum("nk,nqk->nq", unit, at.field).conj() * at.factor[:, None]
