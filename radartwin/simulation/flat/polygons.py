"""Echo of an object of flat faces: physical optics over exact polygons, and fringe currents along wedges.

The source is mirrored at the faces of a sequence, and its beam is clipped to the part of the last face that it lights and the receiver
sees. Shadows of other faces are subtracted from this part, so that a few convex polygons remain. The currents of physical optics on such a
polygon radiate to the receiver

    a = lambda/(4 pi L0) [W rho_0 + integral along the sides of rho b exp(+j k E) dl],
    b = -L0/(4 pi) (r x s) . l/(|r| |s| (|r| |s| + r . s))

- S -> source, mirrored at all faces including the last one. L0 -> distance from S to the receiver. W -> 1 if the line from S to the
  receiver crosses the polygon, otherwise 0.
- r, s -> vectors to a point of a side from S and from the receiver. l -> direction of the side, counter-clockwise seen from the receiver.
- E -> |r| + |s| - L0, excess length of the path over the side.
- rho -> field that the currents radiate to the receiver, divided by the field of an infinite mirror with unit reflection.

The integral is the boundary form of Kirchhoff's surface integral. The boundary form is exact for an image source if k|r| and k|s| are
large, so that the polygon may have any size in Fresnel zones. rho varies over the polygon because polarisation and reflection depend on
direction. The boundary form is then correct to first order in the ratio of the wavelength to the distance along which rho varies.
Where a polygon ends because the light misses an earlier face of the sequence, the integral runs along the edge of that face. There, the
source is mirrored at the faces before it, and the receiver at the faces after it.

Physical optics has the wrong currents near edges. The difference radiates like a line source along the edge, of strength

    G = -1/(4 pi) [cot(x/(2 n))/n - cot(x/2)]

for each of four angles x. The first part is the coefficient of a wedge of opening n pi. The second part is the same coefficient of the
currents of physical optics on a lit face. Both have the same pole at a shadow or reflection boundary, so that the difference is smooth.
An edge has fringe currents in every beam of the source, direct or over faces, and radiates into every beam of the receiver. The currents of
a ray that grazes a face end with the face.

The currents of the incident field form the shadow of the object. The shadow (`silhouette`) contains their field near the line from source
to receiver, so that polygons leave it out there and keep the reflected field.

Every side and every edge is divided into short pieces, and each piece is one path, so that each part of the echo has its own delay and
direction. Where the excess length E is below a wavelength, sides and mirror reflection cannot be told apart. There, a smooth weight moves
the contribution of a side to one path at the polygon's point nearest to the mirror reflection. The sum of all paths does not depend on this
weight.

Errors: diffraction at several edges, for example the coupling of opposite edges of a small plate, is left out. Shadows have sharp geometric
borders. The part of an earlier face's edge that counts is the part whose mirrored rays meet the next faces; for a receiver far from the
mirror direction, other parts count.
Ref: K. Miyamoto, E. Wolf, J. Opt. Soc. Am. 52 (1962) 615, for the boundary form; P. Ya. Ufimtsev, Fundamentals of the Physical Theory of
Diffraction (2007), and A. Michaeli, IEEE Trans. AP 32 (1984) 252, for fringe currents along edges.
"""

import math
import weakref
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, gathered, inner, innermost
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation.flat import faces as faces_module
from radartwin.simulation.flat import obstacles
from radartwin.simulation.flat.convex import clip, copy, twice_area
from radartwin.simulation.flat.faces import SHORTEST_M, Faces
from radartwin.simulation.flat.field import Tables, angle, face_matrix, image, images_of, keller, polarised, reflected, soft_and_hard
from radartwin.simulation.flat.kirchhoff import edge_share, reach_around
from radartwin.simulation.flat.obstacles import Hierarchy, Point, Vector
from radartwin.simulation.flat.search import beam_planes, middle_of, part_inside
from radartwin.simulation.flat.vectors import ZERO, cross, distance, dot, moved, norm, put, toward, transverse, vector
from radartwin.simulation.flat.wedge import scaled_tail
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import Hits
from radartwin.simulation.reflection_table import ReflectionTable, chebyshev_nodes, lagrange_basis

NODES = 3  # smallest number of frequency nodes, because the amplitude of a piece of an edge changes over the sweep
MOST_FACES = 64  # objects with more faces are traced by tubes
SMALLEST_M = 5e-4  # smallest width of a face
CORNERS = 24  # largest number of corners of a polygon
FIRST_ROWS = 4096  # number of paths of a piece of work for which memory is reserved at first; the memory grows if needed
# For PER_BEAM paths, the memory also has one entry for a beam that waits for its next reflection. For PER_PIECE paths, it also has one
# entry for a convex piece of a lit part.
PER_BEAM, PER_PIECE = 8, 64
NEAR, FAR = 0.25, 1.5  # excess phase k E in rad at which a side begins to have its own paths, and from which it has only its own paths
VIEW_RAD = 0.02  # largest angle, seen from source or receiver, of a piece
CURVE_RAD = 0.4  # largest quadratic phase of a piece
DEPTH_M = 0.03  # largest change of the path length along a piece
SMOOTH_RAD = 0.3  # largest angle, seen from source or receiver, over which factors of the field are interpolated by a parabola
SLIVER_M2 = 2e-8  # twice the area below which a polygon is only a rounding error
PLANE_M = 1e-6  # a point closer to a plane than this is on it
SMALL_SINE = 0.02  # smallest sine between ray and edge for which fringe currents radiate
# Shift of the receiver in metres. Without it, the mirror point of a corner reflector would lie exactly on the edge of its last face.
NUDGE_M = 1e-6 * np.array([0.74, 0.53, 0.41])
CLOSEST_M = 1e-12  # smallest distance between the mirror point and a side for which the integral along the side is computed
ABOVE = 0.999  # only the part of a face below this share of the height of the source or receiver casts a shadow
_built: "weakref.WeakKeyDictionary[Geometry, Polyhedron | None]" = weakref.WeakKeyDictionary()
ALL_AROUND = np.zeros(4)  # the beam of a place itself has no bounds
NO_FACE = np.int64(-1)  # Numba would compile a second version of a function for a literal argument
_GAUSS, _WEIGHT = np.polynomial.legendre.leggauss(6)


class _Parts(NamedTuple):
    """Hold K convex parts of faces: face (K,), corners (K, CORNERS, 3) and their number (K,). `solid` (P,) tells whether a face belongs to
    a solid, which is lit on its outside only.
    """

    face: np.ndarray
    corner: np.ndarray
    count: np.ndarray
    solid: np.ndarray


