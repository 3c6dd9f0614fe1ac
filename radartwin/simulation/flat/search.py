"""Search for the sequences of faces and edges that can carry a path, seen from any place of a cell, which is a ball of sensor positions.

Beams start at the cell. A beam is the convex part of a face that the image of the cell lights, together with this image; the face mirrors
the beam, and the faces beyond it clip the mirrored beam. The search follows a beam only if a path over it can be as strong as
`Cell.least`. A path that reflects at the faces of a beam can reach each edge inside the beam. Two such paths to one edge, out and back,
give a path with one diffraction. Two edges that see each other, directly or over one face, give a path with two diffractions.

All geometric tests and bounds hold for the whole ball: the planes that bound a beam touch the ball on its far side, distances are shortened
by the radius, and edges within reach of a shadow boundary count as lying on it. Only visibility, and which edges a beam reaches, are tested
at single places of the cell. Which of the sequences exist within a margin around one place, `field.evaluate` tells.
"""

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, cores, each, fitted, innermost
from radartwin.simulation.flat.convex import clip, copy, twice_area
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.flat.field import Walls, beside, edge_point, grazed_face, keller, mirrored, open_angle, panes_on, reflect_points
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Point, Vector, build, crossed
from radartwin.simulation.flat.vectors import ZERO, cross, distance, dot, moved, norm, put, toward, transverse, vector

SPARE = 16  # a beam can have this many corners more than the outlines of the faces; further corners are left out
SAMPLES = (0.02, 0.25, 0.5, 0.75, 0.98)  # places along the lit part of an edge, relative to its length, where its visibility is tested
BEAMS_AT_ONCE = 100_000  # number of beams whose sequences are listed at once; limits memory
FEW = 3  # number of steps to estimate the two points of a double diffraction
# Smallest ratio of the bound of a double diffraction to its field, as assumed by the search. The actual ratio is at least 8 for almost all
# paths of the furnished laboratory and squash court. Compared with an assumed ratio of 1, the signal of these rooms changes by at most
# 1.1e-3.
BOUND_OF_DOUBLES = 16.0
PLACES = (0.5, 0.1, 0.9)  # places along two edges, relative to their lengths, between which their view of each other is tested
CONE = 8  # number of planes that bound a beam over a face that is seen edge-on
EQUAL_M = 1e-9  # corners of a lit polygon that are closer than this are one corner, whose side gives no plane
BOTH = 2.25  # an edge changes a field by a factor of at most 1.5, and a path has at most two edges
TINY_M2 = 1e-6  # twice the smallest area of a beam on a face


class Cell(NamedTuple):
    """Hold a ball of sensor positions, and which paths of its sensors matter.

    Attributes:
        places: (S, 3) the centre and other places, between which visibility is tested. radius: of the ball around the centre, metres.
        front: (4,) plane behind which the sensor has no antenna gain, as unit normal and offset; zeros if there is none.
        least: weakest field of a path that matters, in 1/m.
    """

    places: np.ndarray
    radius: float
    front: np.ndarray
    least: float


class Beams(NamedTuple):
    """Hold N beams, ordered by their number of reflections. Beam 0 has no reflection and starts at the sensor.

    Attributes:
        chain: (N, C) faces. order: (N,) number of reflections. image: (N, 3) of the sensor. polygon: (N, M, 3), corners: (N,).
        seen: (N, S) whether the beam of each of the places of the cell alone lights a part of the last face.
        strength: (N,) largest field at one metre, without antenna gain. passed: (N,) largest transmission of the panes on the way.
    """

    chain: np.ndarray
    order: np.ndarray
    image: np.ndarray
    polygon: np.ndarray
    corners: np.ndarray
    seen: np.ndarray
    strength: np.ndarray
    passed: np.ndarray


class Ends(NamedTuple):
    """Hold what can end a path after its last beam: D faces and the edges that the cell sees, and the images (D, 3) of its centre.

    Attributes:
        strength: (D,) largest field at one metre of the beam of each face, falling.
        edges: their labels are the numbers of the edges. through: (E,) largest transmission to each edge of the room.
        every: whether beams that meet none of these are kept, too.
    """

    face: np.ndarray
    image: np.ndarray
    strength: np.ndarray
    edges: Hierarchy
    through: np.ndarray
    every: bool


@innermost
def beam_planes(
    faces: Faces, last: int, at: Vector, radius: float, polygon: np.ndarray, count: int, front: np.ndarray, out: np.ndarray
) -> int:
    """Write the planes that bound a beam, as unit normals that point inwards and offsets (count, 4); returns their number.

    The first plane is that of the beam's last face. The others run through the sides of its polygon and touch the far side of the ball
    around the image `at`. The beam of the cell itself is bounded by the plane `front`. A beam whose cell is on both sides of the last face
    has the bounds of `_cone`.
    """
    if last < 0:
        for k in range(4):
            out[0, k] = front[k]
        return 1 if front[0] != 0 or front[1] != 0 or front[2] != 0 else 0
    normal = vector(faces.normal, last)
    height = dot(at, normal) - faces.offset[last]
    if abs(height) <= radius:
        return _cone(at, radius, polygon, count, out)
    side = -1.0 if height > 0 else 1.0
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = side * normal[0], side * normal[1], side * normal[2], side * faces.offset[last]
    middle, number = middle_of(polygon, count), 1
    for i in range(count):
        a, b = vector(polygon, i), vector(polygon, (i + 1) % count)
        length = distance(a, b)
        if length < EQUAL_M:
            continue
        normal = cross(toward(at, a, 1.0), toward(at, b, 1.0))
        side = 1 / max(norm(normal), 1e-30)
        if dot(normal, middle) < dot(normal, at):
            side = -side
        inwards = side * normal[0], side * normal[1], side * normal[2]
        # turn the plane about the side of the polygon until it touches the ball: by the angle under which the side sees the radius
        way = toward(a, b, length)
        foot = moved(a, way, dot(toward(a, at, 1.0), way))
        away = distance(at, foot)
        sine = min(radius / max(away, 1e-30), 1.0)
        cosine = math.sqrt(1 - sine * sine)
        back = toward(foot, at, max(away, 1e-30))
        for k in range(3):
            out[number, k] = cosine * inwards[k] - sine * back[k]
        out[number, 3] = dot(out[number], a)
        number += 1
    return number


