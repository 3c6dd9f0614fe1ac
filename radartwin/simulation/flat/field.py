"""Fields along paths of reflections and at most two edge diffractions: compiled functions, and the loop over many paths.

A path leaves the source, reflects at faces, may be diffracted at an edge, reflects again, may be diffracted at a second edge, reflects
again and ends at the receiver. The path is unfolded: faces before an edge mirror the source, faces after it mirror the receiver. The point
of diffraction is Keller's, where the unfolded path is shortest. The field is multiplied by a weight for the ends of the edge, which comes
from Fresnel integrals of the excess path lengths over the ends.

Fields use exp(+j omega t) and amplitudes without the propagation phase, for a source with a unit field at one metre. Let s1, s2, s3 be the
unfolded distances between source, edges and receiver. For parallel edges the spreading of a double diffraction is 1/sqrt(s1 s2 s3 (s1 + s2
+ s3)).
"""

import math
from typing import NamedTuple

import numpy as np

from radartwin.compiled import fixed, innermost
from radartwin.simulation.flat.crossing import cross_panes
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Point, Vector, crossed
from radartwin.simulation.flat.vectors import cross, distance, dot, moved, norm, toward, vector
from radartwin.simulation.flat.wedge import coefficients, half_plane

GRAZING_M = 1e-9  # a point closer to a plane than this is on it
ROUNDS = 40  # largest number of steps to find the two points of a double diffraction
OUTSIDE = 0.02  # a diffraction is left out if its weight for the ends of the edge is below this
INSIDE_M = 1e-5  # visibility is tested at least this far inside the ends of an edge
OUTSIDE_M = 2e-6  # visibility is tested this far outside an edge
NUDGE = 0.05 * np.array([0.74, 0.53, 0.41])  # offset of the sensor in tests whether a path exists, in units of 1/k
SMALL_SINE = 1e-3  # smallest sine between ray and edge for which an edge diffracts
CORNER = 2.0  # successive reflections closer than this, in units of 1/k, are at a corner, where their order is arbitrary


class Tables(NamedTuple):
    """Hold the tables (surfaces, COSINES, Q) of a `ReflectionTable` for compiled functions."""

    te: np.ndarray
    tm: np.ndarray
    through_te: np.ndarray
    through_tm: np.ndarray

    @staticmethod
    def of(*values: np.ndarray) -> "Tables":
        """Return tables whose arrays are contiguous and read-only."""
        return Tables(*map(fixed, values))


class Work(NamedTuple):
    """Hold the memory of W workers (threads of the processor or of a GPU), for sequences of C faces and Q frequency nodes.

    Attributes:
        points: (W, 3, C + 1, 3). chain: (W, C). found: (W, MAX_PANES). field: (W, 2, Q, 3). level: (W, Q). matrix: (W, 2, 3, 2, 2).
    """

    points: np.ndarray
    chain: np.ndarray
    found: np.ndarray
    field: np.ndarray
    level: np.ndarray
    matrix: np.ndarray

    @staticmethod
    def of(workers: int, faces: int, nodes: int) -> "Work":
        """Return memory without values for a number of workers."""
        return Work(
            np.empty((workers, 3, faces + 1, 3)),
            np.empty((workers, faces), np.int64),
            np.empty((workers, MAX_PANES), np.int64),
            np.empty((workers, 2, nodes, 3), np.complex128),
            np.empty((workers, nodes), np.complex128),
            np.empty((workers, 2, 3, 2, 2), np.complex128),
        )


@innermost
def image(faces: Faces, point: Point, chain: np.ndarray, plane: float) -> Vector:
    """Return the image of a point in the faces of a chain, in this order. plane=0: the image of a direction."""
    x = point[0], point[1], point[2]
    for i in range(len(chain)):
        normal = vector(faces.normal, chain[i])
        x = moved(x, normal, -2 * (dot(x, normal) - plane * faces.offset[chain[i]]))
    return x


@innermost
def contains(faces: Faces, p: int, x: float, y: float, z: float) -> bool:
    """Return whether a point of the plane of face `p` lies in one of the face's triangles."""
    for t in range(faces.first[p], faces.first[p + 1]):
        inside = True
        for i in range(3):
            j = (i + 1) % 3
            ax, ay, az = faces.triangle[t, i, 0], faces.triangle[t, i, 1], faces.triangle[t, i, 2]
            ex, ey, ez = faces.triangle[t, j, 0] - ax, faces.triangle[t, j, 1] - ay, faces.triangle[t, j, 2] - az
            turn = faces.normal[p, 0] * (ey * (z - az) - ez * (y - ay))
            turn += faces.normal[p, 1] * (ez * (x - ax) - ex * (z - az)) + faces.normal[p, 2] * (ex * (y - ay) - ey * (x - ax))
            if turn < 0:
                inside = False
                break
        if inside:
            return True
    return False


