"""Panel images: specular paths over flat panels, each with the Fresnel factor of what the panels leave open and furniture covers.

A sequence of panels p_1 .. p_m mirrors the source to its image S_m; the path to a receiver R is the straight line S_m R. Every panel, and
everything that stands in the way of one of the m + 1 legs, is unfolded by the mirrors after it and projected from S_m onto the last
panel's plane (what covers the last leg, from R): the aperture there is the common part of the panels' projections less the
obstacles', and `aperture.polygon_factor` of its convex pieces multiplies the image's field. That is what tubes add up to when they are
fine enough, but smooth in the pose and free of any grid. A corner of two walls comes out right only because the apertures are
intersected: each order of the two contributes its half, where a product of the factors would give two quarters.

Fields: along a path E is mirrored by TE/TM coefficients in double precision, amplitude(f) = lambda/(4 pi L) P . E_m F.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.aperture import MAX_CORNERS, MAX_PIECES, clip_space, intersect, orient, polygon_factor, subtract
from radartwin.simulation.compiled import compiled, shared_out
from radartwin.simulation.panels import MAX_SIDES, Panels
from radartwin.simulation.reflection_table import COSINES, ReflectionTable

BEHIND = 1e-6  # metres within which a point lies on a plane
# The factor is taken this far beside the receiver, in units of 1/k: seen from the sensor itself, a corner's image lies exactly behind its
# edge, where rounding would decide between inside and outside. It moves the factor by a thousandth.
NUDGE = 0.05 * np.array([0.74, 0.53, 0.41])
SUPPORTS = 24  # points that stand for a curved obstacle


@dataclass(frozen=True)
class Sequences:
    """S sequences of panels, prepared for evaluation.

    Attributes:
        chain: (S,) index of the panel sequence in what was asked for, which may have several choices of sides.
        mirror: (S, 3, 3), shift: (S, 3): the image of a point x is mirror x + shift.
        order: (S,) panels in each. panel: (S, M) indices; side: (S, M) +-1, the side of each panel's normal the path is on.
        first, last: (S, M + 1) range of each leg in `blocker`; blocker: (B,) obstacle indices.
    """

    chain: np.ndarray
    mirror: np.ndarray
    shift: np.ndarray
    order: np.ndarray
    panel: np.ndarray
    side: np.ndarray
    first: np.ndarray
    last: np.ndarray
    blocker: np.ndarray

    def __len__(self) -> int:
        return len(self.order)


@dataclass(frozen=True)
class Obstacles:
    """What can stand in the way: every panel; then convex solids and curved things, each as the hull of its outermost points.

    Attributes:
        points: (O, SUPPORTS, 3); count: (O,). normal, offset: of the plane of a panel; hull: (O,) true for solids and curved things.
        body: (O,) the solid a panel bounds or a hull is; -1 for none.
    """

    points: np.ndarray
    count: np.ndarray
    normal: np.ndarray
    offset: np.ndarray
    hull: np.ndarray
    body: np.ndarray


def obstacles(panels: Panels, others: Sequence[np.ndarray] = (), present: np.ndarray | None = None) -> Obstacles:
    """Panels (those `present`, (P,), or all), the solids they bound, and curved things given by their points (N, 3)."""
    present = np.ones(len(panels), bool) if present is None else present
    solids = np.unique(panels.body[(panels.body >= 0) & present])
    used = np.arange(MAX_SIDES) < panels.count[:, None]
    clouds = [panels.corners[panels.body == solid][used[panels.body == solid]] for solid in solids] + list(others)
    first, total = len(panels), len(panels) + len(clouds)
    points, count = np.zeros((total, SUPPORTS, 3)), np.zeros(total, int)
    points[:first, :MAX_SIDES] = panels.corners
    count[:first] = np.where(present, panels.count, 0)
    for i, cloud in enumerate(clouds, first):
        outermost = _supports(cloud)
        points[i, : len(outermost)] = outermost
        count[i] = len(outermost)
    normal, offset = np.zeros((total, 3)), np.zeros(total)
    normal[:first], offset[:first] = panels.normal, panels.offset
    return Obstacles(
        points, count, normal, offset, np.arange(total) >= first, np.concatenate([panels.body, solids, np.full(len(others), -1)])
    )


def _supports(points: np.ndarray) -> np.ndarray:
    """At most SUPPORTS points of a cloud: all, or the farthest out in directions spread evenly over the sphere."""
    points = np.unique(np.round(points, 7), axis=0)
    if len(points) <= SUPPORTS:
        return points
    index = np.arange(SUPPORTS) + 0.5
    polar, turn = np.arccos(1 - 2 * index / SUPPORTS), np.pi * (1 + 5**0.5) * index
    directions = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    return points[np.unique(np.argmax(points @ directions, axis=0))]


def prepare(panels: Panels, things: Obstacles, chains: Sequence[tuple[int, ...]], sources: np.ndarray, receivers: np.ndarray) -> Sequences:
    """Sides and possible obstacles of panel sequences.

    Args:
        chains: panel indices, first met first.
        sources, receivers: (N, 3) points the ends of a path may be at; only their extent is used.
    """
    ends = [_box(sources), _box(receivers)]
    rows = [(chain, sides, index) for index, chain in enumerate(chains) for sides in _sides(panels, chain, ends)]
    longest = max((len(chain) for chain, *_ in rows), default=1)
    order = np.array([len(chain) for chain, *_ in rows], int)
    mirror, shift = np.tile(np.eye(3), (len(rows), 1, 1)), np.zeros((len(rows), 3))
    panel, side = np.zeros((len(rows), longest), int), np.ones((len(rows), longest))
    first, last = np.zeros((len(rows), longest + 1), int), np.zeros((len(rows), longest + 1), int)
    blocker: list[int] = []
    known: dict[tuple[object, ...], np.ndarray] = {}
    for i, (chain, sides, _) in enumerate(rows):
        for p in chain:
            flip = np.eye(3) - 2 * np.outer(panels.normal[p], panels.normal[p])
            mirror[i], shift[i] = flip @ mirror[i], flip @ shift[i] + 2 * panels.offset[p] * panels.normal[p]
        panel[i, : len(chain)], side[i, : len(chain)] = chain, sides
        stops = [("source",), *zip(chain, sides, strict=True), ("receiver",)]
        for leg in range(len(chain) + 1):
            key = (stops[leg], stops[leg + 1])
            if key not in known:
                known[key] = _between(panels, things, stops[leg], stops[leg + 1], ends)
            first[i, leg] = len(blocker)
            blocker.extend(known[key])
            last[i, leg] = len(blocker)
    return Sequences(np.array([index for *_, index in rows], int), mirror, shift, order, panel, side, first, last, np.array(blocker, int))


def _box(points: np.ndarray) -> np.ndarray:
    """(8, 3) corners of a bounding box."""
    low, high = points.min(0), points.max(0)
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _polygon(panels: Panels, index: int) -> np.ndarray:
    return panels.corners[index, : panels.count[index]]


def _sides(panels: Panels, chain: tuple[int, ...], ends: list[np.ndarray]) -> list[tuple[int, ...]]:
    """Every choice of sides on which each panel has its neighbours (or the ends' box) before it."""
    stops = [ends[0], *(_polygon(panels, p) for p in chain), ends[1]]
    choices: list[list[int]] = []
    for i, p in enumerate(chain, 1):
        possible = []
        for side in (1, -1):
            if side < 0 and panels.body[p] >= 0:
                continue
            height = [side * (stops[j] @ panels.normal[p] - panels.offset[p]) for j in (i - 1, i + 1)]
            if all(h.max() > BEHIND for h in height):
                possible.append(side)
        choices.append(possible)
    out: list[tuple[int, ...]] = [()]
    for possible in choices:
        out = [(*before, side) for before in out for side in possible]
    return out


def _between(panels: Panels, things: Obstacles, start: tuple, stop: tuple, ends: list[np.ndarray]) -> np.ndarray:
    """Obstacles that can touch the leg from one stop, ("source",), (panel, side) or ("receiver",), to the next."""
    used = np.arange(SUPPORTS) < things.count[:, None]
    keep, whole = np.ones(len(things.count), bool), np.ones(len(things.count), bool)
    between = []
    for stop_, end in ((start, ends[0]), (stop, ends[1])):
        if len(stop_) == 1:
            between.append(end)
            continue
        index, side = stop_
        between.append(_polygon(panels, index))
        keep[index] = False
        if panels.body[index] >= 0:  # a convex solid is never between its own face and what that face sees
            keep &= things.body != panels.body[index]
        height = side * (things.points @ panels.normal[index] - panels.offset[index])
        keep &= np.where(used, height, -np.inf).max(axis=1) > BEHIND
        whole &= np.where(used, height, np.inf).min(axis=1) > -BEHIND
    height = np.concatenate(between) @ things.normal.T - things.offset
    keep &= things.hull | ((height.max(axis=0) > BEHIND) & (height.min(axis=0) < -BEHIND))
    # a solid stands for its faces where no panel's plane cuts it, and its faces for the solid where one does
    solid = things.hull & (things.body >= 0)
    cut = np.isin(things.body, things.body[solid & ~whole]) & (things.body >= 0)
    keep &= np.where(solid, ~cut, (things.body < 0) | cut)
    return np.flatnonzero(keep)


@dataclass(frozen=True)
class Images:
    """Fields of N (sequence, end point) pairs.

    Attributes:
        factor: (N,) complex Fresnel factor, 0 where there is no path. length_m: (N,).
        departure, arrival: (N, 3) unit, from source and receiver towards the path, world frame.
        field: (N, Q, 3) complex, the unit field along the projected axis after all reflections, exp(+j omega t) coefficients.
    """

    factor: np.ndarray
    length_m: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray
    field: np.ndarray


def evaluate(
    panels: Panels,
    things: Obstacles,
    sequences: Sequences,
    table: ReflectionTable,
    which: np.ndarray,
    source: np.ndarray,
    axis: np.ndarray,
    receiver: np.ndarray,
    least: np.ndarray | float = 0.0,
) -> Images:
    """Images over chosen sequences.

    Args:
        which: (N,) sequence of each path wanted. source, receiver: (N, 3) its ends in the world; axis: (N, 3) the source's antenna axis.
        least: of |field| |factor|/length, per path or for all; what is below it before any obstacle is left out.
    """
    least = np.broadcast_to(np.asarray(least, float), (len(which),))
    wavenumber = 2 * np.pi * float(table.frequencies_hz.mean()) / SPEED_OF_LIGHT
    n, q = len(which), len(table.frequencies_hz)
    factor, length = np.zeros(n, complex), np.zeros(n)
    departure, arrival, field = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, q, 3), complex)
    shared_out(
        _evaluate, n,
        panels.corners, panels.count, panels.normal, panels.offset, panels.surface,
        things.points, things.count, things.hull,
        sequences.order, sequences.panel, sequences.side, sequences.first, sequences.last, sequences.blocker,
        table.te, table.tm, wavenumber, NUDGE / wavenumber, which, source, axis, receiver,
        least, factor, length, departure, arrival, field, pieces=16,
    )  # fmt: skip
    return Images(factor, length, departure, arrival, field)