@innermost
def _cone(at: Vector, radius: float, polygon: np.ndarray, count: int, out: np.ndarray) -> int:
    """Write CONE planes that bound all rays from a ball around `at` through a ball around a polygon, and touch both; returns their number.
    It is 0 if the balls overlap.
    """
    middle = middle_of(polygon, count)
    size, away = _size(polygon, count, middle), distance(at, middle)
    if away <= radius + size:
        return 0
    axis = toward(at, middle, away)
    across = transverse(axis, axis)
    up, sine = cross(axis, across), (radius + size) / away
    for i in range(CONE):
        angle = 2 * math.pi * i / CONE
        outwards = moved(moved(ZERO, across, math.cos(angle)), up, math.sin(angle))
        put(out, i, moved(moved(ZERO, axis, sine), outwards, -math.sqrt(1 - sine * sine)))
        out[i, 3] = dot(out[i], middle) - size
    return CONE


@innermost
def middle_of(polygon: np.ndarray, count: int) -> Vector:
    """Return the mean of the corners of a polygon."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(count):
        x, y, z = x + polygon[i, 0], y + polygon[i, 1], z + polygon[i, 2]
    return x / count, y / count, z / count


@innermost
def _size(polygon: np.ndarray, count: int, middle: Vector) -> float:
    """Return the largest distance of a polygon's corners from its middle."""
    size = 0.0
    for i in range(count):
        size = max(size, distance(middle, vector(polygon, i)))
    return size


@innermost
def _level(plane: np.ndarray, i: int, x: Vector) -> float:
    """Return the height of a point over plane `i` of (count, 4)."""
    return plane[i, 0] * x[0] + plane[i, 1] * x[1] + plane[i, 2] * x[2] - plane[i, 3]


@innermost
def part_inside(planes: np.ndarray, count: int, start: Vector, along: Vector, length: float) -> tuple[float, float]:
    """Return the first and the last place in metres of the part of an edge before all planes (count, 4). Without such a part, the first
    place is not before the last one.
    """
    low, high, end = 0.0, length, moved(start, along, length)
    for i in range(count):
        first, second = _level(planes, i, start), _level(planes, i, end)
        if first < 0 and second < 0:
            high = -1.0
        elif first < 0:
            low = max(low, length * first / (first - second))
        elif second < 0:
            high = min(high, length * first / (first - second))
        if low >= high:
            break
    return low, high


@innermost
def _within(planes: np.ndarray, count: int, x: Vector, radius: float) -> bool:
    """Return False if a ball is wholly behind at least one of the planes (count, 4), otherwise True."""
    i = 0
    while i < count and _level(planes, i, x) >= -radius:
        i += 1
    return i == count


@innermost
def _box_behind(planes: np.ndarray, count: int, box: np.ndarray) -> bool:
    """Return whether a box, given by its lowest and highest corner (6,), is wholly behind at least one of the planes (count, 4)."""
    for i in range(count):
        height = EQUAL_M - planes[i, 3]
        for k in range(3):
            height += planes[i, k] * box[k + 3 if planes[i, k] > 0 else k]
        if height < 0:
            return True
    return False


@innermost
def _leaf(tree: Hierarchy, node: int, planes: np.ndarray, count: int) -> int:
    """Return the first leaf from box `node` on that is not wholly behind one of the planes (count, 4), else the number of boxes."""
    while node < len(tree.box):
        behind = _box_behind(planes, count, tree.box[node])
        if not behind and tree.first[node] < tree.stop[node]:
            break
        node = tree.beyond[node] if behind else node + 1
    return node


@innermost
def _passed(walls: Walls, start: Point, points: np.ndarray, count: int, end: Point, pane_ids: np.ndarray, least: float) -> float:
    """Return the product of the largest transmission coefficients of the panes on the path from `start` via `points` (count, 3) to `end`.

    Return 0 if the path is blocked or the transmission is below `least`. pane_ids: (MAX_PANES,) memory.
    """
    to, factor = (end[0], end[1], end[2]), 1.0
    for i in range(count - 1, -2, -1):
        at = (points[i, 0], points[i, 1], points[i, 2]) if i >= 0 else (start[0], start[1], start[2])
        panes = crossed(walls.tree, at, to, walls.opaque, pane_ids)
        if panes < 0:
            return 0.0
        for k in range(panes):
            factor *= float(walls.through[walls.tree.label[pane_ids[k]]])
        if factor < least:
            return 0.0
        to = at
    return factor


@innermost
def _reflected(faces: Faces, envelope: np.ndarray, chain: np.ndarray, at: Vector, radius: float, polygon: np.ndarray, count: int) -> float:
    """Return the largest product of reflection coefficients over the directions from a ball to a convex polygon on the last face.

    Over such directions, the cosine of incidence at each face is smallest at a corner of the polygon, because a cone of directions up to
    90 degrees about a normal is convex.
    """
    total, columns = 1.0, envelope.shape[1] - 1
    for i in range(len(chain)):
        least = 1.0
        for k in range(count):
            corner = vector(polygon, k)
            away = max(distance(at, corner), 1e-12)
            way = toward(at, corner, away)
            for j in range(len(chain) - 1, i, -1):
                normal = vector(faces.normal, chain[j])
                way = moved(way, normal, -2 * dot(way, normal))
            least = max(min(least, abs(dot(way, vector(faces.normal, chain[i]))) - radius / away), 0.0)
        total *= envelope[chain[i], int(least * columns)]
    return total


@innermost
def _beyond(polygon: np.ndarray, count: int, middle: Vector, at: Vector) -> float:
    """Return a lower bound of the distance from a point to a polygon with the given middle."""
    return max(distance(at, middle) - _size(polygon, count, middle), 0.0)


@innermost
def _lit_part(faces: Faces, p: int, planes: np.ndarray, bounds: int, aside: float, out: np.ndarray, spare: np.ndarray) -> int:
    """Write the part of face `p` before all planes (bounds, 4), and `aside` metres before the first plane, to `out` (M, 3); returns the
    number of its corners. spare: (M, 3) memory.
    """
    polygon, clipped, count = out, spare, faces.corners[p]
    copy(faces.outline[p], count, polygon)
    for i in range(bounds):
        count = clip(polygon, count, vector(planes, i), planes[i, 3] + (aside if i == 0 else 0.0), clipped)
        polygon, clipped = clipped, polygon
        if count == 0:
            return 0
    if bounds % 2:
        copy(polygon, count, out)
    return count


