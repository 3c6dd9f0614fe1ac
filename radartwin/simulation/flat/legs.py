"""Legs: connections of sensor and object, direct or by reflections at faces of a room, with the field of each leg around the object.

The field of a leg is that of the sensor's image, times a factor for each mirror and for each part of the line. The factor of a mirror is
that of an opening with the outline of the mirror (`kirchhoff`). The factor of a part of the line is the shadow factor of the bodies beside
it (`shadows`). Sequences of faces with the same image of the sensor form one leg, because the sum of their fields is smooth although each
field is not. For example, the two orders of reflection at two walls that meet form one leg. A leg is evaluated at the corners of a cube
around the object, and on a finer grid where the field is not linear between the corners. Where it is not linear even on the finer grid,
as behind the edge of a table top, the field is *sharp*. A sharp field around a small object is evaluated on a grid of SHARP_M, beside the
points that need it.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from radartwin.compiled import compiled, each, fixed, innermost, shared_out
from radartwin.simulation.flat.field import NUDGE, Walls, contains, image, images_of, polarised, travelled
from radartwin.simulation.flat.kirchhoff import REACH, edge_part
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Vector
from radartwin.simulation.flat.room import FlatRoom, cells
from radartwin.simulation.flat.shadows import factors, line_of, past_faces
from radartwin.simulation.flat.vectors import ZERO, distance, dot, moved, put, toward, transverse, vector
from radartwin.simulation.pruning import EARLY, LEGS, MIRRORED
from radartwin.simulation.reflection_table import lagrange_basis
from radartwin.store.recent import Recent

DIRECT = 0
LONGEST = 2  # largest number of reflections of a leg
SEEN = 8  # largest number of places of a cell between which and the faces visibility is tested
LINEAR = 0.03  # a finer grid is used if the field at the object's centre deviates more than this from the mean of the cube's corners
COARSE = 0.02  # the same limit relative to the undisturbed direct field; the larger limit applies
GRID_M = 0.05  # spacing of the finer grid
# Spacing of the grid of a sharp field that bends by BENT times the undisturbed direct field. The spacing of other sharp fields has the same
# error: it goes with the inverse of the root of the bend. A grid has at most MOST cells along each side.
SHARP_M = 0.0075
BENT = 0.1
MOST = 64
# Radius of the largest ball whose fields can be sharp. With no limit, a recording in the laboratory takes 140 instead of 60 s of processor
# time, because its furniture gets such grids, and its flat faces get ray tubes.
SHARP_BALL_M = 0.31
BESIDE_M = 0.25  # a leg whose mirror point is farther than this from its face has no field
ABOVE_M = 1e-4  # a leg's field is evaluated at least this far above the last face
ROUNDED = 0.3  # the centre of the ball about an object may lie this far from the object's own centre, relative to the ball's radius
UNDISTURBED = 1e-3  # a direct leg whose field changes by at most this needs no weight
KEPT = 32  # number of cache entries, each for a few places
_kept: "Recent[tuple[FlatRoom, Legs]]" = Recent(KEPT)  # an entry also holds the room, so that no other room gets its id
# The places at which the sharp fields of a grid of n^3 places are evaluated, by the id of the legs, and place * G + leg: the legs, so that
# no others get the id, the row (n^3,) of each place, -1 for none, and the fields (K, Q) of the rows; 500 MB in all.
_evaluated: "Recent[tuple[Legs, np.ndarray, np.ndarray]]" = Recent(500_000_000)


@dataclass(frozen=True)
class Legs:
    """Hold the fields of G legs for U pairs of a sensor position and an object position (places). Leg DIRECT has no reflection.

    Attributes:
        order: (G,) number of reflections. mirror, shift: (G, 3, 3), (G, 3); the image of a point x is mirror x + shift.
        low, size: lowest corner (U, 3) and edge length in metres of the cube around the object, for each place.
        frequencies_hz: (Q,). carried: {(place, leg): (n, n, n, Q) complex field} on a grid over the cube, along the projected axis of the
            image, relative to the field of an undisturbed line from the image, for exp(+j k L).
        share: (U, G) largest ratio of a leg's field to the undisturbed direct field, both divided by path length.
        sharp: (U, G) spacing in metres of the grid of a sharp field, 0 for a field that is not sharp.
        exact: function that returns the fields (N, Q) of a place and a sharp leg at points (N, 3).
    """

    order: np.ndarray
    mirror: np.ndarray
    shift: np.ndarray
    low: np.ndarray
    size: float
    frequencies_hz: np.ndarray
    carried: Mapping[tuple[int, int], np.ndarray]
    share: np.ndarray
    sharp: np.ndarray
    exact: Callable[[int, int, np.ndarray], np.ndarray] | None = None

    @staticmethod
    def of_free_space(places: int, frequencies_hz: np.ndarray) -> "Legs":
        """Return undisturbed direct legs for a number of places."""
        ones = np.ones((2, 2, 2, len(frequencies_hz)), complex)
        carried = {(u, DIRECT): ones for u in range(places)}
        zero, whole = np.zeros((places, 3)), np.ones((places, 1))
        return Legs(np.zeros(1, int), np.eye(3)[None], np.zeros((1, 3)), zero, 1.0, frequencies_hz, carried, whole, 0 * whole)

    @cached_property
    def disturbed(self) -> bool:
        """Return whether a direct leg differs from an undisturbed line."""
        return any(np.abs(values - 1).max() > UNDISTURBED for (_, leg), values in self.carried.items() if leg == DIRECT)

    def weigh(self, amplitude: np.ndarray, place: np.ndarray, leg: np.ndarray, point: np.ndarray) -> None:
        """Multiply amplitudes (N, Q) in place by the fields of legs (N,) at points (N, 3) in the world."""
        code, sharp = place * len(self.order) + leg, self.sharp[place, leg] > 0
        groups: list[slice | np.ndarray] = [slice(None)]
        if sharp.any():
            groups = [np.flatnonzero(~sharp), *(np.flatnonzero(code == key) for key in np.unique(code[sharp]))]
        for rows in groups:
            codes, points = np.flatnonzero(np.bincount(code[rows])), np.ascontiguousarray(point[rows])
            number = np.zeros(codes[-1] + 1 if len(codes) else 0, int)
            number[codes] = np.arange(len(codes))
            if sharp[rows].any():  # of one leg
                side, row, values = self._sharp_field(int(codes[0]), points)
                sides = np.array([side])
            else:
                fields = [self.carried.get(divmod(int(key), len(self.order))) for key in codes]
                sides, row = np.array([0 if field is None else len(field) for field in fields], int), np.zeros(0, np.int32)
                values = np.concatenate([np.zeros((0, amplitude.shape[1])), *(f.reshape(-1, f.shape[3]) for f in fields if f is not None)])
            first = np.cumsum([0, *sides[:-1] ** 3])
            grids = fixed(values.astype(complex, copy=False).view(float)), row, first, sides, number[code[rows]], self.low, self.size
            part = amplitude[rows]
            shared_out(_weigh, len(part), *grids, place[rows], points, part, grain=1000)
            if len(groups) > 1:  # `part` is a copy
                amplitude[rows] = part

    def _sharp_field(self, code: int, points: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Return the number n of places along a side of the grid of a sharp leg, the rows (n^3,) of the places beside the points (N, 3),
        and their fields (K, Q).
        """
        assert self.exact is not None
        place, leg = divmod(code, len(self.order))
        side = int(np.clip(np.ceil(self.size / self.sharp[place, leg]), 4, MOST)) + 1
        none = np.zeros((0, len(self.frequencies_hz)), complex)
        _, row, field = _evaluated.get((id(self), code), 4 * side**3, lambda: (self, np.full(side**3, -1, np.int32), none))
        cell = np.minimum((np.clip((points - self.low[place]) / self.size, 0, 1) * (side - 1)).astype(int), side - 2)
        near = np.zeros((side, side, side), bool)
        for corner in np.ndindex(2, 2, 2):
            near[tuple((cell + corner).T)] = True
        if len(missing := np.flatnonzero(near.ravel() & (row < 0))):
            steps = np.stack(np.unravel_index(missing, near.shape), axis=1)
            added = self.exact(place, leg, self.low[place] + steps * (self.size / (side - 1)))
            row = row.copy()  # another thread may read the kept one
            row[missing] = len(field) + np.arange(len(missing))
            field = np.concatenate([field, added])
            _evaluated.put((id(self), code), row.nbytes + field.nbytes, (self, row, field))
        return side, row, field