@innermost
def reflect_points(faces: Faces, source: Point, chain: np.ndarray, end: Point, points: np.ndarray) -> bool:
    """Write the reflection points (len(chain), 3) of the path from `source` over `chain` to `end`; returns whether the path exists."""
    x, y, z = source[0], source[1], source[2]
    for i in range(len(chain)):  # `points` holds the images of the source first
        p = chain[i]
        nx, ny, nz = faces.normal[p, 0], faces.normal[p, 1], faces.normal[p, 2]
        twice = 2 * (x * nx + y * ny + z * nz - faces.offset[p])
        x, y, z = x - twice * nx, y - twice * ny, z - twice * nz
        points[i, 0], points[i, 1], points[i, 2] = x, y, z
    x, y, z = end[0], end[1], end[2]
    for i in range(len(chain) - 1, -1, -1):
        p = chain[i]
        nx, ny, nz = faces.normal[p, 0], faces.normal[p, 1], faces.normal[p, 2]
        above = x * nx + y * ny + z * nz - faces.offset[p]
        below = points[i, 0] * nx + points[i, 1] * ny + points[i, 2] * nz - faces.offset[p]
        if above * below >= 0 or abs(above) < GRAZING_M or abs(below) < GRAZING_M:
            return False
        share = above / (above - below)
        x, y, z = x + share * (points[i, 0] - x), y + share * (points[i, 1] - y), z + share * (points[i, 2] - z)
        if not contains(faces, p, x, y, z):
            return False
        points[i, 0], points[i, 1], points[i, 2] = x, y, z
    return True


@innermost
def reversed_at_corners(chain: np.ndarray, points: np.ndarray, close: float, out: np.ndarray) -> bool:
    """Write a chain in which faces that reflect at one corner have the reverse order; returns whether there is such a corner.

    A path from the sensor to itself over two perpendicular faces meets the line of their corner, where each of the two orders carries half
    of the field. If the faces have layers and the path is not perpendicular to the line, the fields of the two orders differ. At a corner
    of three faces, six orders are possible; the function gives only the reverse of the path's order.

    Args:
        points: (len(chain), 3) points of reflection. close: largest distance between two successive points at a corner, m.
    """
    start, found = 0, False
    for i in range(len(chain)):
        if i + 1 == len(chain) or distance(vector(points, i), vector(points, i + 1)) > close:
            for j in range(start, i + 1):
                out[j] = chain[start + i - j]
            found, start = found or i > start, i + 1
    return found


@innermost
def panes_on(tree: Hierarchy, opaque: np.ndarray, start: Point, points: np.ndarray, count: int, end: Point, found: np.ndarray) -> int:
    """Return the number of triangles of panes on the path from `start` over points (count, 3) to `end`; -1 if it is blocked.

    found: (MAX_PANES,) memory.
    """
    to, total = (end[0], end[1], end[2]), 0
    for i in range(count - 1, -2, -1):
        at = (points[i, 0], points[i, 1], points[i, 2]) if i >= 0 else (start[0], start[1], start[2])
        panes = crossed(tree, at, to, opaque, found)
        if panes < 0:
            return -1
        total += panes
        to = at
    return total


@innermost
def transverse(axis: Point, direction: Point) -> Vector:
    """Return the normalised component of an axis perpendicular to a direction; for a parallel direction, a fixed perpendicular."""
    across = moved(axis, direction, -dot(axis, direction))
    if norm(across) < 1e-6:
        across = cross(axis, (0.6, 0.0, 0.8) if abs(axis[2]) < 0.9 else (0.8, 0.6, 0.0))
    size = norm(across)
    return across[0] / size, across[1] / size, across[2] / size


@innermost
def looked_up(values: np.ndarray, surface: int, cosine: float, q: int) -> complex:
    """Return a coefficient of a table (surfaces, C, Q), interpolated linearly in the cosine of incidence."""
    x = min(max(cosine, 0.0), 1.0) * (values.shape[1] - 1)
    low = min(int(x), values.shape[1] - 2)
    return values[surface, low, q] * (1 - x + low) + values[surface, low + 1, q] * (x - low)


@innermost
def polarised(field: np.ndarray, unit: Point) -> None:
    """Set a field (Q, 3) to a unit vector."""
    for q in range(len(field)):
        for k in range(3):
            field[q, k] = unit[k]