@compiled
def _mirror(points: np.ndarray, count: int, normal: np.ndarray, offset: float) -> None:
    """Mirror points (count, 3) in a plane, in place."""
    for i in range(count):
        height = points[i, 0] * normal[0] + points[i, 1] * normal[1] + points[i, 2] * normal[2] - offset
        for k in range(3):
            points[i, k] -= 2 * height * normal[k]


@compiled
def _project(
    points: np.ndarray,
    count: int,
    centre: np.ndarray,
    depth: float,
    normal: np.ndarray,
    origin: np.ndarray,
    u_axis: np.ndarray,
    v_axis: np.ndarray,
    spare: np.ndarray,
    out: np.ndarray,
) -> int:
    """Polygon (count, 3) seen from `centre` on the plane `depth` before it along `normal`: (n, 2) in `out`, and n.

    Only what lies between the two counts; it is cut a thousandth of the depth before the centre.
    """
    at = centre[0] * normal[0] + centre[1] * normal[1] + centre[2] * normal[2]
    kept = clip_space(points, count, normal, at + 1e-3 * depth, spare)
    if kept == 0:
        return 0
    kept = clip_space(spare, kept, -normal, -(at + depth * (1 + 1e-9) + BEHIND), points)
    for i in range(kept):
        height = points[i, 0] * normal[0] + points[i, 1] * normal[1] + points[i, 2] * normal[2] - at
        share = depth / height
        x, y = 0.0, 0.0
        for k in range(3):
            place = centre[k] + (points[i, k] - centre[k]) * share - origin[k]
            x += place * u_axis[k]
            y += place * v_axis[k]
        out[i, 0], out[i, 1] = x, y
    return kept