@compiled
def _weigh(
    begin: int, stop: int, values: np.ndarray, rows: np.ndarray, first: np.ndarray, sides: np.ndarray, number: np.ndarray, low: np.ndarray,
    size: float, place: np.ndarray, point: np.ndarray, amplitude: np.ndarray,
) -> None:  # fmt: skip
    """Multiply the rows `begin` to `stop` - 1 of `amplitude` (N, Q) by the field of one of M legs.

    The field is interpolated linearly at points (N, 3).

    Args:
        values: (K, 2 Q) real and imaginary parts of the fields on the grids (side, side, side) of all legs, one after another.
        rows: row of each place of the grids in `values`; empty if `values` has a row for each place.
        first, sides: (M,) first place and side of each grid; a leg of side 0 has no field. number: (N,) leg of each row.
        low, size: (U, 3) lowest corner and edge length of the cubes. place: (N,) cube of each row.
    """
    total = np.empty(values.shape[1])
    for i in range(begin, stop):
        side = sides[number[i]]
        if side == 0:
            for q in range(amplitude.shape[1]):
                amplitude[i, q] = 0
            continue
        lowest, u = vector(low, place[i]), vector(point, i)
        x, x_share = _cell((u[0] - lowest[0]) / size, side)
        y, y_share = _cell((u[1] - lowest[1]) / size, side)
        z, z_share = _cell((u[2] - lowest[2]) / size, side)
        total[:] = 0
        for corner in range(8):
            a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
            weight = (x_share if a else 1 - x_share) * (y_share if b else 1 - y_share) * (z_share if c else 1 - z_share)
            row = first[number[i]] + ((x + a) * side + y + b) * side + z + c
            if len(rows):
                row = rows[row]
            for q in range(len(total)):
                total[q] += weight * values[row, q]
        for q in range(amplitude.shape[1]):
            amplitude[i, q] *= complex(total[2 * q], total[2 * q + 1])