@innermost
def reflected(faces: Faces, te: np.ndarray, tm: np.ndarray, field: np.ndarray, direction: Point, chain: np.ndarray) -> Vector:
    """Reflect a field (Q, 3) at the faces of a chain in place; returns the direction after the reflections."""
    way = direction[0], direction[1], direction[2]
    for i in range(len(chain)):
        normal, surface = vector(faces.normal, chain[i]), faces.surface[chain[i]]
        cosine = dot(way, normal)
        after = moved(way, normal, -2 * cosine)
        s = cross(way, normal)
        if norm(s) < 1e-7:
            s = cross(normal, (1.0, 0.0, 0.0) if abs(normal[0]) < 0.9 else (0.0, 1.0, 0.0))
        size = norm(s)
        s = s[0] / size, s[1] / size, s[2] / size
        before_p, after_p = cross(way, s), cross(after, s)
        for q in range(len(field)):
            along_s = (field[q, 0] * s[0] + field[q, 1] * s[1] + field[q, 2] * s[2]) * looked_up(te, surface, abs(cosine), q)
            along_p = field[q, 0] * before_p[0] + field[q, 1] * before_p[1] + field[q, 2] * before_p[2]
            along_p *= looked_up(tm, surface, abs(cosine), q)
            for k in range(3):
                field[q, k] = along_s * s[k] + along_p * after_p[k]
        way = after
    return way


@innermost
def travelled(
    faces: Faces, tree: Hierarchy, opaque: np.ndarray, tables: Tables, field: np.ndarray, direction: Point, chain: np.ndarray,
    start: Point, points: np.ndarray, step: int, end: Point, found: np.ndarray,
) -> None:  # fmt: skip
    """Apply to a field (Q, 3), in place, the reflections of a chain and the panes between `start`, the points of reflection and `end`.

    Args:
        points: (len(chain), 3) points of reflection, in the order of the path for step=1 and in reverse order for step=-1.
        found: (MAX_PANES,) memory.
    """
    m = len(chain)
    at, way = (start[0], start[1], start[2]), (direction[0], direction[1], direction[2])
    for i in range(m + 1):
        to = vector(points, i if step > 0 else m - 1 - i) if i < m else (end[0], end[1], end[2])
        cross_panes(tree, tables.through_te, tables.through_tm, at, to, found, max(crossed(tree, at, to, opaque, found), 0), field)
        if i < m:
            way = reflected(faces, tables.te, tables.tm, field, way, chain[i : i + 1])
        at = to


@innermost
def angle(faces: Faces, e: int, x: float, y: float, z: float) -> float:
    """Return the angle of a direction about edge `e`, from face 0 through the open sector, in [0, 2 pi)."""
    along_up = x * faces.up[e, 0] + y * faces.up[e, 1] + z * faces.up[e, 2]
    along_into = x * faces.into[e, 0] + y * faces.into[e, 1] + z * faces.into[e, 2]
    value = math.atan2(along_up, along_into)
    return value if value >= -1e-9 else value + 2 * math.pi


@innermost
def keller(start: Point, along: Point, source: Point, receiver: Point) -> float:
    """Return the place in metres along a line where the path from source over the line to receiver is shortest."""
    z_s, z_r = 0.0, 0.0
    for k in range(3):
        z_s += (source[k] - start[k]) * along[k]
        z_r += (receiver[k] - start[k]) * along[k]
    h_s, h_r = 0.0, 0.0
    for k in range(3):
        h_s += (source[k] - start[k] - z_s * along[k]) ** 2
        h_r += (receiver[k] - start[k] - z_r * along[k]) ** 2
    h_s, h_r = math.sqrt(h_s), math.sqrt(h_r)
    return (z_s * h_r + z_r * h_s) / max(h_s + h_r, 1e-12)


@innermost
def ends_weight(start: Point, along: Point, length: float, place: float, source: Point, receiver: Point, wavenumber: float) -> complex:
    """Return the weight of an edge from 0 to `length` relative to an infinite edge, with the point of diffraction at `place`.

    Where two edges of a face meet, the wave of the corner is part of both. Each edge carries half of this wave. The weight of an end is
    therefore the mean of two weights: of a smooth end (Fresnel integral) and of an abrupt end.
    """
    x, end = moved(start, along, place), moved(start, along, length)
    total = distance(x, source) + distance(x, receiver)
    excess_a = distance(start, source) + distance(start, receiver) - total
    excess_b = distance(end, source) + distance(end, receiver) - total
    scale = 2 * wavenumber / math.pi
    t_a = math.sqrt(scale * max(excess_a, 0.0)) * (1.0 if place < 0 else -1.0)
    t_b = math.sqrt(scale * max(excess_b, 0.0)) * (1.0 if place < length else -1.0)
    abrupt = (1.0 if place < length else 0.0) - (1.0 if place < 0 else 0.0)
    return 0.5 * (half_plane(t_b) - half_plane(t_a) + abrupt)