@compiled
def _hull(points: np.ndarray, count: int, out: np.ndarray) -> int:
    """Convex hull of points (count, 2), counter-clockwise in `out` (MAX_CORNERS, 2), and its size."""
    start = 0
    for i in range(1, count):
        if points[i, 0] < points[start, 0] or (points[i, 0] == points[start, 0] and points[i, 1] < points[start, 1]):
            start = i
    kept, here = 0, start
    while kept < MAX_CORNERS:
        out[kept] = points[here]
        kept += 1
        ahead = (here + 1) % count
        for i in range(count):
            cross = (points[ahead, 0] - points[here, 0]) * (points[i, 1] - points[here, 1]) - (points[ahead, 1] - points[here, 1]) * (
                points[i, 0] - points[here, 0]
            )
            if cross < 0:
                ahead = i
        here = ahead
        if here == start:
            break
    return kept


@compiled
def _reflect(
    field: np.ndarray, direction: np.ndarray, mirrored: np.ndarray, normal: np.ndarray, cosine: float, te: np.ndarray, tm: np.ndarray
) -> None:
    """Mirror the field (Q, 3) at a plane, coefficients (COSINES, Q) linear in the cosine, in place."""
    s = np.cross(direction, normal)
    size = math_norm(s)
    if size < 1e-7:
        s = np.cross(normal, np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0]))
        size = math_norm(s)
    s = s / size
    p_in, p_out = np.cross(direction, s), np.cross(mirrored, s)
    x = min(max(cosine, 0.0), 1.0) * (COSINES - 1)
    low = min(int(x), COSINES - 2)
    share = x - low
    for q in range(field.shape[0]):
        along_s, along_p = 0j, 0j
        for k in range(3):
            along_s += field[q, k] * s[k]
            along_p += field[q, k] * p_in[k]
        along_s *= te[low, q] * (1 - share) + te[low + 1, q] * share
        along_p *= tm[low, q] * (1 - share) + tm[low + 1, q] * share
        for k in range(3):
            field[q, k] = along_s * s[k] + along_p * p_out[k]