class _Beams(NamedTuple):
    """Hold B beams, which start at one place. Beam 0 has no reflection.

    Attributes:
        chain: (B, C) faces that reflect the beam. order: (B,) their number. image: (B, 3) the place, mirrored at these faces.
        polygon: (B, CORNERS, 3) part of the last face that the beam lights, count: (B,) its number of corners.
    """

    chain: np.ndarray
    order: np.ndarray
    image: np.ndarray
    polygon: np.ndarray
    count: np.ndarray


class _Ends(NamedTuple):
    """Hold source and receiver (3,), both antenna axes (3,), whether both are at one place, and the Fresnel coordinate of their line up to
    which the shadow of the object contains the edges (`reach_around`).
    """

    source: np.ndarray
    receiver: np.ndarray
    transmit: np.ndarray
    receive: np.ndarray
    together: bool
    reach: float


class _Out(NamedTuple):
    """Hold memory for M paths: amplitude (M, Q), lengths in and out and to the first hit (M, 3), departure and arrival (M, 3), reflections
    (M,), and the number of paths (1,).
    """

    amplitude: np.ndarray
    length: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray
    bounces: np.ndarray
    count: np.ndarray


class Polyhedron(NamedTuple):
    """Hold an object of flat faces.

    Attributes:
        faces: faces and wedges. parts: convex parts of the faces. tree: all triangles, for lines of sight to edges.
        convex: whether the object is one closed convex body, on which no face shadows another one and no path has two reflections.
        centre, radius: (3,) and metres, of a ball around the object.
    """

    faces: Faces
    parts: _Parts
    tree: Hierarchy
    convex: bool
    centre: np.ndarray
    radius: float


class _Body(NamedTuple):
    """Hold an object of flat faces, and the coefficients of its surfaces at the wavenumbers (Q,) in rad/m."""

    shape: Polyhedron
    tables: Tables
    wavenumbers: np.ndarray


def build(geometry: Geometry) -> Polyhedron | None:
    """Return the faces of a geometry, or None if the geometry has curved surfaces, no faces or too many faces."""
    if geometry.curved or not len(geometry.corners):
        return None
    faces, flat = faces_module.find(geometry, SMALLEST_M)
    if not flat.all() or not 0 < len(faces.offset) <= MOST_FACES:
        return None
    face, corner, count = [], [], []
    for p in range(len(faces.offset)):
        triangles = faces.triangle[faces.first[p] : faces.first[p + 1]]
        hull = faces.outline[p, : faces.corners[p]]
        whole = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]).sum(axis=0))
        spread = np.linalg.norm(np.cross(hull[1:-1] - hull[0], hull[2:] - hull[0]).sum(axis=0))
        convex = spread < (1 + 1e-6) * whole and len(hull) < CORNERS // 2
        for ring in [hull] if convex else triangles:
            face.append(p)
            corner.append(np.pad(ring, ((0, CORNERS - len(ring)), (0, 0))))
            count.append(len(ring))
    solid = np.array([bool((geometry.hollow_m[geometry.surface == s] > 0).all()) for s in faces.surface])
    parts = _Parts(np.array(face), np.array(corner), np.array(count), solid)
    label = np.zeros(len(faces.triangle), np.int64)
    return Polyhedron(faces, parts, obstacles.build(faces.triangle, label), geometry.convex, geometry.centre, geometry.radius_m)


def of(geometry: Geometry, table: ReflectionTable) -> Polyhedron | None:
    """Return the faces of an opaque object of flat faces; None for an object that needs ray tubes."""
    if not len(geometry.corners) or not table.opaque[geometry.surface].all():
        return None
    if geometry not in _built:
        _built[geometry] = build(geometry)
    return _built[geometry]


def with_nodes(table: ReflectionTable, radar: Radar) -> ReflectionTable:
    """Return a table with at least NODES frequency nodes over the radar's sweep."""
    if len(table.frequencies_hz) >= NODES:
        return table
    low = radar.start_frequency_hz
    nodes = chebyshev_nodes(low, low + radar.sampled_bandwidth_hz, NODES)
    basis = lagrange_basis(table.frequencies_hz, nodes)
    names = ("te", "tm", "through_te", "through_tm")
    return replace(table, frequencies_hz=nodes, **{name: getattr(table, name) @ basis for name in names})


def paths(
    body: Polyhedron, table: ReflectionTable, source: np.ndarray, receiver: np.ndarray, transmit: np.ndarray, receive: np.ndarray,
    max_bounces: int, fringes: bool = True,
) -> Hits:  # fmt: skip
    """Return the paths of N pairs of a source and a receiver over an object, in the object's frame.

    Args:
        table: reflection of the object's surfaces at Q frequencies.
        source, receiver: (N, 3) metres. transmit, receive: (N, 3) antenna axes.
        max_bounces: largest number of reflections. fringes: whether edges have fringe currents.
    Returns:
        Hits, ordered by pair; `pose` is the index of the pair. Signals have the phase factor exp(+j k L).
    """
    q = len(table.frequencies_hz)
    wavenumbers = 2 * np.pi * table.frequencies_hz / SPEED_OF_LIGHT
    together = np.abs(source - receiver).max(axis=1) < PLANE_M
    places = [np.ascontiguousarray(vectors, float) for vectors in (source, receiver + NUDGE_M, transmit, receive)]
    most = 1 if body.convex else max_bounces
    shared = _Body(body, Tables.of(table.te, table.tm, table.through_te, table.through_tm), wavenumbers)
    arguments = shared, *places, together, most, fringes

    def written(begin: int, stop: int, rows: int) -> list[np.ndarray] | None:
        length, departure, arrival = np.empty((3, rows, 3))
        out = _Out(np.empty((rows, q), np.complex128), length, departure, arrival, np.empty(rows, np.int64), np.zeros(1, np.int64))
        pair = np.empty(rows, np.int64)
        fits = _all(begin, stop, *arguments, out, pair)
        return [array[: out.count[0]] for array in (pair, *out[:5])] if fits else None

    pair, amplitude, length, departure, arrival, bounces = gathered(written, len(source), FIRST_ROWS)
    return Hits(pair, bounces, amplitude, length[:, 0], length[:, 1], departure, arrival, length[:, 2])