@innermost
def face_matrix(
    te: np.ndarray, tm: np.ndarray, surface: int, q: int, phi: float, phi0: float, sine: float, cosine: float
) -> tuple[complex, complex, complex]:
    """Return the elements ss, sh = -hs and hh of a face's reflection matrix in the soft and hard directions of its edge.

    Luebbers' heuristic, made reciprocal: the angle of incidence is that of a mirror direction half way between observer and source, which
    is (phi0 + pi - phi)/2 above the face. At the reflection boundary, this is the actual angle. Exchanging source and observer does not
    change the angle.

    Args:
        phi, phi0: angles of observer and source from this face, rad. sine: of the angle between ray and edge.
        cosine: of the angle between ray and edge; with the opposite sign for face n, whose angles turn the other way.
    """
    middle = 0.5 * (phi0 + math.pi - phi)
    incidence = abs(math.sin(middle)) * sine
    r_te, r_tm = looked_up(te, surface, incidence, q), looked_up(tm, surface, incidence, q)
    size = math.sqrt(cosine * cosine + (sine * math.cos(middle)) ** 2)
    if size < 1e-9:
        return r_te, 0j, r_tm
    # direction of TE in the soft and hard directions of the incident ray
    c = math.cos(middle) / size
    s = cosine * math.sin(middle) / size
    return r_te * c * c - r_tm * s * s, s * c * (r_te + r_tm), r_tm * c * c - r_te * s * s


@innermost
def passing_matrix(
    faces: Faces, tables: Tables, e: int, q: int, phi: float, phi0: float, sine: float, cosine: float
) -> tuple[complex, complex, complex, complex]:
    """Return the elements ss, sh, hs and hh of the matrix of the transmission through both faces of edge `e`, as in `face_matrix`.

    The direction through the faces is half way between those before and after the edge, as in `face_matrix`. Both faces of a free edge are
    the same sheet, which counts once. Ref: W. Burnside, K. Burgener, IEEE Trans. AP 31 (1983) 104.
    """
    for side in range(2):
        if tables.through_te[faces.surface[faces.sides[e, side]], -1, q] == 0:  # an opaque face has zeros at all angles
            return 0j, 0j, 0j, 0j
    ss, sh, hs, hh = 1 + 0j, 0j, 0j, 1 + 0j
    middle = 0.5 * (phi + phi0 + math.pi)
    if math.cos(middle - phi) < 0:
        middle += math.pi
    for side in range(1 if faces.sides[e, 0] == faces.sides[e, 1] else 2):
        turn = middle if side == 0 else faces.opening[e] * math.pi - middle
        surface = faces.surface[faces.sides[e, side]]
        incidence = abs(math.sin(turn)) * sine
        t_te, t_tm = looked_up(tables.through_te, surface, incidence, q), looked_up(tables.through_tm, surface, incidence, q)
        # components of the face's normal along the soft and the hard direction, over the sine of the angle of incidence
        soft, hard = -cosine * math.sin(turn), math.cos(turn) * (1.0 if side == 0 else -1.0)
        size = math.sqrt(soft * soft + hard * hard)
        if size < 1e-9:
            soft, hard, size = 0.0, 1.0, 1.0
        soft, hard = soft / size, hard / size
        across, within, mixed = (
            t_te * hard * hard + t_tm * soft * soft,
            t_te * soft * soft + t_tm * hard * hard,
            (t_tm - t_te) * soft * hard,
        )
        ss, sh, hs, hh = across * ss + mixed * hs, across * sh + mixed * hh, mixed * ss + within * hs, mixed * sh + within * hh
    return ss, sh, hs, hh


