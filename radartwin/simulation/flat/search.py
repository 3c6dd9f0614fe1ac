"""Search for the sequences of faces and edges that can carry a path, seen from one place of the sensor.

Beams start at the sensor. A beam is the convex part of a face that the sensor's image lights, together with this image; it is mirrored at
the face and clipped by the faces beyond it. The search follows beams until their field is too weak. An edge inside a beam is reached by
the faces of the beam. Reached twice, out and back, it gives a path with one diffraction. Two edges that see each other, directly or over
one face, give a path with two diffractions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from radartwin.compiled import compiled
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.flat.field import angle, distance, dot, edge_point, is_clear, keller, reflect_points, share_face
from radartwin.simulation.flat.obstacles import Hierarchy

CORNERS = 24  # largest number of corners of a beam
SAMPLES = (0.02, 0.25, 0.5, 0.75, 0.98)  # places along an edge, relative to its length, where its visibility is tested
TINY_M2 = 1e-6  # twice the smallest area of a beam on a face


@dataclass(frozen=True)
class Beams:
    """Hold N beams, ordered by their number of reflections; the first is the sensor itself.

    Attributes:
        chain: (N, C) faces. order: (N,) number of reflections. image: (N, 3) of the sensor. polygon: (N, CORNERS, 3), corners: (N,).
        strength: (N,) product of the largest reflection coefficients.
    """

    chain: np.ndarray
    order: np.ndarray
    image: np.ndarray
    polygon: np.ndarray
    corners: np.ndarray
    strength: np.ndarray


@compiled
def _clip(polygon: np.ndarray, count: int, normal: np.ndarray, offset: float, out: np.ndarray) -> int:
    """Write the part of a convex polygon with normal . x >= offset to `out`; returns its number of corners."""
    kept, previous = 0, count - 1
    before = dot(polygon[previous], normal) - offset
    for i in range(count):
        here = dot(polygon[i], normal) - offset
        if (here >= 0) != (before >= 0) and kept < CORNERS:
            share = before / (before - here)
            for k in range(3):
                out[kept, k] = polygon[previous, k] + share * (polygon[i, k] - polygon[previous, k])
            kept += 1
        if here >= 0 and kept < CORNERS:
            for k in range(3):
                out[kept, k] = polygon[i, k]
            kept += 1
        previous, before = i, here
    return kept if kept > 2 else 0


@compiled
def _area(polygon: np.ndarray, count: int) -> float:
    """Return twice the area of a polygon."""
    total = np.zeros(3)
    for i in range(1, count - 1):
        total += np.cross(polygon[i] - polygon[0], polygon[i + 1] - polygon[0])
    return np.sqrt(dot(total, total))


@compiled
def _limits(image: np.ndarray, polygon: np.ndarray, count: int, normals: np.ndarray) -> None:
    """Write the normals (count, 3) of the planes through the image and the sides of a beam, pointing inwards."""
    middle = np.zeros(3)
    for i in range(count):
        middle += polygon[i] / count
    for i in range(count):
        j = (i + 1) % count
        normals[i] = np.cross(polygon[i] - image, polygon[j] - image)
        if dot(normals[i], middle - image) < 0:
            normals[i] = -normals[i]


@compiled
def _grown(
    faces: Faces, tree: Hierarchy, opaque: np.ndarray, loudness: np.ndarray, source: np.ndarray, least: float, start: int, stop: int,
    chain: np.ndarray, order: np.ndarray, image: np.ndarray, polygon: np.ndarray, corners: np.ndarray, strength: np.ndarray, used: int,
) -> int:  # fmt: skip
    """Append the beams that follow beams start:stop; returns the number of beams, or -1 if the arrays are too short."""
    limits, one, two = np.empty((CORNERS, 3)), np.empty((CORNERS, 3)), np.empty((CORNERS, 3))
    points = np.empty((chain.shape[1] + 1, 3))
    for b in range(start, stop):
        m = order[b]
        last = chain[b, m - 1] if m else -1
        if m:
            _limits(image[b], polygon[b], corners[b], limits)
            facing = -1.0 if dot(image[b], faces.normal[last]) > faces.offset[last] else 1.0
        for p in range(len(faces.offset)):
            height = dot(image[b], faces.normal[p]) - faces.offset[p]
            if p == last or abs(height) < 1e-6 or strength[b] * loudness[p] < least * abs(height):
                continue
            count = faces.corners[p]
            for i in range(count):
                one[i] = faces.outline[p, i]
            if m:
                count = _clip(one, count, facing * faces.normal[last], facing * faces.offset[last] + 1e-6, two)
                one, two = two, one
                for i in range(corners[b]):
                    if count == 0:
                        break
                    count = _clip(one, count, limits[i], dot(limits[i], image[b]), two)
                    one, two = two, one
            if count == 0 or _area(one, count) < TINY_M2:
                continue
            nearest = np.inf
            middle = np.zeros(3)
            for i in range(count):
                middle += one[i] / count
            nearest = abs(height)
            if strength[b] * loudness[p] < least * nearest:
                continue
            lit = False
            for i in range(-1, count):
                for share in (0.5, 0.9):
                    x = middle.copy()
                    if i >= 0:
                        x = middle + share * (one[i] - middle)
                    if reflect_points(faces, source, chain[b, :m], x, points) and is_clear(tree, opaque, source, points, m, x):
                        lit = True
                        break
                if lit:
                    break
            if not lit:
                continue
            if used == len(order):
                return -1
            chain[used, :m], chain[used, m], order[used] = chain[b, :m], p, m + 1
            image[used] = image[b] - 2 * height * faces.normal[p]
            polygon[used, :count], corners[used] = one[:count], count
            strength[used] = strength[b] * loudness[p]
            used += 1
    return used


def beams(faces: Faces, tree: Hierarchy, opaque: np.ndarray, loudness: np.ndarray, source: np.ndarray, longest: int, least: float) -> Beams:
    """Follow the beams of a source.

    Args:
        loudness: (P,) largest reflection coefficient of each face. longest: largest number of reflections.
        least: smallest field worth following, for a unit field at one metre.
    """
    room = 4096
    while True:
        chain, order = np.full((room, max(longest, 1)), -1), np.zeros(room, np.int64)
        image, polygon, corners = np.zeros((room, 3)), np.zeros((room, CORNERS, 3)), np.zeros(room, np.int64)
        strength = np.zeros(room)
        image[0], strength[0] = source, 1.0
        start, used = 0, 1
        for _ in range(longest):
            end = used
            used = _grown(faces, tree, opaque, loudness, source, least, start, end, chain, order, image, polygon, corners, strength, used)
            start = end
            if used < 0:
                break
        if used >= 0:
            return Beams(chain[:used], order[:used], image[:used], polygon[:used], corners[:used], strength[:used])
        room *= 4


@compiled
def _reach(
    faces: Faces, tree: Hierarchy, opaque: np.ndarray, source: np.ndarray, samples: np.ndarray, chain: np.ndarray, order: np.ndarray,
    image: np.ndarray, polygon: np.ndarray, corners: np.ndarray, out: np.ndarray,
) -> int:  # fmt: skip
    """Write (edge, beam) of all edges that a beam reaches; returns their number, or -1 if `out` is too short."""
    limits, points = np.empty((CORNERS, 3)), np.empty((chain.shape[1] + 1, 3))
    used = 0
    for b in range(len(order)):
        m = order[b]
        last = chain[b, m - 1] if m else -1
        if m:
            _limits(image[b], polygon[b], corners[b], limits)
            facing = -1.0 if dot(image[b], faces.normal[last]) > faces.offset[last] else 1.0
        for e in range(len(faces.length)):
            if last >= 0 and (faces.sides[e, 0] == last or faces.sides[e, 1] == last):
                continue
            start, along = faces.start[e], faces.along[e]
            way = image[b] - start
            if angle(faces, e, way[0], way[1], way[2]) > faces.opening[e] * np.pi:
                continue
            low, high = 0.0, faces.length[e]
            if m:
                for i in range(-1, corners[b]):
                    normal = limits[i] if i >= 0 else facing * faces.normal[last]
                    level = dot(normal, start) - (dot(normal, image[b]) if i >= 0 else facing * faces.offset[last])
                    slope = dot(normal, along)
                    if abs(slope) < 1e-12:
                        if level < 0:
                            high = -1.0
                    elif slope > 0:
                        low = max(low, -level / slope)
                    else:
                        high = min(high, -level / slope)
                    if low >= high:
                        break
            if low >= high:
                continue
            foot = dot(way, along)
            for i in range(-1, len(samples)):
                z = min(max(foot, low + 1e-5), high - 1e-5) if i < 0 else low + samples[i] * (high - low)
                x = edge_point(faces, e, z)
                if reflect_points(faces, source, chain[b, :m], x, points) and is_clear(tree, opaque, source, points, m, x):
                    if used == len(out):
                        return -1
                    out[used, 0], out[used, 1] = e, b
                    used += 1
                    break
    return used


def reached(faces: Faces, tree: Hierarchy, opaque: np.ndarray, source: np.ndarray, found: Beams, around: int) -> np.ndarray:
    """Return (edge, beam) of all edges that beams of at most `around` reflections reach, (M, 2), ordered by edge."""
    few = found.order <= around
    room = 4096
    while True:
        out = np.zeros((room, 2), np.int64)
        used = _reach(
            faces, tree, opaque, source, np.array(SAMPLES), found.chain[few], found.order[few], found.image[few], found.polygon[few],
            found.corners[few], out,
        )  # fmt: skip
        if used >= 0:
            return out[:used][np.argsort(out[:used, 0], kind="stable")]
        room *= 4


@compiled
def _share(wavenumber: float, source: np.ndarray, edge: np.ndarray, end: np.ndarray) -> float:
    """Return about the part of the field from source to end that an edge diffracts: 1/2 at its shadow boundary, less away from it."""
    straight = np.sqrt((source[0] - end[0]) ** 2 + (source[1] - end[1]) ** 2 + (source[2] - end[2]) ** 2)
    u = np.sqrt(2 * wavenumber / np.pi * max(distance(source, edge) + distance(edge, end) - straight, 0.0))
    return min(0.5, 0.225 / max(u, 1e-9))


@compiled
def _share_with_mirrors(faces: Faces, e: int, wavenumber: float, source: np.ndarray, edge: np.ndarray, end: np.ndarray) -> float:
    """Return the sum of `_share` for a source and for its images in both faces of edge `e`."""
    total = _share(wavenumber, source, edge, end)
    for side in range(2):
        p = faces.sides[e, side]
        height = dot(source, faces.normal[p]) - faces.offset[p]
        total += _share(wavenumber, source - 2 * height * faces.normal[p], edge, end)
    return total


@compiled
def _crosses(faces: Faces, p: int, centre: np.ndarray, radius: np.ndarray, start: np.ndarray, end: np.ndarray) -> bool:
    """Return whether two points lie on the same side of face `p` and the reflected line between them can meet it."""
    a, b = dot(start, faces.normal[p]) - faces.offset[p], dot(end, faces.normal[p]) - faces.offset[p]
    if a * b <= 1e-12:
        return False
    a, b = abs(a), abs(b)
    away = 0.0
    for k in range(3):
        away += ((start[k] * b + end[k] * a) / (a + b) - centre[p, k]) ** 2
    return away < radius[p] ** 2


@compiled
def _doubles(
    faces: Faces, centre: np.ndarray, radius: np.ndarray, loudness: np.ndarray, wavenumber: float, least: float, over: int,
    first: np.ndarray, order: np.ndarray, image: np.ndarray, strength: np.ndarray, around: int, out: np.ndarray,
) -> int:  # fmt: skip
    """Write (arrival, face or -1, arrival) of double diffractions that can be as strong as `least`; returns their number or -1."""
    used, edges = 0, len(faces.length)
    middle = faces.start + 0.5 * faces.length.reshape(-1, 1) * faces.along
    for e in range(edges):
        if first[e] == first[e + 1]:
            continue
        for f in range(e, edges):
            if first[f] == first[f + 1] or (over == 0 and (e == f or not share_face(faces, e, f))):
                continue
            for p in range(len(faces.offset) if over else 1):
                start2, along2 = faces.start[f].copy(), faces.along[f].copy()
                if over:
                    if p == faces.sides[e, 0] or p == faces.sides[e, 1] or p == faces.sides[f, 0] or p == faces.sides[f, 1]:
                        continue
                    if not _crosses(faces, p, centre, radius, middle[e], middle[f]):
                        continue
                    start2 -= 2 * (dot(start2, faces.normal[p]) - faces.offset[p]) * faces.normal[p]
                    along2 -= 2 * dot(along2, faces.normal[p]) * faces.normal[p]
                gain = loudness[p] if over else 1.0
                for a in range(first[e], first[e + 1]):
                    if order[a] + over > around:
                        continue
                    z2 = min(max(dot(image[a] - start2, along2), 0.0), faces.length[f])
                    x2 = start2 + z2 * along2
                    z1 = min(max(keller(faces.start[e], faces.along[e], image[a], x2), 0.0), faces.length[e])
                    x1 = faces.start[e] + z1 * faces.along[e]
                    share1 = _share_with_mirrors(faces, e, wavenumber, image[a], x1, x2)
                    base = gain * strength[a] * share1
                    length = distance(image[a], x1) + distance(x1, x2)
                    if base < least * length:
                        continue
                    for b in range(first[f] if e != f else a, first[f + 1]):
                        if order[a] + order[b] + over > around:
                            continue
                        at = image[b]
                        if over:
                            at = at - 2 * (dot(at, faces.normal[p]) - faces.offset[p]) * faces.normal[p]
                        if base * strength[b] < least * (length + distance(at, x2)):
                            continue
                        share2 = _share(wavenumber, at, x2, x1)
                        for side in range(2):
                            o = faces.sides[f, side]
                            mirrored = image[b] - 2 * (dot(image[b], faces.normal[o]) - faces.offset[o]) * faces.normal[o]
                            if over:
                                mirrored = mirrored - 2 * (dot(mirrored, faces.normal[p]) - faces.offset[p]) * faces.normal[p]
                            share2 += _share(wavenumber, mirrored, x2, x1)
                        if base * strength[b] * share2 < least * (length + distance(at, x2)):
                            continue
                        if used == len(out):
                            return -1
                        out[used, 0], out[used, 1], out[used, 2] = a, p if over else -1, b
                        used += 1
    return used


@dataclass(frozen=True)
class Sequences:
    """Hold K sequences.

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

    @staticmethod
    def union(parts: "list[Sequences]") -> "tuple[Sequences, list[np.ndarray]]":
        """Return the different sequences of several lists, and for each list the indices of its sequences."""
        width = max(part.chain.shape[1] for part in parts)
        rows = []
        for part in parts:
            chain = np.pad(part.chain, ((0, 0), (0, width - part.chain.shape[1])), constant_values=-1)
            rows.append(np.concatenate([part.count, part.edge, chain, part.reversible[:, None]], axis=1))
        every, index = np.unique(np.concatenate(rows), axis=0, return_inverse=True)
        bounds = np.cumsum([0] + [len(part) for part in parts])
        return (
            Sequences(every[:, :3], every[:, 3:5], np.ascontiguousarray(every[:, 5:-1]), every[:, -1].astype(bool)),
            [np.unique(index.ravel()[a:b]) for a, b in pairwise(bounds)],
        )