@compiled
def _all(
    begin: int, stop: int, body: _Body, source: np.ndarray, receiver: np.ndarray, transmit: np.ndarray, receive: np.ndarray,
    together: np.ndarray, most: int, fringes: bool, out: _Out, pair: np.ndarray,
) -> bool:  # fmt: skip
    """Write the paths of pairs `begin` to `stop` - 1; returns False if `out` is too short."""
    first = 0
    beams, others = _beams(len(out.bounces) // PER_BEAM, most), _beams(len(out.bounces) // PER_BEAM, most)
    pieces, counts = np.empty((len(out.bounces) // PER_PIECE, CORNERS, 3)), np.empty(len(out.bounces) // PER_PIECE, np.int64)
    for n in range(begin, stop):
        wavenumber = body.wavenumbers[len(body.wavenumbers) // 2]
        reach = reach_around(body.shape.centre, body.shape.radius, source[n], receiver[n], wavenumber)
        ends = _Ends(source[n], receiver[n], transmit[n], receive[n], together[n], reach)
        number = _follow(body, ends.source, beams, pieces, counts)
        if number < 0 or not _reflections(body, ends, beams, number, pieces, counts, out):
            return False
        if fringes:
            back, received = beams, number
            if not together[n]:
                back, received = others, _follow(body, ends.receiver, others, pieces, counts)
            if received < 0 or not _fringes(body, ends, beams, number, back, received, out):
                return False
        pair[first : out.count[0]] = n
        first = out.count[0]
    return True


@inner
def _beams(capacity: int, most: int) -> _Beams:
    chain, polygon = np.empty((capacity, most), np.int64), np.empty((capacity, CORNERS, 3))
    return _Beams(chain, np.empty(capacity, np.int64), np.empty((capacity, 3)), polygon, np.empty(capacity, np.int64))


@innermost
def _side(apex: np.ndarray, a: Vector, b: Vector, middle: Vector) -> Vector:
    """Return the unit normal of the plane through an apex and a side of a polygon, towards the polygon's middle; zero for no side."""
    normal = cross(toward(apex, a, 1.0), toward(apex, b, 1.0))
    size = norm(normal)
    if size < 1e-12 * max(1.0, dot(toward(apex, a, 1.0), toward(apex, a, 1.0))):
        return ZERO
    return moved(ZERO, normal, (1.0 if dot(normal, toward(apex, middle, 1.0)) >= 0 else -1.0) / size)


@inner
def _subtract(
    body: _Body, p: int, apex: np.ndarray, last: int, facing: float, pieces: np.ndarray, counts: np.ndarray, spare: np.ndarray
) -> int:
    """Subtract from a convex piece of face `p`, the first of `pieces`, the shadows of all other faces, seen from an apex. Write the
    remaining convex pieces to `pieces`. Returns the number of pieces, or -1 if `pieces` is too short.

    Args:
        last: face behind which the apex is an image, or -1; only parts of faces on the `facing` (+-1) side of this face cast shadows.
        pieces: (pieces, CORNERS, 3), counts: (pieces,). spare: (4, CORNERS, 3).
    """
    faces, parts = body.shape.faces, body.shape.parts
    height = dot(apex, faces.normal[p]) - faces.offset[p]
    up = 1.0 if height > 0 else -1.0
    up_way, down_way, ground = moved(ZERO, faces.normal[p], up), moved(ZERO, faces.normal[p], -up), up * faces.offset[p]
    number, normals = 1, np.empty((CORNERS, 3))
    for q in range(len(parts.face)):
        f = parts.face[q]
        if f in (p, last) or number == 0:
            continue
        above = dot(apex, faces.normal[f]) - faces.offset[f]
        if abs(above) < PLANE_M or (parts.solid[f] and above < 0):  # of a solid, the faces towards the apex cast the whole shadow
            continue
        highest = -np.inf
        for i in range(parts.count[q]):
            highest = max(highest, dot(up_way, parts.corner[q, i]) - ground)
        if highest < PLANE_M:
            continue
        # the part of the other face that is above face `p` and below the apex casts the shadow
        copy(parts.corner[q], parts.count[q], spare[0])
        count = clip(spare[0], parts.count[q], up_way, ground, spare[1])
        count = clip(spare[1], count, down_way, -ground - ABOVE * abs(height), spare[0]) if count else 0
        if count and last >= 0:
            count = clip(spare[0], count, moved(ZERO, faces.normal[last], facing), facing * faces.offset[last], spare[1])
            copy(spare[1], count, spare[0])
        if count == 0 or twice_area(spare[0], count) < SLIVER_M2:
            continue
        # the planes through the apex and the sides of this part bound the shadow
        before, number, inside = number, 0, middle_of(spare[0], count)
        fresh, sizes = np.empty_like(pieces), np.empty_like(counts)
        for i in range(count):
            put(normals, i, _side(apex, vector(spare[0], i), vector(spare[0], (i + 1) % count), inside))
        for j in range(before):
            copy(pieces[j], counts[j], spare[1])
            rest = counts[j]
            # a piece that lies wholly outside one side of the shadow is not divided
            apart = False
            for i in range(count):
                outmost = -np.inf
                for c in range(rest):
                    outmost = max(outmost, dot(normals[i], spare[1, c]) - dot(normals[i], apex))
                apart = apart or outmost < 1e-9
            if number + count + 1 > len(pieces):
                return -1
            if apart:
                copy(spare[1], rest, fresh[number])
                sizes[number] = rest
                number += 1
                continue
            # the part of the piece outside each side of the shadow remains; the next sides divide what is inside
            for i in range(count):
                inwards, offset = vector(normals, i), dot(normals[i], apex)
                size = clip(spare[1], rest, moved(ZERO, inwards, -1.0), -offset, spare[2])
                if size and twice_area(spare[2], size) > SLIVER_M2:
                    copy(spare[2], size, fresh[number])
                    sizes[number] = size
                    number += 1
                rest = clip(spare[1], rest, inwards, offset, spare[3])
                if rest == 0:
                    break
                copy(spare[3], rest, spare[1])
        for j in range(number):
            copy(fresh[j], sizes[j], pieces[j])
            counts[j] = sizes[j]
    return number


@inner
def _follow(body: _Body, place: np.ndarray, beams: _Beams, pieces: np.ndarray, counts: np.ndarray) -> int:
    """Write the beams of a place over all sequences of faces that are shorter than a chain; returns their number, or -1 if there is no room
    for all of them.
    """
    faces, parts, spare, planes = body.shape.faces, body.shape.parts, np.empty((4, CORNERS, 3)), np.empty((CORNERS + 1, 4))
    count, beams.image[0], beams.order[0], beams.count[0] = 1, place, 0, 0
    b = 0
    while b < count:
        apex, m = beams.image[b], beams.order[b]
        last = beams.chain[b, m - 1] if m else NO_FACE
        facing = 1.0
        if m and dot(apex, faces.normal[last]) > faces.offset[last]:
            facing = -1.0
        bounds = beam_planes(faces, last, vector(beams.image, b), 0.0, beams.polygon[b], beams.count[b], ALL_AROUND, planes)
        for k in range(len(parts.face)):
            p = parts.face[k]
            height = dot(apex, faces.normal[p]) - faces.offset[p]
            if m == beams.chain.shape[1] or p == last or abs(height) < PLANE_M or (parts.solid[p] and height < 0):
                continue
            size = parts.count[k]
            copy(parts.corner[k], size, spare[0])
            for i in range(bounds):
                size = clip(spare[0], size, vector(planes, i), planes[i, 3], spare[1]) if size else 0
                copy(spare[1], size, spare[0])
            if size == 0 or twice_area(spare[0], size) < SLIVER_M2:
                continue
            copy(spare[0], size, pieces[0])
            counts[0] = size
            number = _subtract(body, p, apex, last, facing, pieces, counts, spare)
            if number < 0 or count + number > len(beams.order):
                return -1
            for j in range(number):
                copy(pieces[j], counts[j], beams.polygon[count])
                beams.count[count], beams.order[count] = counts[j], m + 1
                beams.image[count] = apex - 2 * height * faces.normal[p]
                beams.chain[count, :m], beams.chain[count, m] = beams.chain[b, :m], p
                count += 1
        b += 1
    return count


@inner
def _reflections(body: _Body, ends: _Ends, beams: _Beams, number: int, pieces: np.ndarray, counts: np.ndarray, out: _Out) -> bool:
    """Write the paths over the faces of all beams; returns False if `out` is too short."""
    faces, spare = body.shape.faces, np.empty((4, CORNERS, 3))
    for b in range(1, number):
        m, mirrored = beams.order[b], beams.image[b]
        p = beams.chain[b, m - 1]
        below, other = dot(mirrored, faces.normal[p]) - faces.offset[p], dot(ends.receiver, faces.normal[p]) - faces.offset[p]
        if other * below >= 0 or abs(other) < PLANE_M:
            continue
        apex = mirrored - 2 * below * faces.normal[p]
        copy(beams.polygon[b], beams.count[b], pieces[0])
        counts[0], visible = beams.count[b], 1
        if m > 1 or not ends.together:
            visible = _subtract(body, p, ends.receiver, NO_FACE, 1.0, pieces, counts, spare)
            if visible < 0:
                return False
        for i in range(visible):
            if not _polygon(body, ends, beams.chain[b, :m], apex, mirrored, pieces[i], counts[i], out):
                return False
    return True


@innermost
def _leaving(faces: Faces, chain: np.ndarray, apex: np.ndarray, x: np.ndarray) -> tuple[Vector, float]:
    """Return the direction in which a path to x leaves a place whose image in a chain is `apex`, and the length of the path."""
    length = distance(apex, x)
    return image(faces, toward(apex, x, length), chain[::-1], 0.0), length


@inner
def _arriving(body: _Body, antenna: np.ndarray, chain: np.ndarray, image: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Write the field (Q, 3) of an antenna at x after the reflections of a chain, without spreading and phase."""
    way, _ = _leaving(body.shape.faces, chain, image, x)
    polarised(out, transverse(antenna, way))
    reflected(body.shape.faces, body.tables, out, way, chain)


@inner
def _factor(
    body: _Body, ends: _Ends, there: np.ndarray, apex: np.ndarray, back: np.ndarray, receiver: np.ndarray, x: np.ndarray, shade: float,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Write rho (Q,) at a point of the last face of the chain `there`.

    apex: source, mirrored at all faces of `there` but the last. receiver: mirrored at the faces of `back`.
    shade: factor of the currents of the incident field, which form the shadow.
    """
    k, s = toward(apex, x, distance(apex, x)), toward(x, receiver, distance(x, receiver))
    n = vector(body.shape.faces.normal, there[len(there) - 1])
    if dot(k, n) > 0:
        n = -n[0], -n[1], -n[2]
    mirrored = moved(k, n, -2 * dot(k, n))
    field, got = np.empty((len(out), 3), np.complex128), np.empty((len(out), 3), np.complex128)
    _arriving(body, ends.transmit, there[: len(there) - 1], apex, x, field)
    _arriving(body, ends.receive, back, receiver, x, got)
    sight = dot(n, s) - dot(n, k)
    for q in range(len(out)):
        out[q] = -shade * _radiated(n, k, field, got, s, q) / sight if shade else 0j
    reflected(body.shape.faces, body.tables, field, k, there[len(there) - 1 :])
    for q in range(len(out)):
        out[q] -= _radiated(n, mirrored, field, got, s, q) / sight


@innermost
def _radiated(n: Vector, k: Vector, field: np.ndarray, got: np.ndarray, s: Vector, q: int) -> complex:
    """Return g . [n x (k x E) + (E x n) x s], what the currents of a field E of direction k radiate in direction s to an antenna g."""
    n_e, s_e, n_g, k_g, e_g = 0j, 0j, 0j, 0j, 0j
    for i in range(3):
        e, g = field[q, i], got[q, i]
        n_e, s_e, n_g, k_g, e_g = n_e + n[i] * e, s_e + s[i] * e, n_g + n[i] * g, k_g + k[i] * g, e_g + e * g
    return k_g * n_e + n_g * s_e - e_g * (dot(n, k) + dot(n, s))


@innermost
def _moments(alpha: float) -> tuple[complex, complex, complex]:
    """Return the integrals of exp(j alpha t), t exp(j alpha t) and t^2 exp(j alpha t) for t from -1 to 1."""
    if abs(alpha) < 0.3:
        x = alpha * alpha
        m0 = 2 * (1 - x / 6 * (1 - x / 20 * (1 - x / 42)))
        m1 = 2 * alpha * (1 / 3 - x / 30 * (1 - x / 28 * (1 - x / 54)))
        m2 = 2 * (1 / 3 - x / 10 * (1 - x / 16.8 * (1 - x / 38.57142857142857)))
        return complex(m0, 0.0), complex(0.0, m1), complex(m2, 0.0)
    sine, cosine = math.sin(alpha), math.cos(alpha)
    m0 = 2 * sine / alpha
    m1 = 2 * (sine - alpha * cosine) / (alpha * alpha)
    m2 = 2 * ((alpha * alpha - 2) * sine + 2 * alpha * cosine) / (alpha * alpha * alpha)
    return complex(m0, 0.0), complex(0.0, m1), complex(m2, 0.0)


@innermost
def _piece(f0: complex, f1: complex, f2: complex, p0: float, p2: float) -> complex:
    """Return the integral of f exp(j p) for t from -1 to 1, from the values of f at -1, 0 and 1 and of p at -1 and 1; p is 0 at 0.

    f is a parabola. The quadratic part of the phase is expanded to first order about its mean.
    """
    alpha, beta = 0.5 * (p2 - p0), 0.5 * (p0 + p2)
    m0, m1, m2 = _moments(alpha)
    slope, bend = 0.5 * (f2 - f0), 0.5 * (f0 + f2) - f1
    mean = complex(math.cos(beta / 3), math.sin(beta / 3))
    # the moments of t^3 and t^4 are those of their best parabolas, because slope and bend are small where beta matters
    plain = f1 * m0 + slope * m1 + bend * m2
    curved = 1j * beta * (f1 * (m2 - m0 / 3) + slope * 4 / 15 * m1 + bend * (11 / 21 * m2 - 3 / 35 * m0))
    return mean * (plain + curved)


@innermost
def _boundary(mirrored: np.ndarray, receiver: np.ndarray, x: Vector, side: np.ndarray) -> float:
    """Return b/L0 at a point of a side with a unit direction."""
    r, s = toward(mirrored, x, 1.0), toward(receiver, x, 1.0)
    across, product = cross(r, s), math.sqrt(dot(r, r) * dot(s, s))
    square = dot(across, across)
    if square < 1e-30:
        return 0.0
    return -dot(across, side) * (product - dot(r, s)) / (4 * math.pi * product * square)


@innermost
def _weight(phase: float) -> float:
    """Return the share of a side's contribution that has its own path."""
    t = min(max((phase - NEAR) / (FAR - NEAR), 0.0), 1.0)
    return t * t * (3 - 2 * t)


@innermost
def _over(a: Point, b: Point, x: Point) -> float:
    """Return the length of the path from a over a point to b."""
    return distance(a, x) + distance(b, x)


@inner
def _divisions(a: np.ndarray, b: np.ndarray, source: np.ndarray, receiver: np.ndarray, wavenumber: float) -> tuple[int, int]:
    """Return into how many pieces a line from a to b is divided, and in how many parts factors of the field are interpolated."""
    along = b - a
    size = math.sqrt(dot(along, along))
    nearest = np.inf
    for end in (source, receiver):
        t = min(max(dot(end - a, along) / (size * size), 0.0), 1.0)
        nearest = min(nearest, distance(end, a + t * along))
    low, high = _over(source, receiver, a), _over(source, receiver, b)
    # the quadratic phase of a piece of length h is k (2/nearest) (h/2)^2/2 or less
    pieces = max(size / (VIEW_RAD * nearest), size * math.sqrt(wavenumber / (4 * CURVE_RAD * nearest)))
    return math.ceil(max(pieces, abs(high - low) / DEPTH_M)), math.ceil(size / (SMOOTH_RAD * nearest))


@inner
def _add(
    faces: Faces, ends: _Ends, there: np.ndarray, image: np.ndarray, back: np.ndarray, other: np.ndarray, x: np.ndarray,
    amplitude: np.ndarray, out: _Out,
) -> bool:  # fmt: skip
    """Append a path with one hit at x between the chains `there` and `back`; returns False if `out` is too short.

    image, other: source and receiver, mirrored at the faces of their chain.
    """
    n = out.count[0]
    if n == len(out.bounces):
        return False
    way, out.length[n, 0] = _leaving(faces, there, image, x)
    arrival, out.length[n, 1] = _leaving(faces, back, other, x)
    out.length[n, 2] = out.length[n, 0]
    if len(there):
        normal = vector(faces.normal, there[0])
        out.length[n, 2] = (faces.offset[there[0]] - dot(normal, ends.source)) / dot(normal, way)
    put(out.departure, n, way)
    put(out.arrival, n, arrival)
    out.amplitude[n] = amplitude
    out.bounces[n] = 1 + len(there) + len(back)
    out.count[0] += 1
    return True


@inner
def _edge_of(faces: Faces, parts: _Parts, chain: np.ndarray, images: np.ndarray, a: np.ndarray, b: np.ndarray) -> int:
    """Move a side of a lit polygon, with the ends a and b, back along its rays to the edge that bounds the light there, and return the
    place in the chain of the face that this edge belongs to. The shadows of other faces stay on the last face.

    images: (len(chain) + 1, 3) of the source.
    """
    if len(chain) == 1:
        return 0
    first, second = a.copy(), b.copy()
    for m in range(len(chain) - 1, -1, -1):
        n, offset = faces.normal[chain[m]], faces.offset[chain[m]]
        if m < len(chain) - 1:
            for x in (first, second):
                below, above = dot(images[m + 1], n) - offset, dot(x, n) - offset
                x += above / (above - below) * (images[m + 1] - x)
        middle = 0.5 * (first + second)
        for k in range(len(parts.face)):
            if parts.face[k] != chain[m]:
                continue
            for i in range(parts.count[k]):
                corner = parts.corner[k, i]
                along = parts.corner[k, (i + 1) % parts.count[k]] - corner
                square = dot(along, along)
                aside = np.cross(middle - corner, along)
                if dot(aside, aside) < PLANE_M * PLANE_M * square and 0 < dot(middle - corner, along) < square:
                    a[:], b[:] = first, second
                    return m
    return len(chain) - 1


@inner
def _polygon(
    body: _Body, ends: _Ends, chain: np.ndarray, apex: np.ndarray, mirrored: np.ndarray, polygon: np.ndarray, count: int, out: _Out
) -> bool:
    """Write the paths of one convex polygon on the last face of a chain; returns False if `out` is too short."""
    p, before, none = chain[len(chain) - 1], chain[: len(chain) - 1], chain[:0]
    faces, wavenumbers, receiver, nodes = body.shape.faces, body.wavenumbers, ends.receiver, len(body.wavenumbers)
    images = np.empty((len(chain) + 1, 3))
    images[0] = ends.source
    images_of(faces, ends.source, chain, images[1:])
    wavenumber = wavenumbers[nodes // 2]
    normal = faces.normal[p]
    above, below = dot(receiver, normal) - faces.offset[p], dot(mirrored, normal) - faces.offset[p]
    # the line from S (`mirrored`) to the receiver, of length L0 (`straight`), meets the plane of the face at the mirror point
    share = below / (below - above)
    mirror = mirrored + share * (receiver - mirrored)
    straight = distance(mirrored, receiver)
    up = normal if above > 0 else -normal
    # orientation of the polygon, position of the mirror point relative to each side, and the polygon's point nearest to the mirror point
    area = np.zeros(3)
    for i in range(1, count - 1):
        area += np.cross(polygon[i] - polygon[0], polygon[i + 1] - polygon[0])
    sense = 1.0 if dot(area, up) > 0 else -1.0
    inside, closest, within = True, np.inf, np.zeros(count)
    nearest = mirror.copy()
    for i in range(count):
        a, b = polygon[i], polygon[(i + 1) % count]
        along = b - a
        square = dot(along, along)
        if square < 1e-18:
            continue
        within[i] = sense * dot(np.cross(a - mirrored, a - receiver), along) / math.sqrt(square)
        inside = inside and within[i] >= 0
        foot = a + min(max(dot(mirror - a, along) / square, 0.0), 1.0) * along
        if distance(foot, mirror) < closest:
            closest = distance(foot, mirror)
            nearest = foot
    if inside:
        nearest = mirror
    together = np.zeros(nodes, np.complex128)
    rest_m = _over(mirrored, receiver, nearest)
    joined = inside or wavenumber * (rest_m - straight) < FAR
    rho, scale = np.empty(nodes, np.complex128), 0.5 / wavenumbers  # wavelength/(4 pi)
    if inside:  # the term W rho_0
        _factor(body, ends, chain, apex, none, receiver, mirror, 0.0, rho)
        for q in range(nodes):
            together[q] = scale[q] / straight * rho[q].conjugate()
    # the term of the integral of rho b exp(+j k E), side by side
    amplitude = np.empty(nodes, np.complex128)
    for i in range(count):
        a, b = polygon[i].copy(), polygon[(i + 1) % count].copy()
        m = _edge_of(faces, body.shape.parts, chain, images, a, b)
        there, back = chain[: m + 1], chain[m + 1 :][::-1].copy()
        apex, mirrored, receiver = images[m], images[m + 1], np.array(image(faces, ends.receiver, back, 1.0))
        size = distance(a, b)
        if size < 1e-9:
            continue
        along = (b - a) / size
        pieces, smooth = _divisions(a, b, mirrored, receiver, wavenumber)
        known = np.empty((2 * smooth + 1, nodes), np.complex128)
        shade = 1 - edge_share(a, along, apex, receiver, wavenumber, ends.reach)
        for j in range(2 * smooth + 1):
            _factor(body, ends, there, apex, back, receiver, a + (j / (2 * smooth)) * (b - a), shade, rho)
            for q in range(nodes):
                known[j, q] = rho[q].conjugate()
        foot = keller(a, along, mirrored, receiver)
        close = wavenumber * (_over(mirrored, receiver, moved(a, along, foot)) - straight) < FAR
        joined = joined or close
        # |r x s|^2 = |across|^2 (width^2 + (t - centre)^2), so that t = centre + width sinh(u) removes the pole of b at the mirror point.
        # `within` decides both W and the sign of b. Otherwise, rounding errors near a side would change the sum of both.
        across = np.cross(along, mirrored - receiver)
        square = max(dot(across, across), 1e-12 * straight * straight)
        centre = -dot(np.cross(a - mirrored, a - receiver), across) / square
        volume = dot(np.cross(a - mirrored, a - receiver), along)
        width = max(abs(volume) * straight / square, CLOSEST_M)
        around = (-1.0 if within[i] >= 0 else 1.0) / (16 * math.pi * straight)
        half = 0.5 * size / pieces
        turned = sense if (len(chain) - m) % 2 else -sense  # every mirror reverses the sides
        for j in range(pieces):
            t1 = (2 * j + 1) * half
            t0, t2 = t1 - half, t1 + half
            x1 = a + t1 * along
            reference = _over(mirrored, receiver, x1)
            if close and wavenumber * (_over(mirrored, receiver, moved(a, along, min(max(foot, t0), t2))) - straight) < FAR:
                # near the mirror point, quadrature over u; the weight divides it between this piece and the path of the mirror reflection
                amplitude[:] = 0
                u0, u2 = math.asinh((t0 - centre) / width), math.asinh((t2 - centre) / width)
                panels = math.ceil(max(u2 - u0, 1.0))
                step = (u2 - u0) / panels
                for panel in range(panels):
                    for g in range(len(_GAUSS)):
                        u = u0 + (panel + 0.5 + 0.5 * _GAUSS[g]) * step
                        t = centre + width * math.sinh(u)
                        x = moved(a, along, t)
                        r, s = distance(mirrored, x), distance(receiver, x)
                        density = around * _WEIGHT[g] * step * (straight * straight - (r - s) ** 2) / (r * s * math.cosh(u))
                        length = r + s
                        w = _weight(wavenumber * (length - straight))
                        for q in range(nodes):
                            value = density * scale[q] * _parabola(known, smooth, t / size, q)
                            if w < 1:
                                phase = wavenumbers[q] * (length - straight)
                                together[q] += (1 - w) * value * complex(math.cos(phase), math.sin(phase))
                            if w > 0:
                                phase = wavenumbers[q] * (length - reference)
                                amplitude[q] += w * value * complex(math.cos(phase), math.sin(phase))
            else:
                # elsewhere, parabolas for rho b and a quadratic phase k E
                x0, x2 = moved(a, along, t0), moved(a, along, t2)
                b0 = turned * half * _boundary(mirrored, receiver, x0, along)
                b1 = turned * half * _boundary(mirrored, receiver, moved(a, along, t1), along)
                b2 = turned * half * _boundary(mirrored, receiver, x2, along)
                e0, e2 = _over(mirrored, receiver, x0) - reference, _over(mirrored, receiver, x2) - reference
                for q in range(nodes):
                    amplitude[q] = scale[q] * _piece(
                        b0 * _parabola(known, smooth, t0 / size, q), b1 * _parabola(known, smooth, t1 / size, q),
                        b2 * _parabola(known, smooth, t2 / size, q), wavenumbers[q] * e0, wavenumbers[q] * e2,
                    )  # fmt: skip
            if np.abs(amplitude).max() > 0 and not _add(faces, ends, there[:m], apex, back, receiver, x1, amplitude, out):
                return False
    if not joined:
        return True
    for q in range(nodes):
        phase = wavenumbers[q] * (straight - rest_m)
        together[q] *= complex(math.cos(phase), math.sin(phase))
    return _add(faces, ends, before, images[len(before)], none, ends.receiver, nearest, together, out)


@innermost
def _parabola(known: np.ndarray, parts: int, place: float, q: int) -> complex:
    """Return a value at `place` (0 to 1) from values (2 parts + 1, Q) at equal steps, by a parabola through three of them."""
    i = min(max(int(place * parts), 0), parts - 1)
    t = 2 * (place * parts - i) - 1
    f0, f1, f2 = known[2 * i, q], known[2 * i + 1, q], known[2 * i + 2, q]
    return f1 + t * (0.5 * (f2 - f0) + t * (0.5 * (f0 + f2) - f1))


@innermost
def _excess(x: float, n: float, taken: complex) -> complex:
    """Return cot(x/(2 n))/n, minus the share `taken` of cot(x/2)."""
    if abs(x) < 1e-4:
        return x / 6 * (1 - 1 / (n * n)) + ((1 - taken) * 2 / x if taken != 1 else 0)
    return 1 / (n * math.tan(x / (2 * n))) - taken / math.tan(x / 2)


@innermost
def _contained(a: float, b: float, shaded: float) -> tuple[float, float]:
    """Return the shares of the reflected lobe and of the shadow lobe of a face that polygons and shadow contain.

    a, b: as in `_beyond`; a is positive if the face is lit. shaded: share of the edge's wave in the object's shadow.
    """
    if a <= 0:
        return 0.0, 0.0
    return (1.0, 1.0) if b < math.pi else (0.0, shaded)


@innermost
def _between(a: float, b: float, reach: float) -> complex:
    """Return the part of the shadow lobe of a face that the shadow moves to an edge because the outline lies between both edges of a face
    seen edge-on (`silhouette`), relative to the lobe, for exp(-j k L). The arguments are those of `_beyond`.
    """
    outer = a * a * reach / math.pi
    if outer >= 1:
        return 0j
    weight = (1 - outer) ** 2
    phase = -reach * (math.cos(a) - math.cos(b))
    return (1 - complex(math.cos(phase), math.sin(phase))) * (-1 if a > 0 else 1) * weight / (1 + weight)


@innermost
def _beyond(a: float, b: float, reach: float) -> complex:
    """Return the share of the grazing fringe currents on an infinite face that lies beyond the end of a face, for exp(-j k L).

    The currents of an edge's wave along a face are those of a half-plane, a Fresnel integral. They radiate the pole 1/(a + b) of the
    wedge's coefficient if the face is infinite. The share is 1 for a short face and 0 for a long one.

    Args:
        a, b: angles in rad between the plane of the face and the rays of source and receiver. reach: wavenumber times length of the face.
    """
    if max(abs(a), b) > 0.5 * math.pi or b < 0:
        return 0j
    s_a, s_b, scale = math.sin(0.5 * abs(a)), math.sin(0.5 * b), math.sqrt(2 * reach)
    u_a, u_b = scale * s_a, scale * s_b
    if max(u_a, u_b) < 0.03:  # series, so that the product of pole and 1 - share stays finite
        share = 1 - 1j * u_b * (u_a + u_b)
    else:
        if abs(u_a - u_b) < 1e-3 * (u_a + u_b):
            rest = scaled_tail(u_a) * (1 - 2j * u_a * u_a) + u_a
        else:
            rest = (u_b * scaled_tail(u_a) - u_a * scaled_tail(u_b)) / (u_b - u_a)
        phase = 0.25 * math.pi - u_b * u_b
        share = 2 / math.sqrt(math.pi) * complex(math.cos(phase), math.sin(phase)) * rest
    return math.cos(a) * math.cos(b) * share


@inner
def _width(faces: Faces, p: int, x: np.ndarray, way: np.ndarray) -> float:
    """Return the distance in metres from a point on the border of face `p` along a direction in its plane to the opposite border."""
    least = np.inf
    for i in range(faces.corners[p]):
        corner = faces.outline[p, i]
        outwards = np.cross(faces.outline[p, (i + 1) % faces.corners[p]] - corner, faces.normal[p])
        slope = dot(way, outwards)
        if slope > 1e-6 * math.sqrt(dot(outwards, outwards)):
            least = min(least, max(dot(corner - x, outwards), 0.0) / slope)
    return least


@inner
def _fringe(
    body: _Body, source: np.ndarray, receiver: np.ndarray, sent: np.ndarray, got: np.ndarray, e: int, x: np.ndarray, shaded: float,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Write the received strength (Q,) of the fringe currents of edge `e` at x, per metre of the edge, without spreading and phase.

    source, receiver: (3,) the antennas' images. sent, got: (Q, 3) fields of the antennas at x.
    shaded: share of the edge's wave that the shadow of the object contains.
    """
    out[:] = 0
    faces, tables, wavenumber = body.shape.faces, body.tables, body.wavenumbers[len(body.wavenumbers) // 2]
    before, after = x - source, receiver - x
    before /= math.sqrt(dot(before, before))
    after /= math.sqrt(dot(after, after))
    along, n = faces.along[e], faces.opening[e]
    cosine, other = dot(before, along), dot(after, along)
    if min(1 - cosine * cosine, 1 - other * other) < SMALL_SINE * SMALL_SINE:
        return
    phi0 = angle(faces, e, -before)
    phi = angle(faces, e, after)
    if max(phi, phi0) > n * math.pi:
        return
    sine = math.sqrt(1 - cosine * cosine)
    # Angles of source and receiver above the plane of each face, seen from the edge's continuation; both are small for grazing rays.
    a0, b0, an, bn = math.pi - phi0, phi, phi0 - (n - 1) * math.pi, n * math.pi - phi
    intn = math.cos(n * math.pi) * faces.into[e] + math.sin(n * math.pi) * faces.up[e]
    reach0 = wavenumber * sine * _width(faces, faces.sides[e, 0], x, faces.into[e])
    reachn = wavenumber * sine * _width(faces, faces.sides[e, 1], x, intn)
    short0, shortn = _beyond(a0, b0, reach0), _beyond(an, bn, reachn)
    # The same for a face that the source grazes, where the receiver is near the face's continuation
    begun0, begunn = _beyond(math.pi - phi, phi0, reach0), _beyond(math.pi - bn, n * math.pi - phi0, reachn)
    # The shares of physical optics: the polygons contain both lobes on the receiver's side of a lit face, the shadow contains the other.
    mirrored0, shadow0 = _contained(a0, b0, shaded)
    mirroredn, shadown = _contained(an, bn, shaded)
    net = shadown - shadow0
    taken = shortn * (1 + net) - short0 * (1 - net) - net - shaded * (_between(an, bn, reachn) - _between(a0, b0, reach0))
    if phi > phi0:  # cot(x/2) of both shadow terms is equal, but for the sign
        shadow = _excess(math.pi - (phi - phi0), n, taken) + _excess(math.pi + (phi - phi0), n, 0j)
    else:
        shadow = _excess(math.pi - (phi - phi0), n, 0j) + _excess(math.pi + (phi - phi0), n, -taken)
    mirror0 = _excess(math.pi - (phi + phi0), n, mirrored0 + (short0 + begun0) * (1 - mirrored0))
    mirrorn = _excess(math.pi + (phi + phi0) - 2 * n * math.pi, n, mirroredn + (shortn + begunn) * (1 - mirroredn))
    enters, leaves = soft_and_hard(along, before), soft_and_hard(along, after)
    for q in range(len(out)):
        ss0, sh0, hh0 = face_matrix(tables, faces.surface[faces.sides[e, 0]], q, phi, phi0, sine, cosine)
        ssn, shn, hhn = face_matrix(tables, faces.surface[faces.sides[e, 1]], q, n * math.pi - phi, n * math.pi - phi0, sine, -cosine)
        soft = shadow + ss0 * mirror0 + ssn * mirrorn
        hard = shadow + hh0 * mirror0 + hhn * mirrorn
        mixed = sh0 * mirror0 + shn * mirrorn
        s_in, h_in, s_out, h_out = 0j, 0j, 0j, 0j
        for k in range(3):
            s_in, h_in = s_in + sent[q, k] * enters[0][k], h_in + sent[q, k] * enters[1][k]
            s_out, h_out = s_out + got[q, k] * leaves[0][k], h_out + got[q, k] * leaves[1][k]
        total = s_out * (soft * s_in + mixed * h_in) + h_out * (hard * h_in - mixed * s_in)
        out[q] = -total.conjugate() / (4 * math.pi)


@inner
def _lit(faces: Faces, beams: _Beams, number: int) -> np.ndarray:
    """Return the parts (B, E, 2) of all edges in metres that lie inside each beam that may be reflected once more, in the open sector of
    the edge; an empty part has high <= low.
    """
    lit, planes = np.zeros((number, len(faces.length), 2)), np.empty((CORNERS + 1, 4))
    for b in range(number):
        m, place = beams.order[b], vector(beams.image, b)
        if m == beams.chain.shape[1]:
            continue
        last = beams.chain[b, m - 1] if m else NO_FACE
        bounds = beam_planes(faces, last, place, 0.0, beams.polygon[b], beams.count[b], ALL_AROUND, planes)
        for e in range(len(faces.length)):
            a = vector(faces.start, e)
            if last in (faces.sides[e, 0], faces.sides[e, 1]):
                continue
            if angle(faces, e, toward(a, place, 1.0)) > faces.opening[e] * math.pi:
                continue
            lit[b, e] = part_inside(planes, bounds, a, vector(faces.along, e), faces.length[e])
    return lit


@inner
def _open(faces: Faces, tree: Hierarchy, beams: _Beams, b: int, x: np.ndarray, crossed: np.ndarray) -> bool:
    """Return whether nothing is between a point and the last face of a beam, or the place of the beams."""
    start = beams.image[b]
    if beams.order[b]:
        last = beams.chain[b, beams.order[b] - 1]
        below, above = dot(start, faces.normal[last]) - faces.offset[last], dot(x, faces.normal[last]) - faces.offset[last]
        start = start + below / (below - above) * (x - start)
    return obstacles.crossed(tree, start, x, np.ones(1, np.bool_), crossed) >= 0


@inner
def _fringes(body: _Body, ends: _Ends, beams: _Beams, number: int, others: _Beams, received: int, out: _Out) -> bool:
    """Write the paths of fringe currents along all edges in the beams of source and receiver; returns False if `out` is too short.

    others: beams of the receiver.
    """
    faces = body.shape.faces
    lit = _lit(faces, beams, number)
    seen = lit if ends.together else _lit(faces, others, received)
    for e in range(len(faces.length)):
        if faces.opening[e] <= 1:  # currents in an inner corner are those of several reflections
            continue
        for b in range(number):
            for c in range(received):
                low, high = max(lit[b, e, 0], seen[c, e, 0]), min(lit[b, e, 1], seen[c, e, 1])
                if beams.order[b] + others.order[c] >= beams.chain.shape[1] or high - low < SHORTEST_M:
                    continue
                if not _edge(body, ends, e, low, high, beams, b, others, c, out):
                    return False
    return True


@inner
def _edge(body: _Body, ends: _Ends, e: int, low: float, high: float, beams: _Beams, b: int, others: _Beams, c: int, out: _Out) -> bool:
    """Write the paths of fringe currents along a part of an edge, out over beam `b` and back over beam `c` of the others."""
    faces, wavenumbers, nodes = body.shape.faces, body.wavenumbers, len(body.wavenumbers)
    wavenumber = wavenumbers[nodes // 2]
    crossed = np.empty(1, np.int64)
    value, amplitude = np.empty(nodes, np.complex128), np.empty(nodes, np.complex128)
    sent, got = np.empty((nodes, 3), np.complex128), np.empty((nodes, 3), np.complex128)
    there, back, source = beams.chain[b, : beams.order[b]], others.chain[c, : others.order[c]], beams.image[b]
    receiver = np.array(image(faces, ends.receiver, back, 1.0))
    along, size = faces.along[e], high - low
    a = faces.start[e] + low * along
    pieces, smooth = _divisions(a, a + size * along, source, receiver, wavenumber)
    known = np.empty((2 * smooth + 1, nodes), np.complex128)
    shaded = edge_share(a, along, source, receiver, wavenumber, ends.reach)
    for j in range(2 * smooth + 1):
        x = a + j / (2 * smooth) * size * along
        _arriving(body, ends.transmit, there, source, x, sent)
        _arriving(body, ends.receive, back, receiver, x, got)
        _fringe(body, source, receiver, sent, got, e, x, shaded, value)
        known[j] = value
    half = 0.5 * size / pieces
    middle = 0.5 * faces.opening[e] * math.pi
    aside = 2 * obstacles.CLEAR_M * (math.cos(middle) * faces.into[e] + math.sin(middle) * faces.up[e])
    for j in range(pieces):
        t1 = (2 * j + 1) * half
        x0, x1, x2 = a + (t1 - half) * along, a + t1 * along, a + (t1 + half) * along
        if not _open(faces, body.shape.tree, beams, b, x1 + aside, crossed):
            continue
        if not (ends.together and b == c) and not _open(faces, body.shape.tree, others, c, x1 + aside, crossed):
            continue
        reference = _over(source, receiver, x1)
        e0, e2 = _over(source, receiver, x0) - reference, _over(source, receiver, x2) - reference
        spread = half / (distance(source, x1) * distance(x1, receiver))
        for q in range(nodes):
            amplitude[q] = spread * 0.5 / wavenumbers[q] * _piece(
                _parabola(known, smooth, (t1 - half) / size, q), _parabola(known, smooth, t1 / size, q),
                _parabola(known, smooth, (t1 + half) / size, q), wavenumbers[q] * e0, wavenumbers[q] * e2,
            )  # fmt: skip
        if np.abs(amplitude).max() > 0 and not _add(faces, ends, there, source, back, receiver, x1, amplitude, out):
            return False
    return True