@innermost
def _cell(share: float, side: int) -> tuple[int, float]:
    """Return the cell in a row of `side` points in which a position lies, and the position in the cell (0 to 1). share: relative position
    in the row, limited to 0 to 1.
    """
    at = min(max(share, 0.0), 1.0) * (side - 1)
    cell = min(int(at), side - 2)
    return cell, at - cell


def find(
    room: FlatRoom, places: np.ndarray, axes: np.ndarray, radius: float, frequencies_hz: np.ndarray, longest: int, least: float = LEGS
) -> Legs:
    """Find the strong connections (legs) of sensor and object, and compute their fields.

    Args:
        places: (U, 6) positions of sensor and object centre, metres. axes: (U, 3) the sensor's antenna axis.
        radius: of the ball about the object's centre that contains the object. frequencies_hz: nodes of the object's reflection table.
        longest: largest number of reflections of a leg; 0 gives the direct leg only.
        least: legs whose field is below this times the undisturbed direct field are dropped.
    """
    sensor, centre = places[:, :3], places[:, 3:]
    direct = np.linalg.norm(centre - sensor, axis=1)
    chains, place, which = _chains(room, sensor, centre, radius, min(LONGEST, longest))
    order = np.count_nonzero(chains >= 0, axis=1)
    maps = room.maps(chains)
    # the direct leg is first, because its number of reflections is zero
    keys = np.round(np.column_stack([order, maps.reshape(-1, 12)]), 6)
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group = group.ravel()
    order_of, mirror, shift = order[first], maps[first][:, :, :3], maps[first][:, :, 3]
    nodes = max(room.table.frequencies_hz, frequencies_hz, key=len)
    basis = lagrange_basis(room.table.frequencies_hz, nodes)

    codes, code = np.unique(place * len(first) + group[which], return_inverse=True)
    code = code.ravel()
    u, g = codes // len(first), codes % len(first)
    length = np.linalg.norm(np.einsum("nij,nj->ni", mirror[g], sensor[u]) + shift[g] - centre[u], axis=1)
    bound = np.zeros(len(codes))
    np.maximum.at(bound, code, room.loudness_of(chains)[which])
    wanted = (bound * direct[u] >= EARLY * least * np.maximum(length - radius, 1e-9)) | (g == DIRECT)
    carried: dict[tuple[int, int], np.ndarray] = {}
    level = np.zeros(len(codes))  # bend of a field, relative to the undisturbed direct field
    fine = int(np.clip(np.ceil(2 * radius / GRID_M), 2, 4)) + 1
    for side in (2, fine):
        steps = np.stack(np.meshgrid(*[np.linspace(-radius, radius, side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        steps = np.concatenate([np.zeros((1, 3)), steps])
        rows = np.flatnonzero(wanted[code])
        kept, index = np.unique(code[rows], return_inverse=True)
        around = np.ascontiguousarray((centre[:, None] + steps).reshape(-1, 3))
        _lift(room.walls, room.usable, np.ascontiguousarray(sensor), np.ascontiguousarray(centre), radius, around)
        points = around.reshape(len(centre), -1, 3)[place[rows]].reshape(-1, 3)
        again = np.repeat(rows, len(steps))
        value = room_fields(room, chains, which[again], sensor, axes, place[again], points)
        total = np.zeros((len(kept), len(steps), value.shape[1]), complex)
        np.add.at(total, index.ravel(), value.reshape(len(rows), *total.shape[1:]))
        size = np.abs(total).max(axis=(1, 2), initial=0)
        strong = (size * direct[u[kept]] >= least * np.maximum(length[kept] - radius, 1e-9)) | (g[kept] == DIRECT)
        for row in np.flatnonzero(strong):
            carried[int(u[kept[row]]), int(g[kept[row]])] = (total[row, 1:] @ basis).reshape(side, side, side, -1)
        middle = np.abs(total[:, 0]).max(axis=1, initial=0)
        limit = np.maximum(LINEAR * middle, COARSE * length[kept] / direct[u[kept]])
        bent = np.abs(total[:, 1:].mean(axis=1) - total[:, 0]).max(axis=1, initial=0) > limit
        bent |= np.abs(total[:, 1:] - total[:, :1]).max(axis=(1, 2), initial=0) > np.maximum(middle, limit)
        if side > 2:
            bend = _bend(total[:, 1:].reshape(len(kept), side, side, side, value.shape[1]))
            bent = bend > np.maximum(limit, least * length[kept] / direct[u[kept]])  # weaker legs are dropped
            level[kept] = bend * direct[u[kept]] / length[kept]
        wanted[:] = False
        wanted[kept[strong & bent]] = True
    wanted &= radius <= SHARP_BALL_M
    sharp = np.zeros((len(places), len(first)))
    sharp[u[wanted], g[wanted]] = SHARP_M * np.sqrt(np.maximum(BENT / level[wanted], 1))
    members = {(int(u[n]), int(g[n])): which[code == n] for n in np.flatnonzero(wanted)}

    def exact(at: int, leg: int, points: np.ndarray) -> np.ndarray:
        points = points.copy()
        _lift(room.walls, room.usable, *(np.ascontiguousarray(ends[at : at + 1]) for ends in (sensor, centre)), radius, points)
        places = np.full(len(points), at)
        return sum(room_fields(room, chains, np.full(len(points), n), sensor, axes, places, points) for n in members[at, leg]) @ basis

    share = np.zeros((len(places), len(first)))
    for (i, leg), values in carried.items():
        at = mirror[leg] @ sensor[i] + shift[leg]
        share[i, leg] = np.abs(values).max() * direct[i] / max(float(np.linalg.norm(centre[i] - at)) - radius * (leg != DIRECT), radius)
    return Legs(order_of, mirror, shift, centre - radius, 2 * radius, nodes, carried, share, sharp, exact)


def _bend(field: np.ndarray) -> np.ndarray:
    """Return how much fields (G, n, n, n, Q) on grids differ from linear interpolation: the root mean square over the grid along the axis
    on which it is largest.
    """
    out = np.zeros(len(field))
    for axis in (1, 2, 3):
        bend = np.diff(field, 2, axis) / 2
        out = np.maximum(out, np.sqrt((np.abs(bend) ** 2).mean(axis=(1, 2, 3)).max(axis=1, initial=0)))
    return out


def found_once(room: FlatRoom, places: np.ndarray, axes: np.ndarray, radius: float, frequencies_hz: np.ndarray, *how: float) -> Legs:
    """Call `find`, with a cache of the last KEPT calls."""
    key = (id(room), places.tobytes(), axes.tobytes(), radius, frequencies_hz.tobytes(), *how)

    def make() -> tuple[FlatRoom, Legs]:
        return room, find(room, places, axes, radius, frequencies_hz, *how)  # pyright: ignore[reportArgumentType]

    return _kept.get(key, 1, make)[1]


def _chains(
    room: FlatRoom, sensor: np.ndarray, centre: np.ndarray, radius: float, longest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sequences of faces (K, longest), -1 beyond the last, and the pairs (N,), (N,) of a place and a sequence to evaluate.

    The sequences are those whose beams exist anywhere in the cell of the sensor. The first sequence is empty.
    """
    members = cells(sensor)
    per_cell = each(lambda places: room.chains(sensor[places[:SEEN]], longest), members)
    chains, index = np.unique(np.concatenate(per_cell), axis=0, return_inverse=True)
    of_cell = np.split(index.ravel(), np.cumsum([len(chain) for chain in per_cell])[:-1])
    rows = []
    for places, mine in zip(members, of_cell, strict=True):
        for place in places:
            close = np.ones(len(mine), bool)
            _near_mirrors(room.walls, chains[mine], sensor[place], centre[place], radius, close)
            rows.append(np.stack([np.full(close.sum(), place), mine[close]]))
    place, which = np.concatenate(rows, axis=1)
    order = np.argsort(place, kind="stable")
    return chains, place[order], which[order]


@compiled
def _near_mirrors(walls: Walls, chains: np.ndarray, sensor: np.ndarray, centre: np.ndarray, radius: float, out: np.ndarray) -> None:
    """Write which sequences of faces (K, C) can carry a line from the sensor to a ball, with a margin of BESIDE_M, to `out` (K,)."""
    faces, images = walls.faces, np.empty((chains.shape[1], 3))
    for k in range(len(chains)):
        m = np.count_nonzero(chains[k] >= 0)
        images_of(faces, sensor, chains[k, :m], images)
        target = moved(centre, ZERO, 1.0)
        for i in range(m - 1, -1, -1):
            p, behind = chains[k, i], vector(images, i)
            above = dot(target, faces.normal[p]) - faces.offset[p]
            below = dot(behind, faces.normal[p]) - faces.offset[p]
            # the mirror point of the lowest point of the ball, which lies nearer to the ball than that of its centre
            lowest = max(abs(above) - radius, 0.0) if i == m - 1 else abs(above)
            foot = moved(target, vector(faces.normal, p), math.copysign(lowest, above) - above)
            under = moved(behind, toward(behind, foot, 1.0), abs(below) / max(abs(below) + lowest, 1e-9))
            target = moved(behind, toward(behind, target, 1.0), abs(below) / max(abs(below) + abs(above), 1e-9))
            reach = walls.radius[p] + radius + BESIDE_M + distance(target, under)
            if (above * below >= 0 and abs(above) > radius) or distance(target, walls.centre[p]) > reach:
                out[k] = False


@compiled
def _lift(walls: Walls, usable: np.ndarray, sensor: np.ndarray, centre: np.ndarray, radius: float, points: np.ndarray) -> None:
    """Move test points around the object (in place) that lie behind a face near the object to the front of the face. The object cannot be
    behind the face, so the field there is not needed.

    The front is the side of the object's centre, or the sensor's side if the centre is close to the face.

    usable: (P,) bool. sensor, centre: (U, 3). points: (U n, 3), n for each place.
    """
    faces, each = walls.faces, len(points) // len(centre)
    for u in range(len(centre)):
        for p in range(len(faces.offset)):
            height = dot(centre[u], faces.normal[p]) - faces.offset[p]
            if not usable[p] or abs(height) > 2 * radius or distance(centre[u], walls.centre[p]) > walls.radius[p] + 2 * radius:
                continue
            front = height if abs(height) > ROUNDED * radius else dot(sensor[u], faces.normal[p]) - faces.offset[p]
            side = 1.0 if front > 0 else -1.0
            for n in range(u * each, (u + 1) * each):
                missing = ABOVE_M - side * (dot(points[n], faces.normal[p]) - faces.offset[p])
                if missing > 0:
                    moved = points[n] + missing * side * faces.normal[p]
                    if contains(faces, p, moved, 0.0):
                        points[n] = moved


def room_fields(
    room: FlatRoom, chains: np.ndarray, which: np.ndarray, sensor: np.ndarray, axes: np.ndarray, place: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Return the fields (N, Q) of N lines over sequences of faces, relative to undisturbed lines from the sensor's images.

    Args:
        chains: (K, C) faces, -1 beyond the last. which: (N,) sequence of each line. sensor, axes: (U, 3). place: (N,) index of the sensor.
        points: (N, 3) other ends of the lines.
    """
    out = np.zeros((len(which), len(room.table.frequencies_hz)), complex)
    met = np.full((len(which), chains.shape[1] + 2, 3), np.nan)
    arguments = (
        chains.shape[1], out.shape[1], len(room.table.opaque), room.walls, room.borders, room.edges, room.table.opaque & ~room.outlined,
        NUDGE / room.wavenumber, *map(np.ascontiguousarray, (chains, which, sensor, axes, place, points)),
    )  # fmt: skip
    shared_out(_evaluate, len(which), *arguments, out, met)
    last = np.count_nonzero(chains >= 0, axis=1)[which] + 1
    end = met[np.arange(len(met)), last].copy()
    met[np.arange(len(met)), last] = np.nan
    for body in room.bodies:
        rows = np.flatnonzero(out.any(axis=1))
        out[rows] *= factors(body, sensor[place[rows]], met[rows, 1:-1], True, room.wavenumber, end[rows])[:, None]
    return out


@compiled
def _evaluate(begin, stop, longest, nodes, surfaces, *arguments) -> None:
    """Compute the lines `begin` to `stop` - 1 of `room_fields`. The loop of `_lines` creates no arrays, so that it counts no references."""
    memory = np.empty((longest + 1, 3)), np.empty((nodes, 3), np.complex128), np.empty(MAX_PANES, np.int64), np.empty(surfaces, np.bool_)
    _lines(memory, begin, stop, *arguments)


@innermost
def _lines(
    memory: tuple, begin: int, stop: int, walls: Walls, borders: tuple, edges: Hierarchy, hides: np.ndarray, nudge: np.ndarray,
    chains: np.ndarray, which: np.ndarray, sensor: np.ndarray, axes: np.ndarray, place: np.ndarray, points: np.ndarray, out: np.ndarray,
    ways: np.ndarray,
) -> None:  # fmt: skip
    """Write the fields of the lines `begin` to `stop` - 1, without the shadows of `FlatRoom.bodies`, and their points `ways` (N, C + 2, 3).
    hides: (surfaces,) whether a surface blocks and is not part of these bodies. The other arguments are those of `room_fields`.
    """
    (images, field, pane_ids, others), faces, wavenumber = memory, walls.faces, walls.wavenumber
    for n in range(begin, stop):
        m = 0
        while m < chains.shape[1] and chains[which[n], m] >= 0:
            m += 1
        chain, met = chains[which[n], :m], ways[n]
        source, end = moved(vector(sensor, place[n]), nudge, 1.0), vector(points, n)
        put(images, 0, source)
        images_of(faces, source, chain, images[1:])
        if m:  # behind the last face, use the field just above the face, so that the field can be interpolated
            p = chain[m - 1]
            side = 1.0 if dot(images[m - 1], faces.normal[p]) > faces.offset[p] else -1.0
            height = side * (dot(end, faces.normal[p]) - faces.offset[p])
            if height < ABOVE_M:
                end = moved(end, vector(faces.normal, p), (ABOVE_M - height) * side)
        put(met, 0, source)
        put(met, m + 1, end)
        # points of reflection, from the last face to the first, and the factor of each face as a mirror of finite size
        target = end
        total = 1.0 + 0j
        for i in range(m - 1, -1, -1):
            p = chain[i]
            above = dot(target, faces.normal[p]) - faces.offset[p]
            below = dot(images[i + 1], faces.normal[p]) - faces.offset[p]
            if above * below >= 0 or min(abs(above), abs(below)) < 1e-9:
                total = 0j
                break
            # the source's image lies behind mirror p, and `back`, the end mirrored over the later faces, in front of it
            back = image(faces, end, chain[i + 1 :][::-1], 1.0)
            at = moved(images[i + 1], toward(images[i + 1], target, 1.0), below / (below - above))
            put(met, i + 1, at)
            inside = 1.0 if contains(faces, p, at, 0.0) else 0.0
            total *= _mirror(borders, p, at, inside, vector(images, i + 1), back, wavenumber)
            if abs(total) < MIRRORED:
                total = 0j
                break
            target = at
        if total == 0:
            continue
        # factor of each part of the leg past the faces beside it
        before, rest = 0.0, distance(end, images[m])
        for i in range(m + 1):
            part = distance(met[i + 1], met[i])
            if part < 1e-9:
                continue
            line = line_of(
                vector(met, i), vector(met, i + 1), before, rest - before - part if i < m else 0.0,
                vector(faces.normal, chain[i - 1]) if i else ZERO, vector(faces.normal, chain[i]) if i < m else ZERO,
            )  # fmt: skip
            mirrors = chain[0] if m else -1, chain[m - 1] if m else -1
            total *= past_faces(faces, edges, walls.tree, hides, line, wavenumber, mirrors[0], mirrors[1], pane_ids, others)
            before += part
            if abs(total) < MIRRORED:
                break
        if abs(total) < MIRRORED:
            continue
        # polarisation: the field along the leg with its reflections and panes, relative to that of the unfolded antenna
        way = toward(images[m], end, rest)
        there, axis = image(faces, way, chain[::-1], 0.0), vector(axes, place[n])
        polarised(field, transverse(axis, there))
        travelled(walls, field, there, chain, source, met[1 : m + 1], end, pane_ids)
        unit = transverse(image(faces, axis, chain, 0.0), way)
        for k in range(len(field)):
            level = field[k, 0] * unit[0] + field[k, 1] * unit[1] + field[k, 2] * unit[2]
            out[n, k] = level.conjugate() * total


@innermost
def _mirror(borders: tuple, p: int, at: Vector, inside: float, source: Vector, receiver: Vector, wavenumber: float) -> complex:
    """Return the factor of face `p` as a mirror for exp(+j k L). `at` is the point of reflection, `source` the image behind the face."""
    first, starts, along, length, into, sector = borders
    total = complex(inside, 0.0)
    for i in range(first[p], first[p + 1]):
        start = vector(starts, i)
        if dot(toward(start, source, 1.0), vector(sector, i)) > 0:
            continue  # the face is lit on the side that is outside the open sector of this edge
        part, _ = edge_part(start, vector(along, i), length[i], source, receiver, wavenumber, 4 * REACH)
        total -= part if dot(toward(start, at, 1.0), vector(into, i)) >= 0 else -part
    return total