@innermost
def _place_planes(
    faces: Faces, chain: np.ndarray, place: Point, front: np.ndarray, polygon: np.ndarray, spare: np.ndarray, out: np.ndarray
) -> int:  # fmt: skip
    """Write the planes that bound the beam from one place over the faces of a chain, as `beam_planes`; returns their number. It is 0 if the
    last face is not lit, and for an empty chain without a plane `front`.

    polygon, spare: (M, 3), memory for polygons.
    """
    at = place[0], place[1], place[2]
    bounds = beam_planes(faces, -1, at, 0.0, polygon, 0, front, out)
    for j in range(len(chain)):
        count = _lit_part(faces, chain[j], out, bounds, 0.0, polygon, spare)
        if count == 0:
            return 0
        at = mirrored(faces, chain[j], at, 1.0)
        bounds = beam_planes(faces, chain[j], at, 0.0, polygon, count, front, out)
        if bounds == 0:
            return 0
    return bounds


@innermost
def _can_end(
    walls: Walls, cell: Cell, ends: Ends, planes: np.ndarray, bounds: int, p: int, at: Vector, strength: float, away: float
) -> bool:
    """Return whether a path over a beam of face `p`, whose image is `at`, can end over one of the faces or edges of `ends`. Such a path is
    longer than `away`.
    """
    faces, edges, reach = walls.faces, ends.edges, cell.radius
    for k in range(len(ends.face)):
        if strength * ends.strength[k] < cell.least * away:
            break  # the strength falls with the index
        image = vector(ends.image, k)
        if ends.face[k] == p or not _within(planes, bounds, image, reach):
            continue
        if strength * ends.strength[k] >= cell.least * (distance(at, image) - 2 * reach):
            return True
    node = _leaf(edges, 0, planes, bounds)
    while node < len(edges.box):
        for t in range(edges.first[node], edges.stop[node]):
            e = edges.label[t]
            low, high = part_inside(planes, bounds, vector(faces.start, e), vector(faces.along, e), faces.length[e])
            if low >= high or not _is_open(faces, e, vector(faces.start, e), at, reach):
                continue
            if _single(faces, e, walls.wavenumber, reach, strength * ends.through[e], cell.least, at, vector(cell.places, 0)):
                return True
        node = _leaf(edges, node + 1, planes, bounds)
    return False


@innermost
def _seen(
    walls: Walls, cell: Cell, beams: Beams, b: int, number: int, p: int, least: float, views: np.ndarray, counts: np.ndarray,
    points: np.ndarray, pane_ids: np.ndarray, polygon: np.ndarray, spare: np.ndarray,
) -> float:  # fmt: skip
    """Write which places light a part of face `p` over beam `b` to `beams.seen[number]`, and return the largest transmission to samples of
    these parts: 0 if all samples are blocked or weaker than `least`, that of beam `b` if no place meets a sample. The other arguments are
    memory and bounds of `_grown`.
    """
    faces, m, most = walls.faces, beams.order[b], beams.passed[b]
    lit, met = 0.0, False
    for i in range(len(cell.places)):
        sees = _lit_part(faces, p, views[i], counts[i], 0.0, polygon, spare) if beams.seen[b, i] else 0
        beams.seen[number, i] = sees > 0
        source, centre, known_lit = cell.places[i], middle_of(polygon, max(sees, 1)), lit
        for k in range(2 * sees + 1 if sees and lit < most else 0):
            # the middle, and two points on the way to each corner, in another order for each place
            sample = (i + k) % (2 * sees + 1) - 1
            share = 0.0 if sample < 0 else 0.5 if sample < sees else 0.9
            x = moved(centre, toward(centre, vector(polygon, sample % sees), 1.0), share)
            if reflect_points(faces, source, beams.chain[b, :m], x, points, 0.0):
                lit, met = max(lit, _passed(walls, source, points, m, x, pane_ids, least)), True
                if known_lit > 0 or lit >= most:  # one sample of each place after a lit one
                    break
    return lit if met else most  # if nothing is met, only places between the tested ones see a part of the beam


@compiled
def _grown(walls: Walls, cell: Cell, beams: Beams, start: int, stop: int, number: int, ends: Ends) -> tuple[int, int]:
    """Append the beams that follow beams start:stop, unless `ends` leaves them out. Returns the number of beams, and the first of the beams
    start:stop whose followers did not fit into the arrays.
    """
    faces, most = walls.faces, beams.polygon.shape[1]
    planes, polygon, spare = np.empty((most + 1, 4)), np.empty((most, 3)), np.empty((most, 3))
    ahead = np.empty((most + 1, 4))
    points, pane_ids = np.empty((beams.chain.shape[1] + 1, 3)), np.empty(MAX_PANES, np.int64)
    places, place, reach = len(cell.places), vector(cell.places, 0), cell.radius
    views, counts = np.empty((places, most + 1, 4)), np.zeros(places, np.int64)  # the bounds of the beam of each place alone
    faces_of = np.empty(beams.chain.shape[1], np.int64)
    for b in range(start, stop):
        m, known = beams.order[b], number
        before, at = beams.chain[b, :m], vector(beams.image, b)
        faces_of[:m] = before
        last = before[m - 1] if m else -1
        for i in range(places if ends.every else 0):
            if beams.seen[b, i]:
                counts[i] = _place_planes(faces, before, cell.places[i], cell.front, polygon, spare, views[i])
        bounds = beam_planes(faces, last, at, reach, beams.polygon[b], beams.corners[b], cell.front, planes)
        for p in range(len(faces.offset)):
            height = dot(at, vector(faces.normal, p)) - faces.offset[p]
            if p == last or walls.loudness[p] == 0 or not _within(planes, bounds, vector(walls.centre, p), walls.radius[p]):
                continue
            count = _lit_part(faces, p, planes, bounds, 1e-6 if m else 0.0, polygon, spare)
            if count == 0 or twice_area(polygon, count) < TINY_M2:
                continue
            middle = middle_of(polygon, count)
            faces_of[m] = p
            reflected = _reflected(faces, walls.envelope, faces_of[: m + 1], at, reach, polygon, count)
            away = _beyond(polygon, count, middle, at) + _beyond(polygon, count, middle, place) - 2 * reach
            least = cell.least * max(away, 0.0) / BOTH
            if reflected * beams.passed[b] < max(least, 1e-30):
                continue
            if number == len(beams.order):
                return known, b
            beams.polygon[number, :count], beams.corners[number] = polygon[:count], count
            if ends.every:
                lit = _seen(walls, cell, beams, b, number, p, least / reflected, views, counts, points, pane_ids, polygon, spare)
            else:
                image, lit, beams.seen[number] = mirrored(faces, p, at, 1.0), beams.passed[b], beams.seen[b]
                beyond = beam_planes(faces, p, image, reach, polygon, count, cell.front, ahead)
                if not _can_end(walls, cell, ends, ahead, beyond, p, image, reflected * lit, away):
                    continue
            if lit == 0:
                continue
            beams.chain[number, :m], beams.chain[number, m], beams.chain[number, m + 1 :], beams.order[number] = before, p, -1, m + 1
            beams.image[number] = beams.image[b] - 2 * height * faces.normal[p]
            beams.strength[number], beams.passed[number] = reflected * lit, lit
            number += 1
    return number, stop