@innermost
def edge_terms(
    faces: Faces, tables: Tables, e: int, before: Point, after: Point, distance_m: float, wavenumber: float, out: np.ndarray
) -> None:
    """Write the diffraction matrices (3, 2, 2) of edge `e` and their derivatives by the observer's and by the source's angle.

    Behind faces that transmit, the field jumps by the part of the wave that the faces do not transmit. This part multiplies the shadow
    terms.

    Rows: soft and hard component after the edge; columns: before it. The derivatives are those of metal faces.

    Args:
        before, after: directions of travel (3,). distance_m: distance parameter without the square of the sine.
    """
    for i in range(3):
        out[i, 0, 0], out[i, 0, 1], out[i, 1, 0], out[i, 1, 1] = 0j, 0j, 0j, 0j
    cosine = dot(before, vector(faces.along, e))
    sine = math.sqrt(max(1 - cosine * cosine, SMALL_SINE * SMALL_SINE))
    n = faces.opening[e]
    phi0 = angle(faces, e, -before[0], -before[1], -before[2])
    phi = angle(faces, e, after[0], after[1], after[2])
    if max(phi, phi0) > n * math.pi + 1e-9:
        return
    shadow, mirror_0, mirror_n, slope, bend = coefficients(phi, phi0, n, wavenumber, sine, distance_m * sine * sine)
    te, tm, q = tables.te, tables.tm, tables.te.shape[2] // 2
    ss, sh, hs, hh = passing_matrix(faces, tables, e, q, phi, phi0, sine, cosine)
    lost = 1 - ss, -sh, -hs, 1 - hh
    ss0, sh0, hh0 = face_matrix(te, tm, faces.surface[faces.sides[e, 0]], q, phi, phi0, sine, cosine)
    ssn, shn, hhn = face_matrix(te, tm, faces.surface[faces.sides[e, 1]], q, n * math.pi - phi, n * math.pi - phi0, sine, -cosine)
    out[0, 0, 0] = shadow * lost[0] + ss0 * mirror_0 + ssn * mirror_n
    turned = sh0 * mirror_0 + shn * mirror_n
    out[0, 0, 1] = shadow * lost[1] + turned
    out[0, 1, 0] = shadow * lost[2] - turned
    out[0, 1, 1] = shadow * lost[3] + hh0 * mirror_0 + hhn * mirror_n
    out[1, 0, 0], out[1, 1, 1] = slope * lost[0] - bend, slope * lost[3] + bend
    out[2, 0, 0], out[2, 1, 1] = -slope * lost[0] - bend, -slope * lost[3] + bend


@innermost
def soft_and_hard(along: Point, direction: Point) -> tuple[Vector, Vector]:
    """Return the soft and the hard direction of a ray at an edge: in the plane of ray and edge, and across this plane."""
    cosine = dot(along, direction)
    sine = math.sqrt(max(1 - cosine * cosine, SMALL_SINE * SMALL_SINE))
    soft = toward(moved((0.0, 0.0, 0.0), direction, cosine), along, sine)
    return soft, cross(soft, direction)


@innermost
def edge_point(faces: Faces, e: int, place: float) -> tuple[float, float, float]:
    """Return the point of edge `e` at `place` metres, or the nearest point of the edge, moved by OUTSIDE_M towards the middle of the open
    sector.

    A line that grazes a face exactly then passes the face on its open side.
    """
    half = 0.5 * math.pi * faces.opening[e]
    z = min(max(place, INSIDE_M), faces.length[e] - INSIDE_M)
    into, up = OUTSIDE_M * math.cos(half), OUTSIDE_M * math.sin(half)
    return (
        faces.start[e, 0] + z * faces.along[e, 0] + into * faces.into[e, 0] + up * faces.up[e, 0],
        faces.start[e, 1] + z * faces.along[e, 1] + into * faces.into[e, 1] + up * faces.up[e, 1],
        faces.start[e, 2] + z * faces.along[e, 2] + into * faces.into[e, 2] + up * faces.up[e, 2],
    )