@compiled
def _singles(
    faces: Faces, wavenumber: float, least: float, first: np.ndarray, order: np.ndarray, image: np.ndarray, strength: np.ndarray,
    around: int, out: np.ndarray,
) -> int:  # fmt: skip
    """Write (arrival, -1, arrival) of single diffractions that can be as strong as `least`; returns their number or -1."""
    used = 0
    for e in range(len(faces.length)):
        for a in range(first[e], first[e + 1]):
            for b in range(a, first[e + 1]):
                if order[a] + order[b] > around:
                    continue
                z = keller(faces.start[e], faces.along[e], image[a], image[b])
                x = faces.start[e] + min(max(z, 0.0), faces.length[e]) * faces.along[e]
                length = distance(image[a], x) + distance(x, image[b])
                if strength[a] * strength[b] < least * length:
                    continue
                if strength[a] * strength[b] * _share_with_mirrors(faces, e, wavenumber, image[a], x, image[b]) < least * length:
                    continue
                if used == len(out):
                    return -1
                out[used, 0], out[used, 1], out[used, 2] = a, -1, b
                used += 1
    return used


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
    faces: Faces, found: Beams, arrivals: np.ndarray, loudness: np.ndarray, wavenumber: float, around: int, least: float
) -> Sequences:
    """Join beams and reached edges to sequences that start and end at the sensor and can be as strong as `least`."""
    first = np.searchsorted(arrivals[:, 0], np.arange(len(faces.length) + 1))
    beam = arrivals[:, 1]
    order, image, strength = found.order[beam], found.image[beam], found.strength[beam]
    centre = np.array([faces.outline[p, :n].mean(axis=0) for p, n in enumerate(faces.corners)]).reshape(-1, 3)
    radius = np.array([np.linalg.norm(faces.outline[p, :n] - centre[p], axis=1).max() for p, n in enumerate(faces.corners)])
    width = max(found.chain.shape[1], around, 1)
    only = found.order > 0
    chain = np.pad(found.chain, ((0, 0), (0, width - found.chain.shape[1])), constant_values=-1)
    none = np.zeros(int(only.sum()), int)
    parts = [(
        np.stack([found.order[only], none, none], axis=1), np.full((len(none), 2), -1), chain[only], np.zeros(len(none), bool)
    )]  # fmt: skip
    for double, search in (
        (False, lambda out: _singles(faces, wavenumber, least, first, order, image, strength, around, out)),
        (True, lambda out: _doubles(faces, centre, radius, loudness, wavenumber, least, 0, first, order, image, strength, around, out)),
        (True, lambda out: _doubles(faces, centre, radius, loudness, wavenumber, least, 1, first, order, image, strength, around, out)),
    ):
        rows = _listed(search)
        k = len(rows)
        part = np.zeros((k, 3), np.int64), np.zeros((k, 2), np.int64), np.full((k, width), -1), np.zeros(k, bool)
        _joined(rows, found.chain[beam], order, arrivals[:, 0], double, *part)
        parts.append(part)
    return Sequences(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _listed(search: Callable[[np.ndarray], int]) -> np.ndarray:
    """Return the rows (K, 3) that a search writes. The search returns -1 if the array is too short."""
    room = 65536
    while (used := search(out := np.zeros((room, 3), np.int64))) < 0:
        room *= 4
    return out[:used]