def _longer(values: np.ndarray) -> np.ndarray:
    """Return a copy of an array with four times its rows. The new rows are not written, so that they take no memory yet."""
    out = np.empty((4 * len(values), *values.shape[1:]), values.dtype)
    out[: len(values)] = values
    return out


def beams(walls: Walls, cell: Cell, longest: int, twice: bool = True) -> Beams:
    """Follow the beams of a cell over at most `longest` reflections. Beams too weak for `Cell.least` are left out. If paths have one
    diffraction (not `twice`), beams of `longest` > 1 reflections are left out if no face or edge in sight of the cell leads back to it, and
    the others keep what the places see over the beam before, and its transmission.
    """
    most, capacity = walls.faces.outline.shape[1] + SPARE, 4096
    shapes = (max(longest, 1),), (), (3,), (most, 3), (), (len(cell.places),), (), ()  # in the order of Beams
    kinds = (int, int, float, float, int, bool, float, float)
    buffer = Beams(*(np.empty((capacity, *shape), kind) for shape, kind in zip(shapes, kinds, strict=True)))
    for values, first in zip(buffer, (-1, 0, cell.places[0], 0, 0, True, 1, 1), strict=True):
        values[0] = first
    start, number, none = 0, 1, build(np.zeros((0, 3, 3)), np.zeros(0))
    ends = Ends(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), none, np.zeros(0), True)
    for order in range(1, longest + 1):
        end = number
        if order == longest > 1 and not twice:
            ends = _ends(walls, cell, Beams(*(values[:number] for values in buffer)))
        while start < end:
            number, start = _grown(walls, cell, buffer, start, end, number, ends)
            if start < end:
                buffer = Beams(*map(_longer, buffer))
    return Beams(*(values[:number] for values in buffer))


def _ends(walls: Walls, cell: Cell, beams: Beams) -> Ends:
    """Return what can end a path over a last beam that follows one of `beams`."""
    faces, single = walls.faces, np.flatnonzero(beams.order == 1)
    single = single[np.argsort(-beams.strength[single], kind="stable")]
    face = beams.chain[single, 0]
    height = faces.normal[face] @ cell.places[0] - faces.offset[face]
    image = cell.places[0] - 2 * height[:, None] * faces.normal[face]
    return Ends(face, image, beams.strength[single], *_in_sight(walls, cell, beams), False)


def _in_sight(walls: Walls, cell: Cell, beams: Beams) -> tuple[Hierarchy, np.ndarray]:
    """Return the search tree of the edges at which a path of one reflection more than `beams` can end, because the cell sees them, and the
    largest transmission (E,) to each edge of the room.
    """
    arrivals, passed = reached(walls, cell, Beams(*(values[:1] for values in beams)), 2, True)
    edge, through = arrivals[:, 0], np.zeros(len(walls.faces.length))
    through[edge] = passed
    return _hierarchy(walls.faces, edge[own_reflections(walls.faces)[edge] == 1]), through


def _hierarchy(faces: Faces, edge: np.ndarray) -> Hierarchy:
    """Return the search tree of some edges."""
    start, stop = faces.start[edge], faces.start[edge] + faces.length[edge, None] * faces.along[edge]
    return build(np.stack([start, stop, stop], axis=1), edge)