@innermost
def evaluate(
    begin: int, stop: int, step: int, faces: Faces, tree: Hierarchy, opaque: np.ndarray, tables: Tables, wavenumber: float,
    nudge: np.ndarray, count: np.ndarray, chain: np.ndarray, edge: np.ndarray, pose: np.ndarray, which: np.ndarray, sensor: np.ndarray,
    axis: np.ndarray, least: np.ndarray, amplitude: np.ndarray, length: np.ndarray, departure: np.ndarray, arrival: np.ndarray,
    met: np.ndarray, work: Work,
) -> None:  # fmt: skip
    """Compute every `step`-th path from `begin` to `stop` - 1 of N pairs of a pose and a sequence.

    Args:
        opaque: (surfaces,) bool. tables: of the surfaces.
        nudge: (3,) offset of the source, and half the offset of the receiver, for tests of existence and for angles. Without the offset, a
            sensor exactly in the plane of a face or exactly opposite a corner would lie on both sides of it.
        count: (K, 3) reflections before, between and after the edges. chain: (K, C) faces. edge: (K, 2) edges or -1.
        pose, which: (N,) pose and sequence of each pair. sensor, axis: (F, 3) place and antenna axis. least: (F,) weakest |field|.
        amplitude (N, Q), length (N, 3), departure and arrival (N, 3): results; the length is zero where no path exists.
        met: (N, V, 3) receives the points of reflection and diffraction in their order; the array must hold nan.
        work: memory of `step` workers.
    """
    worker = begin % step
    points, points2, points3 = work.points[worker, 0], work.points[worker, 1], work.points[worker, 2]
    found, other_order, level = work.found[worker], work.chain[worker], work.level[worker]
    field, slope = work.field[worker, 0], work.field[worker, 1]
    matrix1, matrix2 = work.matrix[worker, 0], work.matrix[worker, 1]
    te, tm = tables.te, tables.tm
    for n in range(begin, stop, step):
        s = which[n]
        place, antenna = vector(sensor, pose[n]), vector(axis, pose[n])
        source, receiver = moved(place, nudge, 1.0), moved(place, nudge, 2.0)
        m0, m1, m2 = count[s, 0], count[s, 1], count[s, 2]
        first, between, last = chain[s, :m0], chain[s, m0 : m0 + m1], chain[s, m0 + m1 : m0 + m1 + m2]
        e1, e2 = edge[s, 0], edge[s, 1]
        if e1 < 0:
            if not reflect_points(faces, source, first, receiver, points):
                continue
            exact = image(faces, place, first, 1.0)
            size = distance(exact, place)
            if size < 1e-6:  # four reflections in a corner of 90 degrees map the sensor to itself
                continue
            back = toward(exact, place, size)
            there = image(faces, back, first[::-1], 0.0)
            orders = 2 if reversed_at_corners(first, points, CORNER / wavenumber, other_order) else 1
            factor = 1 / (orders * size)
            polarised(field, transverse(antenna, there))
            reflected(faces, te, tm, field, there, first)
            if orders == 2:
                polarised(slope, transverse(antenna, there))
                reflected(faces, te, tm, slope, there, other_order[:m0])
                _add(field, slope, 1.0)
            if _received(field, transverse(antenna, back), factor, level) < least[pose[n]]:
                continue
            panes = panes_on(tree, opaque, source, points, m0, receiver, found)
            if panes < 0:
                continue
            if panes:
                polarised(field, transverse(antenna, there))
                travelled(faces, tree, opaque, tables, field, there, first, source, points, 1, receiver, found)
                if orders == 2:
                    polarised(slope, transverse(antenna, there))
                    travelled(faces, tree, opaque, tables, slope, there, other_order[:m0], source, points, 1, receiver, found)
                    _add(field, slope, 1.0)
                _received(field, transverse(antenna, back), factor, level)
            _met(points, m0, met[n], 0)
            _copied(level, amplitude[n])
            length[n, 0], length[n, 2] = 0.5 * size, 0.5 * size
            for k in range(3):
                departure[n, k], arrival[n, k] = there[k], -back[k]
            continue
        mirrored, returned = image(faces, source, first, 1.0), image(faces, receiver, last[::-1], 1.0)
        start1, along1 = vector(faces.start, e1), vector(faces.along, e1)
        if e2 < 0:
            z = keller(start1, along1, mirrored, returned)
            touched = edge_point(faces, e1, z)
            if not reflect_points(faces, source, first, touched, points):
                continue
            if not reflect_points(faces, receiver, last[::-1], touched, points2):
                continue
            weight = ends_weight(start1, along1, faces.length[e1], z, mirrored, returned, wavenumber)
            if abs(weight) < OUTSIDE:
                continue
            x = moved(start1, along1, z)
            s1, s3 = distance(mirrored, x), distance(x, returned)
            if min(s1, s3) < 1e-6:
                continue
            before, after = toward(mirrored, x, s1), toward(x, returned, s3)
            there, back = image(faces, before, first[::-1], 0.0), image(faces, after, last, 0.0)
            edge_terms(faces, tables, e1, before, after, s1 * s3 / (s1 + s3), wavenumber, matrix1)
            enters, leaves = soft_and_hard(along1, before), soft_and_hard(along1, after)
            weight /= math.sqrt(s1 * s3 * (s1 + s3))
            polarised(field, transverse(antenna, there))
            reflected(faces, te, tm, field, there, first)
            _passed(field, matrix1, 0, enters, leaves, field)
            reflected(faces, te, tm, field, after, last)
            if _received(field, transverse(antenna, back), weight, level) < least[pose[n]]:
                continue
            panes = panes_on(tree, opaque, source, points, m0, touched, found)
            if panes < 0:
                continue
            more = panes_on(tree, opaque, receiver, points2, m2, touched, found)
            if more < 0:
                continue
            if panes + more:
                polarised(field, transverse(antenna, there))
                travelled(faces, tree, opaque, tables, field, there, first, source, points, 1, touched, found)
                _passed(field, matrix1, 0, enters, leaves, field)
                travelled(faces, tree, opaque, tables, field, after, last, touched, points2, -1, receiver, found)
                _received(field, transverse(antenna, back), weight, level)
            _met(points, m0, met[n], 0)
            _met(points2[:m2][::-1], m2, met[n], m0 + 1)
            _copied(level, amplitude[n])
            length[n, 0] = distance(image(faces, place, first, 1.0), x)
            length[n, 2] = distance(x, image(faces, place, last[::-1], 1.0))
            for k in range(3):
                met[n, m0, k], departure[n, k], arrival[n, k] = touched[k], there[k], -back[k]
            continue
        # two edges: the second edge and all after it are unfolded to the space between the edges
        back_chain = between[::-1]
        start2 = image(faces, vector(faces.start, e2), back_chain, 1.0)
        along2 = image(faces, vector(faces.along, e2), back_chain, 0.0)
        receiver2 = image(faces, returned, back_chain, 1.0)
        place1, place2 = 0.5 * faces.length[e1], 0.5 * faces.length[e2]
        for _ in range(ROUNDS):
            known = place1
            place2 = keller(start2, along2, moved(start1, along1, place1), receiver2)
            place1 = keller(start1, along1, mirrored, moved(start2, along2, place2))
            if abs(place1 - known) < 1e-8:
                break
        x1, x2 = moved(start1, along1, place1), moved(start2, along2, place2)
        s1, s2, s3 = distance(mirrored, x1), distance(x1, x2), distance(x2, receiver2)
        if min(s1, min(s2, s3)) < 1e-6:
            continue
        touched1, touched2 = edge_point(faces, e1, place1), edge_point(faces, e2, place2)
        if not reflect_points(faces, source, first, touched1, points) or not reflect_points(faces, touched1, between, touched2, points2):
            continue
        if not reflect_points(faces, receiver, last[::-1], touched2, points3):
            continue
        weight = ends_weight(start1, along1, faces.length[e1], place1, mirrored, x2, wavenumber)
        weight *= ends_weight(start2, along2, faces.length[e2], place2, x1, receiver2, wavenumber)
        if abs(weight) < OUTSIDE:
            continue
        before, middle, after = toward(mirrored, x1, s1), toward(x1, x2, s2), toward(x2, receiver2, s3)
        middle2, after2 = image(faces, middle, between, 0.0), image(faces, after, between, 0.0)
        there, back = image(faces, before, first[::-1], 0.0), image(faces, after2, last, 0.0)
        edge_terms(faces, tables, e1, before, middle, s1 * s2 / (s1 + s2), wavenumber, matrix1)
        # curvature of the wave from the first edge, in the plane of ray and second edge
        frame, second, axis2 = soft_and_hard(along1, middle), soft_and_hard(along2, middle), vector(faces.along, e2)
        turn = dot(frame[0], second[0]) ** 2
        rho = 1 / (turn / (s1 + s2) + (1 - turn) / s2)
        parameter = s3 * (rho + s3) * s2 * (s1 + s2) / (rho * (s2 + s3) * (s1 + s2 + s3))
        edge_terms(faces, tables, e2, middle2, after2, parameter, wavenumber, matrix2)
        enters, leaves2, enters2 = soft_and_hard(along1, before), soft_and_hard(axis2, after2), soft_and_hard(axis2, middle2)
        # a larger angle at the first edge moves the ray at the second edge along `rise`; the source's angle there grows along `other`
        rise, other = image(faces, cross(along1, middle), between, 0.0), cross(middle2, axis2)
        size = norm(rise) * norm(other)
        gradient = dot(rise, other) / size / s2 if size > 0 else 0.0
        bend = gradient / (1j * wavenumber * math.sqrt(max(1 - dot(axis2, middle2) ** 2, SMALL_SINE * SMALL_SINE)))
        weight *= math.sqrt(rho / (s3 * (rho + s3))) / math.sqrt(s1 * s2 * (s1 + s2))
        if m1 == 0 and share_face(faces, e1, e2):
            weight *= 0.5  # the ray grazes the common face, so that the incident field already contains the reflected field
        polarised(field, transverse(antenna, there))
        reflected(faces, te, tm, field, there, first)
        _passed(field, matrix1, 1, enters, frame, slope)
        _passed(field, matrix1, 0, enters, frame, field)
        reflected(faces, te, tm, field, middle, between)
        reflected(faces, te, tm, slope, middle, between)
        _passed(slope, matrix2, 2, enters2, leaves2, slope)
        _passed(field, matrix2, 0, enters2, leaves2, field)
        _add(field, slope, bend)
        reflected(faces, te, tm, field, after2, last)
        if _received(field, transverse(antenna, back), weight, level) < least[pose[n]]:
            continue
        panes = panes_on(tree, opaque, source, points, m0, touched1, found)
        more = panes_on(tree, opaque, touched1, points2, m1, touched2, found) if panes >= 0 else -1
        most = panes_on(tree, opaque, receiver, points3, m2, touched2, found) if more >= 0 else -1
        if most < 0:
            continue
        if panes + more + most:
            polarised(field, transverse(antenna, there))
            travelled(faces, tree, opaque, tables, field, there, first, source, points, 1, touched1, found)
            _passed(field, matrix1, 1, enters, frame, slope)
            _passed(field, matrix1, 0, enters, frame, field)
            travelled(faces, tree, opaque, tables, field, middle, between, touched1, points2, 1, touched2, found)
            travelled(faces, tree, opaque, tables, slope, middle, between, touched1, points2, 1, touched2, found)
            _passed(slope, matrix2, 2, enters2, leaves2, slope)
            _passed(field, matrix2, 0, enters2, leaves2, field)
            _add(field, slope, bend)
            travelled(faces, tree, opaque, tables, field, after2, last, touched2, points3, -1, receiver, found)
            _received(field, transverse(antenna, back), weight, level)
        _met(points, m0, met[n], 0)
        _met(points2, m1, met[n], m0 + 1)
        _met(points3[:m2][::-1], m2, met[n], m0 + m1 + 2)
        _copied(level, amplitude[n])
        exact = image(faces, image(faces, place, last[::-1], 1.0), back_chain, 1.0)
        length[n, 0], length[n, 1] = distance(image(faces, place, first, 1.0), x1), s2
        length[n, 2] = distance(x2, exact)
        for k in range(3):
            met[n, m0, k], met[n, m0 + 1 + m1, k], departure[n, k], arrival[n, k] = touched1[k], touched2[k], there[k], -back[k]