def across(axis: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """(N, 3) normalised parts of axes (N, 3) across directions (N, 3), as `transverse`."""
    return np.array([transverse(a, d) for a, d in zip(axis, direction, strict=True)]).reshape(-1, 3)


@compiled
def transverse(axis: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Normalised part of an axis across a direction. Along the axis itself it has no limit, but what an antenna sends and receives there
    has: any one direction across, the same at both ends."""
    across = axis - direction * np.dot(axis, direction)
    size = math_norm(across)
    if size < 1e-6:
        across = np.cross(axis, np.array([0.6, 0.0, 0.8]) if abs(axis[2]) < 0.9 else np.array([0.8, 0.6, 0.0]))
        size = math_norm(across)
    return across / size


@compiled
def math_norm(x: np.ndarray) -> float:
    return np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@compiled
def _evaluate(
    start, stop,
    corners, count, normal, offset, surface,
    o_points, o_count, o_hull,
    order, panel, side, first, last, blocker,
    te, tm, wavenumber, nudge, which, source, axis, receiver,
    least, factor, length, departure, arrival, field,
):  # fmt: skip
    for n in range(start, stop):
        s = which[n]
        m = order[s]
        image = source[n].copy()
        lit = True
        for i in range(m):  # images; each panel must be met from its side
            p = panel[s, i]
            height = image[0] * normal[p, 0] + image[1] * normal[p, 1] + image[2] * normal[p, 2] - offset[p]
            if side[s, i] * height <= BEHIND:
                lit = False
                break
            for k in range(3):
                image[k] -= 2 * height * normal[p, k]
        if not lit:
            continue
        p = panel[s, m - 1]
        facing = side[s, m - 1] * normal[p]  # towards the receiver
        depth_r = side[s, m - 1] * (np.dot(receiver[n], normal[p]) - offset[p])
        if depth_r <= BEHIND:
            continue
        depth_s = -side[s, m - 1] * (np.dot(image, normal[p]) - offset[p])
        way = receiver[n] - image
        total = math_norm(way)
        along = way / total
        beside = receiver[n] + nudge
        depth_b = side[s, m - 1] * (np.dot(beside, normal[p]) - offset[p])
        # directions, last to first, and the incidence at each panel
        back = along.copy()
        directions = np.zeros((m + 1, 3))
        directions[m] = back
        for i in range(m - 1, -1, -1):
            p = panel[s, i]
            cosine = np.dot(back, normal[p]) * side[s, i]
            if cosine <= 1e-6:
                lit = False
                break
            for k in range(3):
                back[k] -= 2 * np.dot(directions[i + 1], normal[p]) * normal[p, k]
            directions[i] = back
        if not lit:
            continue
        origin = image + (beside - image) * (depth_s / (depth_s + depth_b))
        u_axis = np.cross(facing, np.array([0.0, 0.0, 1.0]) if abs(facing[2]) < 0.9 else np.array([1.0, 0.0, 0.0]))
        u_axis = u_axis / math_norm(u_axis)
        v_axis = np.cross(facing, u_axis)

        space, spare3 = np.zeros((MAX_CORNERS, 3)), np.zeros((MAX_CORNERS, 3))
        flat, spare2 = np.zeros((MAX_CORNERS, 2)), np.zeros((2, MAX_CORNERS, 2))
        pieces, counts = np.zeros((MAX_PIECES, MAX_CORNERS, 2)), np.zeros(MAX_PIECES, np.int64)
        number = 0
        for i in range(m - 1, -1, -1):  # the aperture: common part of all panels
            p = panel[s, i]
            c = count[p]
            space[:c] = corners[p, :c]
            for j in (i - 1, i + 1):  # before the panels it sends to and receives from
                if 0 <= j < m:
                    o = panel[s, j]
                    c = clip_space(space, c, side[s, j] * normal[o], side[s, j] * offset[o], spare3)
                    space[:c] = spare3[:c]
                    if c == 0:
                        break
            if c:
                for j in range(i + 1, m):
                    _mirror(space, c, normal[panel[s, j]], offset[panel[s, j]])
                c = _project(space, c, image, depth_s, facing, origin, u_axis, v_axis, spare3, flat)
            if c == 0:
                number = 0
                break
            if orient(flat, c) < 1e-12:
                number = 0
                break
            if i == m - 1:
                pieces[0, :c] = flat[:c]
                counts[0] = c
                number = 1
            else:
                counts[0] = intersect(pieces[0], counts[0], flat, c, spare2[0])
                if counts[0] == 0:
                    number = 0
                    break
        if number == 0:
            continue
        across = transverse(axis[n], directions[0])
        for q in range(field.shape[1]):
            for k in range(3):
                field[n, q, k] = across[k]
        for i in range(m):
            p = panel[s, i]
            cosine = -np.dot(directions[i], normal[p]) * side[s, i]
            _reflect(field[n], directions[i], directions[i + 1], normal[p], cosine, te[surface[p]], tm[surface[p]])
        strongest = 0.0
        for q in range(field.shape[1]):
            power = 0.0
            for k in range(3):
                power += field[n, q, k].real ** 2 + field[n, q, k].imag ** 2
            strongest = max(strongest, power)
        if strongest <= (least[n] * total) ** 2:
            continue
        f = polygon_factor(pieces[0], counts[0], origin, u_axis, v_axis, image, beside, math_norm(beside - image), wavenumber)
        if strongest * (f.real * f.real + f.imag * f.imag) <= (least[n] * total) ** 2:
            continue
        whole = True
        for leg in range(m + 1):  # less what stands in the way
            for b in range(first[s, leg], last[s, leg]):
                o = blocker[b]
                c = o_count[o]
                space[:c] = o_points[o, :c]
                if not o_hull[o]:
                    for j in (leg - 1, leg):
                        if 0 <= j < m:
                            q = panel[s, j]
                            c = clip_space(space, c, side[s, j] * normal[q], side[s, j] * offset[q] + BEHIND, spare3)
                            space[:c] = spare3[:c]
                            if c == 0:
                                break
                    if c == 0:
                        continue
                if leg < m:
                    for j in range(leg, m):
                        _mirror(space, c, normal[panel[s, j]], offset[panel[s, j]])
                    c = _project(space, c, image, depth_s, facing, origin, u_axis, v_axis, spare3, flat)
                else:
                    c = _project(space, c, beside, depth_b, -facing, origin, u_axis, v_axis, spare3, flat)
                if c < 3:
                    continue
                if o_hull[o]:
                    c = _hull(flat, c, spare2[0])
                    flat[:c] = spare2[0, :c]
                    if c < 3:
                        continue
                if orient(flat, c) < 1e-12:
                    continue
                whole = False
                number = subtract(pieces, counts, number, flat, c, spare2)
                if number == 0:
                    break
            if number == 0:
                break
        if number == 0:
            continue
        if not whole:
            f = 0j
            for i in range(number):
                f += polygon_factor(pieces[i], counts[i], origin, u_axis, v_axis, image, beside, math_norm(beside - image), wavenumber)
        factor[n] = f
        length[n] = total
        departure[n] = directions[0]
        arrival[n] = -along