@compiled
def _reach(
    walls: Walls, edges: Hierarchy, in_sight: Hierarchy, cell: Cell, beams: Beams, samples: np.ndarray, longest: int,
    edge_order: np.ndarray, twice: bool, out: np.ndarray, through: np.ndarray,
) -> int:  # fmt: skip
    """Write (edge, beam) of all edges that a beam reaches, and the transmission to each; returns their number, or -1 if `out` is too short.
    The labels of the trees are the numbers of all edges, and of those at which a path over a beam of the most reflections can end.

    A path has at most `longest` reflections. If paths have one diffraction (not `twice`), a path that leaves over a beam of many
    reflections therefore returns over a beam of fewer reflections. The function has examined this beam before.
    """
    faces = walls.faces
    # The arrivals of each edge with 0, 1, ... reflections, as linked lists.
    newest, before_it = np.full((len(faces.length), (longest + 1) // 2), -1), np.empty(len(out), np.int64)
    place, reach = vector(cell.places, 0), cell.radius
    most = beams.polygon.shape[1]
    planes, points = np.empty((most + 1, 4)), np.empty((beams.chain.shape[1] + 1, 3))
    polygon, spare = np.empty((most, 3)), np.empty((most, 3))
    views, counts = np.empty((len(cell.places), most + 1, 4)), np.empty(len(cell.places), np.int64)
    pane_ids = np.empty(MAX_PANES, np.int64)
    number = 0
    for b in range(len(beams.order)):
        m = beams.order[b]
        before, at = beams.chain[b, :m], vector(beams.image, b)
        last = before[m - 1] if m else -1
        if not beams.seen[b].any():
            continue
        viewed, tree = False, edges if twice or m < longest - 1 else in_sight
        bounds = beam_planes(faces, last, at, reach, beams.polygon[b], beams.corners[b], cell.front, planes)
        node = _leaf(tree, 0, planes, bounds)
        while node < len(tree.box):
            for t in range(tree.first[node], tree.stop[node]):
                e = tree.label[t]
                if last >= 0 and (faces.sides[e, 0] == last or faces.sides[e, 1] == last):
                    continue
                back = longest - edge_order[e] - m
                fewer = not twice and back < m
                if fewer and (back < 0 or newest[e, : back + 1].max() < 0):
                    continue
                start, along = vector(faces.start, e), vector(faces.along, e)
                low, high = part_inside(planes, bounds, start, along, faces.length[e])
                if low >= high or not _is_open(faces, e, start, at, reach):
                    continue
                # shortest way over the edge: from the image to the lit part, and straight back to the cell
                foot, straight = dot(toward(start, at, 1.0), along), dot(toward(start, place, 1.0), along)
                near = distance(at, moved(start, along, min(max(foot, low), high)))
                near = max(near + distance(place, moved(start, along, min(max(straight, 0.0), faces.length[e]))) - 2 * reach, 0.0)
                least = cell.least * near * beams.passed[b] / (BOTH * beams.strength[b])  # smallest transmission that matters
                if beams.passed[b] < least:
                    continue
                # a beam of fewer reflections that reaches the edge and closes a strong path
                returns = not fewer
                for few in range(min(back + 1, newest.shape[1]) if fewer else 0):
                    a = newest[e, few]
                    while a >= 0 and not returns:
                        other = out[a, 1]
                        gain = beams.strength[b] * beams.strength[other] * through[a] / beams.passed[other]
                        returns = _single(faces, e, walls.wavenumber, reach, gain, cell.least, at, vector(beams.image, other))
                        a = before_it[a]
                if not returns:
                    continue
                for i in range(0 if viewed else len(cell.places)):
                    if beams.seen[b, i]:
                        counts[i] = _place_planes(faces, before, cell.places[i], cell.front, polygon, spare, views[i])
                viewed = True
                # largest transmission to samples of the part of the edge that each place lights
                lit = 0.0
                for i in range(len(cell.places)):
                    if not beams.seen[b, i] or (m and counts[i] == 0):
                        continue
                    source, known = cell.places[i], lit
                    low, high = part_inside(views[i], counts[i], start, along, faces.length[e])
                    # the foot first, at which a path that returns over the same beam is diffracted
                    # one sample of each place after a lit one
                    for k in range(0 if known > 0 else -1, len(samples) if low < high else -1):
                        z = min(max(foot, low + 1e-5), high - 1e-5) if k < 0 else low + samples[(i + k) % len(samples)] * (high - low)
                        x = edge_point(faces, e, z)
                        if reflect_points(faces, source, before, x, points, 0.0):
                            lit = max(lit, _passed(walls, source, points, m, x, pane_ids, least))
                            if known > 0 or lit >= beams.passed[b]:
                                break
                    if lit >= beams.passed[b]:
                        break
                if lit == 0:
                    continue
                if number == len(out):
                    return -1
                out[number, 0], out[number, 1], through[number] = e, b, lit
                if 2 * m < longest:
                    newest[e, m], before_it[number] = number, newest[e, m]
                number += 1
            node = _leaf(tree, node + 1, planes, bounds)
    return number


def own_reflections(faces: Faces) -> np.ndarray:
    """Return the number of reflections (E,) that an edge wave counts as.

    At its shadow and reflection boundaries, an edge wave continues a wave that is reflected at the faces of the edge: once, or several
    times at an inner corner. These reflections count like other reflections. Otherwise, an edge wave could continue a reflected wave that
    the search leaves out.
    """
    return np.maximum(1, np.round(1 / faces.opening)).astype(np.int64)


def reached(walls: Walls, cell: Cell, beams: Beams, longest: int, twice: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return (edge, beam) of all edges that beams of fewer than `longest` reflections reach, (M, 2), ordered by edge.

    The second result is the largest transmission (M,) of the panes on the way. twice: whether paths may have two diffractions.
    """
    faces, few = walls.faces, _fewer(beams, longest)
    edges = _hierarchy(faces, np.arange(len(faces.length)))
    in_sight = edges if twice else _in_sight(walls, cell, beams)[0]

    def written(rows: int) -> tuple[np.ndarray, np.ndarray] | None:
        out, through = np.empty((rows, 2), np.int64), np.empty(rows)
        number = _reach(walls, edges, in_sight, cell, few, np.array(SAMPLES), longest, own_reflections(faces), twice, out, through)
        return (out[:number], through[:number]) if number >= 0 else None

    out, through = fitted(written, 1 << 22)  # memory that nothing reads or writes costs no time
    order = np.argsort(out[:, 0], kind="stable")
    return out[order], through[order]


def _fewer(beams: Beams, longest: int) -> Beams:
    """Return the beams of fewer than `longest` reflections, as views."""
    return Beams(*(values[: np.searchsorted(beams.order, longest)] for values in beams))


@innermost
def _far(wavenumber: float, radius: float, excess: float, before: float, after: float) -> float:
    """Return the approximate strength, at most 1/2, of an edge wave whose path is longer than the undisturbed line by `excess`.

    If the ends, which are `before` and `after` metres from the edge, move by `radius`, the square root of the excess changes by at most
    radius sqrt((before + after)/(2 before after)).
    """
    change = radius * math.sqrt((before + after) / max(2 * before * after, 1e-12))
    return min(0.5, 0.225 / max(math.sqrt(2 * wavenumber / math.pi) * (math.sqrt(max(excess, 0.0)) - change), 1e-9))


@innermost
def _taper(
    start: Vector, along: Vector, length: float, wavenumber: float, radius: float, place: float, source: Vector, end: Vector
) -> float:
    """Return the approximate weight of an edge for a point of diffraction at `place`: 1 on the edge, less beyond its ends."""
    if -radius <= place <= length + radius:
        return 1.0
    near, x = moved(start, along, 0.0 if place < 0 else length), moved(start, along, place)
    before, after = distance(source, near), distance(near, end)
    return 2 * _far(wavenumber, radius, before + after - distance(source, x) - distance(x, end), before, after)


@innermost
def _share(faces: Faces, e: int, wavenumber: float, radius: float, source: Vector, x: Vector, end: Vector) -> float:
    """Return the approximate strength, at most 3/2, of the wave of edge `e` at x relative to the field from source to end: the sum of the
    waves at the shadow boundary and at the reflection boundaries of the two faces.

    An edge in an inner corner also has boundaries of waves that are reflected several times; it gets the largest strength.
    """
    if faces.opening[e] < 1:
        return 1.5
    total, before, after = 0.0, distance(source, x), distance(x, end)
    for side in range(-1, 2):
        at = source if side < 0 else mirrored(faces, faces.sides[e, side], source, 1.0)
        total += _far(wavenumber, radius, before + after - distance(at, end), before, after)
    return total


@innermost
def _is_open(faces: Faces, e: int, x: Vector, end: Vector, radius: float) -> bool:
    """Return whether the line from a point x of edge `e` to a ball around `end` can run in the open sector of the edge."""
    phi, most = open_angle(faces, e, toward(x, end, 1.0), 0.0), faces.opening[e] * math.pi
    if phi <= most:
        return True
    # distance of the end from the edge's line, on which the angle depends
    away = math.sqrt(max(distance(x, end) ** 2 - dot(toward(x, end, 1.0), vector(faces.along, e)) ** 2, 0.0))
    return away * math.sin(min(phi - most, 2 * math.pi - phi, 0.5 * math.pi)) <= radius


@innermost
def _crosses(walls: Walls, p: int, start: Vector, end: Vector, reach: float) -> bool:
    """Return whether two balls can lie on the same side of face `p` and the reflected line between them can meet the face."""
    faces = walls.faces
    normal, middle = vector(faces.normal, p), vector(walls.centre, p)
    a, b = dot(start, normal) - faces.offset[p], dot(end, normal) - faces.offset[p]
    if a * b <= 1e-12 and min(abs(a), abs(b)) >= reach:
        return False
    a, b = max(abs(a), 1e-9), max(abs(b), 1e-9) * (1.0 if a >= 0 else -1.0)
    a = a if b > 0 else -a
    share, down = a / (a + b), -2 * a * b / (a + b)
    x = moved(moved(start, toward(start, end, 1.0), share), normal, down)
    return distance(x, middle) < walls.radius[p] + reach * (1 + distance(start, end) / (abs(a) + abs(b)))


@compiled
def _linked(walls: Walls, samples: np.ndarray, wanted: np.ndarray, piece: int, pieces: int, out: np.ndarray) -> int:
    """Write (edge, edge, face or -1) of the `wanted` pairs of edges (E, E) that see each other, directly or over a face; returns their
    number, or -1 if `out` is too short.

    The first edge is one of piece, piece + pieces, piece + 2 pieces, ..., and not after the second edge.
    """
    faces, number, edges = walls.faces, 0, len(walls.faces.length)
    points, chain, pane_ids = np.empty((2, 3)), np.empty(1, np.int64), np.empty(MAX_PANES, np.int64)
    for e in range(piece, edges, pieces):
        middle1 = moved(vector(faces.start, e), vector(faces.along, e), 0.5 * faces.length[e])
        for f in range(e, edges):
            if not wanted[e, f]:
                continue
            middle2 = moved(vector(faces.start, f), vector(faces.along, f), 0.5 * faces.length[f])
            for p in range(-1, len(faces.offset)):
                if (p < 0 and e == f) or p in (faces.sides[e, 0], faces.sides[e, 1], faces.sides[f, 0], faces.sides[f, 1]):
                    continue
                if p >= 0 and (walls.loudness[p] == 0 or not _crosses(walls, p, middle1, middle2, 0.0)):
                    continue
                chain[0] = p
                seen = False
                for i in range(len(samples) * len(samples)):
                    start = edge_point(faces, e, samples[i % len(samples)] * faces.length[e])
                    end = edge_point(faces, f, samples[(i + i // len(samples)) % len(samples)] * faces.length[f])
                    way = toward(start, mirrored(faces, p, end, 1.0) if p >= 0 else end, 1.0)
                    common = grazed_face(faces, e, f, chain[: int(p >= 0)], way)
                    for side in range(2 if common >= 0 else 1):
                        shift = beside(faces, e, f, common, side) if common >= 0 else (0.0, 0.0, 0.0)
                        if common >= 0 and shift[0] == 0 and shift[1] == 0 and shift[2] == 0:
                            continue
                        here, there = moved(start, shift, 1.0), moved(end, shift, 1.0)
                        over = p < 0 or reflect_points(faces, here, chain, there, points, 0.0)
                        seen = seen or (over and panes_on(walls.tree, walls.opaque, here, points, int(p >= 0), there, pane_ids) >= 0)
                    if seen:
                        break
                if not seen:
                    continue
                if number == len(out):
                    return -1
                out[number, 0], out[number, 1], out[number, 2] = e, f, p
                number += 1
    return number


class Links:
    """Hold the pairs of edges that see each other, of the pairs that any search has asked for, for any place of the sensor."""

    def __init__(self, walls: Walls):
        edges = len(walls.faces.length)
        self._walls, self._known, self._rows = walls, np.zeros((edges, edges), bool), np.zeros((0, 3), np.int64)
        self._lock = threading.Lock()

    def between(self, wanted: np.ndarray) -> np.ndarray:
        """Return (edge, edge, face or -1) of the `wanted` pairs (E, E) that see each other, directly or over a face, and of others."""
        with self._lock:
            new = wanted & ~self._known
            if new.any():
                rows = _listed(lambda piece, pieces, out: _linked(self._walls, np.array(PLACES), new, piece, pieces, out), 4 * cores())
                self._known, self._rows = self._known | new, np.concatenate([self._rows, rows])
            return self._rows


def worthwhile(walls: Walls, cell: Cell, arrivals: np.ndarray, strength: np.ndarray) -> np.ndarray:
    """Return which pairs of edges (E, E) can give a double diffraction that matters, if they see each other.

    arrivals: (M, 2) edges and the beams that reach them. strength: (M,) their largest field at one metre.
    """
    faces, half = walls.faces, walls.faces.length / 2
    best = np.zeros(len(half))
    np.maximum.at(best, arrivals[:, 0], strength)
    middle = faces.start + half[:, None] * faces.along
    near = np.maximum(np.linalg.norm(middle - cell.places[0], axis=1) - half, 0)
    apart = np.maximum(np.linalg.norm(middle[:, None] - middle, axis=2) - half[:, None] - half, 0)
    length = np.maximum(near[:, None] + apart + near - 2 * cell.radius, 0)
    return (best[:, None] * best > 0) & (BOTH * best[:, None] * best >= BOUND_OF_DOUBLES * cell.least * length)


class _Arrivals(NamedTuple):
    """Hold M pairs of an edge and a beam that reaches the edge, ordered by edge and falling strength.

    Attributes:
        first: (E + 1,) range of each edge. order: (M,) reflections of the beam. image: (M, 3). strength: (M,) largest field at one metre.
        longest: largest number of reflections of a path. edge_order: (E,) of `own_reflections`. reach: radius of the cell in metres.
    """

    first: np.ndarray
    order: np.ndarray
    image: np.ndarray
    strength: np.ndarray
    longest: int
    edge_order: np.ndarray
    reach: float


@compiled
def _doubles(walls: Walls, linked: np.ndarray, least: float, arrivals: _Arrivals, piece: int, pieces: int, out: np.ndarray) -> int:
    """Write (arrival, face or -1, arrival) of double diffractions that can be as strong as `least`; returns their number, or -1 if `out` is
    too short.

    The function examines the rows piece, piece + pieces, piece + 2 pieces, ... of `linked`.
    """
    faces, wavenumber, number = walls.faces, walls.wavenumber, 0
    first, order, image, strength, longest, edge_order, reach = arrivals
    best = np.zeros(len(faces.length))
    for f in range(len(faces.length)):
        if first[f] < first[f + 1]:
            best[f] = strength[first[f]]
    for link in range(piece, len(linked), pieces):
        e, f, p = linked[link]
        over = 1 if p >= 0 else 0
        spare = longest - max(edge_order[e], edge_order[f])
        if best[e] == 0 or best[f] == 0 or spare < over:
            continue
        start1, along1 = vector(faces.start, e), vector(faces.along, e)
        middle1 = moved(start1, along1, 0.5 * faces.length[e])
        start2, along2, gain = vector(faces.start, f), vector(faces.along, f), 1.0
        if over:
            gain = walls.loudness[p]
            start2, along2 = mirrored(faces, p, start2, 1.0), mirrored(faces, p, along2, 0.0)
        for a in range(first[e], first[e + 1]):
            at_a = vector(image, a)
            if order[a] + over > spare or gain * strength[a] * best[f] < least * (distance(at_a, middle1) - reach) * 0.4:
                continue
            # bound before the second beam is known: the share of the first edge, at most 1.5 for the second, and the length up to it
            z2 = min(max(keller(start2, along2, at_a, at_a), 0.0), faces.length[f])
            x2 = moved(start2, along2, z2)
            z1 = min(max(keller(start1, along1, at_a, x2), 0.0), faces.length[e])
            x1 = moved(start1, along1, z1)
            base = gain * strength[a] * _share(faces, e, wavenumber, reach, at_a, x1, x2)
            length = max(distance(at_a, x1) + distance(x1, x2) - 2 * reach, 0.0)
            if 1.5 * base * best[f] < least * length:
                continue
            for b in range(first[f] if e != f else a, first[f + 1]):
                if 1.5 * base * strength[b] < least * length:
                    break  # the strength falls with the index
                if order[a] + order[b] + over > spare:
                    continue
                at_b = vector(image, b)
                if over:
                    at_b = mirrored(faces, p, at_b, 1.0)
                if 1.5 * base * strength[b] < least * (length + distance(at_b, x2)):
                    continue
                # points of diffraction, by steps in which each edge gets Keller's point for the other edge's point
                y1, y2 = x1, x2
                for _ in range(FEW):
                    z2 = keller(start2, along2, y1, at_b)
                    y2 = moved(start2, along2, z2)
                    z1 = keller(start1, along1, at_a, y2)
                    y1 = moved(start1, along1, z1)
                whole = max(distance(at_a, y1) + distance(y1, y2) + distance(y2, at_b) - 2 * reach, 1e-3)
                # estimate: both fields over the whole length, times the weight and the share of each edge
                worth = gain * strength[a] * strength[b] / whole
                worth *= _taper(start1, along1, faces.length[e], wavenumber, reach, z1, at_a, y2)
                worth *= _taper(start2, along2, faces.length[f], wavenumber, reach, z2, y1, at_b)
                if 2.25 * worth < least:
                    continue
                worth *= _share(faces, e, wavenumber, reach, at_a, y1, y2)
                if 1.5 * worth < least:
                    continue
                if not _is_open(faces, e, y1, y2, reach):
                    continue
                # the second edge is mirrored in face p, but `_is_open` uses its unmirrored faces: mirror the line back
                if over:
                    y1, y2, at_b = mirrored(faces, p, y1, 1.0), mirrored(faces, p, y2, 1.0), vector(image, b)
                if not _is_open(faces, f, y2, y1, reach):
                    continue
                if worth * _share(faces, f, wavenumber, reach, at_b, y2, y1) < least:
                    continue
                if number == len(out):
                    return -1
                out[number, 0], out[number, 1], out[number, 2] = a, p if over else -1, b
                number += 1
    return number


@dataclass(frozen=True)
class Sequences:
    """Hold K sequences of faces and edges.

    Attributes:
        count: (K, 3) reflections before, between and after the edges. edge: (K, 2) edges or -1.
        chain: (K, C) faces in the order of the path, -1 beyond the last.
        reversible: (K,) whether the reversed sequence is another path, which is not listed. Both directions of sequences without edges are
            listed, because in a corner of 90 degrees only one of them is a path.
    """

    count: np.ndarray
    edge: np.ndarray
    chain: np.ndarray
    reversible: np.ndarray

    def __len__(self) -> int:
        return len(self.count)

    def where(self, keep: np.ndarray) -> "Sequences":
        """Return the sequences that a mask or indices select."""
        return Sequences(self.count[keep], self.edge[keep], self.chain[keep], self.reversible[keep])

    @staticmethod
    def joined(parts: "list[Sequences]") -> "Sequences":
        """Return the sequences of several lists, one list after the other."""
        width = max(part.chain.shape[1] for part in parts)
        chains = [np.pad(part.chain, ((0, 0), (0, width - part.chain.shape[1])), constant_values=-1) for part in parts]
        return Sequences(
            np.concatenate([part.count for part in parts]), np.concatenate([part.edge for part in parts]), np.concatenate(chains),
            np.concatenate([part.reversible for part in parts]),
        )  # fmt: skip

    @staticmethod
    def union(parts: "list[Sequences]") -> "tuple[Sequences, list[np.ndarray]]":
        """Return the different sequences of several lists, and for each list the indices of its sequences."""
        every = Sequences.joined(parts)
        rows = np.concatenate([every.count, every.edge, every.chain, every.reversible[:, None]], axis=1)
        every, index = np.unique(rows, axis=0, return_inverse=True)
        bounds = np.cumsum([0] + [len(part) for part in parts])
        count, edge, chain = (np.ascontiguousarray(part) for part in np.split(every[:, :-1], (3, 5), axis=1))
        union = Sequences(count, edge, chain, every[:, -1].astype(bool))
        return union, [np.unique(index.ravel()[a:b]) for a, b in pairwise(bounds)]


@compiled
def _closed(walls: Walls, cell: Cell, beams: Beams, low: int, high: int, out: np.ndarray) -> int:
    """Write (beam, face, -1) of the beams low:high whose path over the face can end in the cell; return their number, -1 if `out` is too
    short.
    """
    faces, number, end, reach = walls.faces, 0, vector(cell.places, 0), cell.radius
    # Largest field at one metre of the beams with one reflection; such a beam is the reverse of a path's last leg.
    last = np.zeros(len(faces.offset))
    for b in range(len(beams.order)):
        if beams.order[b] == 1:
            last[beams.chain[b, 0]] = beams.strength[b]
    every, lit = np.arange(len(faces.offset)), np.flatnonzero(last)  # the sensor lights the last face, as it lights the first one
    planes, bounds = np.empty((beams.polygon.shape[1] + 1, 4)), 0
    for b in range(low, high):
        m, at = beams.order[b], vector(beams.image, b)
        if m:
            bounds = beam_planes(faces, beams.chain[b, m - 1], at, reach, beams.polygon[b], beams.corners[b], cell.front, planes)
        for p in lit if m else every:
            if walls.loudness[p] == 0 or (m and p == beams.chain[b, m - 1]) or not _crosses(walls, p, at, end, reach):
                continue
            image = mirrored(faces, p, end, 1.0)
            if m and (
                not _within(planes, bounds, image, reach) or beams.strength[b] * last[p] < cell.least * (distance(at, image) - 2 * reach)
            ):
                continue
            if number == len(out):
                return -1
            out[number, 0], out[number, 1], out[number, 2] = b, p, -1
            number += 1
    return number


def closed(walls: Walls, cell: Cell, beams: Beams, longest: int) -> Iterator[Sequences]:
    """Yield the sequences of at most `longest` faces, without edges, over which beams of the cell can return to it, for BEAMS_AT_ONCE
    beams at a time.
    """
    few = _fewer(beams, longest)
    for low in range(0, len(few.order), BEAMS_AT_ONCE):
        high = min(low + BEAMS_AT_ONCE, len(few.order))
        beam, face, _ = _listed(lambda _, __, out, low=low, high=high: _closed(walls, cell, few, low, high, out), 1).T
        chains = np.full((len(beam), max(longest, 1)), -1)
        chains[:, : few.chain.shape[1]] = few.chain[beam, : chains.shape[1]]
        chains[np.arange(len(beam)), few.order[beam]] = face
        count = np.zeros((len(beam), 3), int)
        count[:, 0] = few.order[beam] + 1
        yield Sequences(count, np.full((len(beam), 2), -1), chains, np.zeros(len(beam), bool))


@innermost
def _single(faces: Faces, e: int, wavenumber: float, reach: float, strength: float, least: float, at_a: Vector, at_b: Vector) -> bool:
    """Return whether a single diffraction at edge `e` between two images can be as strong as `least`; strength: field at one metre."""
    start, along = vector(faces.start, e), vector(faces.along, e)
    z = keller(start, along, at_a, at_b)
    x = moved(start, along, z)
    worth = strength / max(distance(at_a, x) + distance(x, at_b) - 2 * reach, 1e-3)
    worth *= _taper(start, along, faces.length[e], wavenumber, reach, z, at_a, at_b)
    return 1.5 * worth >= least and worth * _share(faces, e, wavenumber, reach, at_a, x, at_b) >= least


@compiled
def _singles(walls: Walls, least: float, arrivals: _Arrivals, out: np.ndarray) -> int:
    """Write (arrival, -1, arrival) of single diffractions that can be as strong as `least`; returns their number, or -1 if `out` is too
    short.
    """
    faces, number = walls.faces, 0
    first, order, image, strength, longest, edge_order, reach = arrivals
    for e in range(len(faces.length)):
        for a in range(first[e], first[e + 1]):
            for b in range(a, first[e + 1]):
                if order[a] + order[b] + edge_order[e] > longest:
                    continue
                if not _single(faces, e, walls.wavenumber, reach, strength[a] * strength[b], least, vector(image, a), vector(image, b)):
                    continue
                if number == len(out):
                    return -1
                out[number, 0], out[number, 1], out[number, 2] = a, -1, b
                number += 1
    return number


@compiled
def _joined(
    rows: np.ndarray, chain: np.ndarray, order: np.ndarray, edge: np.ndarray, double: bool, count: np.ndarray, edges: np.ndarray,
    faces_of: np.ndarray, reversible: np.ndarray,
) -> None:  # fmt: skip
    """Fill the arrays of Sequences from rows (arrival, face or -1, arrival)."""
    for i in range(len(rows)):
        a, p, b = rows[i]
        m, n = order[a], order[b]
        over = 1 if p >= 0 else 0
        count[i, 0], count[i, 1], count[i, 2] = m, over, n
        edges[i, 0], edges[i, 1] = edge[a], edge[b] if double else -1
        faces_of[i, :m] = chain[a, :m]
        if over:
            faces_of[i, m] = p
        for j in range(n):
            faces_of[i, m + over + j] = chain[b, n - 1 - j]
        reversible[i] = a != b


def sequences(
    walls: Walls, cell: Cell, beams: Beams, arrivals: np.ndarray, strength: np.ndarray, linked: np.ndarray, longest: int
) -> Sequences:
    """Join reached edges and their beams to sequences with edges that start and end at the sensor and can be as strong as `cell.least`.

    Args:
        arrivals: (M, 2) edges and the beams that reach them. strength: (M,) their largest field at one metre.
        linked: (L, 3) of `Links`. longest: largest number of reflections.
    """
    falling = np.lexsort((-strength, arrivals[:, 0]))
    arrivals, strength = arrivals[falling], strength[falling]
    first = np.searchsorted(arrivals[:, 0], np.arange(len(walls.faces.length) + 1))
    beam = arrivals[:, 1]
    order, image = beams.order[beam], beams.image[beam]
    width = max(beams.chain.shape[1], longest, 1)
    parts = []
    known = _Arrivals(first, order, image, strength, longest, own_reflections(walls.faces), cell.radius)
    once = _listed(lambda piece, pieces, out: _singles(walls, cell.least, known, out), 1)
    limit = BOUND_OF_DOUBLES * cell.least
    twice = _listed(lambda piece, pieces, out: _doubles(walls, linked, limit, known, piece, pieces, out), 4 * cores())
    for double, rows in ((False, once), (True, twice)):
        k = len(rows)
        # A path whose two beams reach the same edge is listed in the direction whose first beam has the smaller index, which is the same at
        # all places.
        a, b = rows[:, 0], rows[:, 2]
        turned = (arrivals[a, 0] == arrivals[b, 0]) & (beam[a] > beam[b])
        rows[turned] = rows[turned][:, ::-1]
        part = np.zeros((k, 3), np.int64), np.zeros((k, 2), np.int64), np.full((k, width), -1), np.zeros(k, bool)
        _joined(rows, beams.chain[beam], order, np.ascontiguousarray(arrivals[:, 0]), double, *part)
        parts.append(part)
    return Sequences(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _listed(search: Callable[[int, int, np.ndarray], int], pieces: int) -> np.ndarray:
    """Return the sorted rows (K, 3) that all pieces of a search write; the rows of a single piece are sorted already. A piece returns -1 if
    its array is too short.
    """

    def listed(piece: int, rows: int) -> np.ndarray | None:
        number = search(piece, pieces, out := np.empty((rows, 3), np.int64))
        return out[:number].copy() if number >= 0 else None

    # memory that nothing reads or writes costs no time
    rows = np.concatenate(each(lambda piece: fitted(partial(listed, piece), 1 << 20), range(pieces)))
    return rows[np.lexsort(rows.T[::-1])] if pieces > 1 else rows