@innermost
def _met(points: np.ndarray, count: int, out: np.ndarray, first: int) -> None:
    """Copy points (count, 3) to the rows of `out` (V, 3) from `first`."""
    for i in range(count):
        for k in range(3):
            out[first + i, k] = points[i, k]


@innermost
def _copied(level: np.ndarray, out: np.ndarray) -> None:
    for q in range(len(level)):
        out[q] = level[q]


@innermost
def share_face(faces: Faces, e1: int, e2: int) -> bool:
    """Return whether two edges belong to one face."""
    for i in range(2):
        for j in range(2):
            if faces.sides[e1, i] == faces.sides[e2, j]:
                return True
    return False


@innermost
def _passed(
    field: np.ndarray, matrix: np.ndarray, i: int, enters: tuple[Vector, Vector], leaves: tuple[Vector, Vector], out: np.ndarray
) -> None:
    """Write a field (Q, 3) after an edge to `out`, which may be `field`. matrix: (3, 2, 2), of which `i` is used.

    enters, leaves: soft and hard directions before and after the edge.
    """
    for q in range(len(field)):
        soft = field[q, 0] * enters[0][0] + field[q, 1] * enters[0][1] + field[q, 2] * enters[0][2]
        hard = field[q, 0] * enters[1][0] + field[q, 1] * enters[1][1] + field[q, 2] * enters[1][2]
        after_s = matrix[i, 0, 0] * soft + matrix[i, 0, 1] * hard
        after_h = matrix[i, 1, 0] * soft + matrix[i, 1, 1] * hard
        for k in range(3):
            out[q, k] = after_s * leaves[0][k] + after_h * leaves[1][k]


@innermost
def _add(field: np.ndarray, other: np.ndarray, factor: complex) -> None:
    """Add a field (Q, 3) times a factor to a field in place."""
    for q in range(len(field)):
        for k in range(3):
            field[q, k] += other[q, k] * factor


@innermost
def _received(field: np.ndarray, antenna: Point, factor: complex, level: np.ndarray) -> float:
    """Write the component of a field (Q, 3) along an antenna axis, times a factor, to `level` (Q,); returns its largest magnitude."""
    largest = 0.0
    for q in range(len(field)):
        level[q] = (field[q, 0] * antenna[0] + field[q, 1] * antenna[1] + field[q, 2] * antenna[2]) * factor
        largest = max(largest, abs(level[q]))
    return largest
