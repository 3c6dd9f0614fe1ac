"""Fields along paths of reflections and at most two edge diffractions: compiled functions, and the loop over many paths.

A path leaves the source, reflects at faces, may be diffracted at an edge, reflects again, may be diffracted at a second edge, reflects
again and ends at the receiver. The path is unfolded: faces before an edge mirror the source, faces after it mirror the receiver. The point
of diffraction is Keller's, where the unfolded path is shortest, or the end of the edge that is closest to this point. The ends of an edge
send waves, whose strength comes from Fresnel integrals of the excess path lengths over the ends. Where two edges of a face meet, the
physical-optics part of this wave is divided between them.

Fields use exp(+j omega t) and amplitudes without the propagation phase, for a source with a unit field at one metre. Let s1, s2, s3 be the
unfolded distances between source, edges and receiver. For parallel edges the spreading of a double diffraction is 1/sqrt(s1 s2 s3 (s1 + s2
+ s3)).
"""

import cmath
import math
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, fixed, innermost
from radartwin.simulation.flat.crossing import at_face, cross_panes, looked_up
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.flat.obstacles import MAX_PANES, Hierarchy, Point, Vector, crossed
from radartwin.simulation.flat.vectors import ZERO, beside_line, cross, distance, dot, moved, norm, put, toward, transverse, vector
from radartwin.simulation.flat.wedge import coefficients, face_terms, half_plane

GRAZING_M = 1e-9  # a point closer to a plane than this is on it
ROUNDS = 40  # largest number of steps to find the two points of a double diffraction
OUTSIDE = 0.004  # a diffraction is left out if its weight for the ends of the edge is below this
INSIDE_M = 1e-4  # visibility is tested at least this far inside the ends of an edge
OUTSIDE_M = 2e-6  # visibility is tested this far outside an edge
NUDGE = 0.05 * np.array([0.74, 0.53, 0.41])  # offset of the sensor in tests whether a path exists, in units of 1/k
SMALL_SINE = 1e-3  # smallest sine between ray and edge for which an edge diffracts
LEVEL = 1e-6  # largest cosine between the normals of faces that count as perpendicular
OPEN_RAD = 5e-6  # a direction this far inside a face runs along it; the corners of faces are rounded to 1e-7 m
TILT_RAD = 1e-5  # a ray that grazes a face is turned by this to one side for the angles at its edges
INSIDE = 0.01  # points of diffraction are at least this far inside the ends of an edge, in units of 1/k
APART = 0.012  # an edge has no wave at points closer than this to its line, in units of 1/k
FREE = 2 - 1e-6  # smallest opening of the free edge of a sheet
_TURN = cmath.exp(0.25j * math.pi)
# Factor on the bound of the waves of two edges, which has no slope terms. Around one place of the furnished laboratory, 1 of 65,877
# sequences is lost, whose field is 26 % above the weakest one that matters.
BOUND = 1.5
WEAK = -1.0  # length, and result of `_edges`, of a path whose field is too weak
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


class Walls(NamedTuple):
    """Hold the P faces of a room, what blocks, the coefficients of its S surfaces, and upper bounds of these coefficients.

    Attributes:
        centre, radius: (P, 3), (P,) a ball around each face. tree: all triangles that block. opaque: (S,) bool.
        tables: of the surfaces. wavenumber: rad/m.
        through: (S,) largest transmission coefficient of each surface. loudness: (P,) largest reflection coefficient of each face.
        envelope: (P, C) largest reflection coefficient of each face over all angles at least as steep as each of C cosines.
    """

    faces: Faces
    centre: np.ndarray
    radius: np.ndarray
    tree: Hierarchy
    opaque: np.ndarray
    tables: Tables
    wavenumber: float
    through: np.ndarray
    loudness: np.ndarray
    envelope: np.ndarray


class Work(NamedTuple):
    """Hold one path and its fields.

    A path with E edges has the nodes 0 to E + 1: the source, a point of each edge and the receiver. Leg i goes from node i to node i + 1
    over a chain of reflections.

    Attributes:
        node: (4, 3) nodes. touched: (4, 3) the same nodes for tests of existence, inside the ends of an edge and beside it.
        chain: (3, C) faces of the legs. count: (3) their number. points: (3, C + 1, 3) points of reflection.
        leave, arrive: (3, 3) directions of travel at the two ends of a leg. size: (3) length of a leg.
        share: (3) weight of a leg that grazes a face. beside: (3, 3) offset of a leg onto one side of this face.
        angles: (2, 3) angle of the source and of the observer about each edge, rad, and its distance parameter, m.
        matrix: (2, 3, 2, 2) of `edge_terms` for each edge. bend: (2) factors of the slope terms.
        field: (2, Q, 3) the field, and its derivative or another field. level: (Q) received field.
        other_order: (C) of `reversed_at_corners`. pane_ids: (MAX_PANES) triangles of panes on a leg.
    """

    node: np.ndarray
    touched: np.ndarray
    chain: np.ndarray
    count: np.ndarray
    points: np.ndarray
    leave: np.ndarray
    arrive: np.ndarray
    size: np.ndarray
    share: np.ndarray
    beside: np.ndarray
    angles: np.ndarray
    matrix: np.ndarray
    bend: np.ndarray
    field: np.ndarray
    level: np.ndarray
    other_order: np.ndarray
    pane_ids: np.ndarray


@innermost
def image(faces: Faces, point: Point, chain: np.ndarray, plane: float) -> Vector:
    """Return the image of a point in the faces of a chain, in this order. plane=0: the image of a direction."""
    x = point[0], point[1], point[2]
    for i in range(len(chain)):
        x = mirrored(faces, chain[i], x, plane)
    return x


@innermost
def mirrored(faces: Faces, p: int, x: Point, plane: float) -> Vector:
    """Return the image of a point in face `p`. plane=0: the image of a direction."""
    normal = vector(faces.normal, p)
    return moved(x, normal, -2 * (dot(x, normal) - plane * faces.offset[p]))


@innermost
def images_of(faces: Faces, source: Point, chain: np.ndarray, out: np.ndarray) -> None:
    """Write the images of a source in the first, in the first two, ... faces of a chain to the rows of `out`."""
    at = source[0], source[1], source[2]
    for i in range(len(chain)):
        at = mirrored(faces, chain[i], at, 1.0)
        put(out, i, at)


@innermost
def contains(faces: Faces, p: int, point: Point, margin: float) -> bool:
    """Return whether a point of the plane of face `p` lies in one of the face's triangles or within a margin of it."""
    x, y, z = point[0], point[1], point[2]
    for t in range(faces.first[p], faces.first[p + 1]):
        inside = True
        for i in range(3):
            j = (i + 1) % 3
            ax, ay, az = faces.triangle[t, i, 0], faces.triangle[t, i, 1], faces.triangle[t, i, 2]
            ex, ey, ez = faces.triangle[t, j, 0] - ax, faces.triangle[t, j, 1] - ay, faces.triangle[t, j, 2] - az
            side = faces.normal[p, 0] * (ey * (z - az) - ez * (y - ay))
            side += faces.normal[p, 1] * (ez * (x - ax) - ex * (z - az)) + faces.normal[p, 2] * (ex * (y - ay) - ey * (x - ax))
            if side < 0 and (margin == 0 or side < -margin * norm((ex, ey, ez))):
                inside = False
                break
        if inside:
            return True
    return False


@innermost
def reflect_points(faces: Faces, source: Point, chain: np.ndarray, end: Point, points: np.ndarray, margin: float) -> bool:
    """Write the reflection points (len(chain), 3) of the path from `source` over `chain` to `end`; returns whether the path exists.

    With a margin, the path counts as existing if it exists after its ends move by less than the margin.
    """
    images_of(faces, source, chain, points)
    at = end[0], end[1], end[2]
    for i in range(len(chain) - 1, -1, -1):
        p, behind = chain[i], vector(points, i)
        above = dot(at, vector(faces.normal, p)) - faces.offset[p]
        below = dot(behind, vector(faces.normal, p)) - faces.offset[p]
        lower = min(abs(above), abs(below))
        if (above * below >= 0 or lower < GRAZING_M) and lower >= margin:
            return False
        heights = max(abs(above) + abs(below), 1e-12)
        share, reach = abs(above) / heights, 0.0
        if margin > 0:  # at grazing incidence, the point of reflection moves farther than the ends
            reach = margin * (1 + distance(at, behind) / max(heights, margin))
        at = moved(at, toward(at, behind, 1.0), share)
        if not contains(faces, p, at, reach):
            return False
        put(points, i, at)
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
    start, has_corner = 0, False
    for i in range(len(chain)):
        if i + 1 == len(chain) or distance(vector(points, i), vector(points, i + 1)) > close:
            for j in range(start, i + 1):
                out[j] = chain[start + i - j]
            has_corner, start = has_corner or i > start, i + 1
    return has_corner


@innermost
def panes_on(tree: Hierarchy, opaque: np.ndarray, start: Point, points: np.ndarray, count: int, end: Point, pane_ids: np.ndarray) -> int:
    """Return the number of triangles of panes on the path from `start` over points (count, 3) to `end`; -1 if it is blocked.

    pane_ids: (MAX_PANES,) memory.
    """
    to, total = (end[0], end[1], end[2]), 0
    for i in range(count - 1, -2, -1):
        at = (points[i, 0], points[i, 1], points[i, 2]) if i >= 0 else (start[0], start[1], start[2])
        panes = crossed(tree, at, to, opaque, pane_ids)
        if panes < 0:
            return -1
        total += panes
        to = at
    return total


@innermost
def polarised(field: np.ndarray, unit: Point) -> None:
    """Set a field (Q, 3) to a unit vector."""
    for q in range(len(field)):
        for k in range(3):
            field[q, k] = unit[k]


@innermost
def reflected(faces: Faces, tables: Tables, field: np.ndarray, direction: Point, chain: np.ndarray) -> Vector:
    """Reflect a field (Q, 3) at the faces of a chain in place; returns the direction after the reflections."""
    way = direction[0], direction[1], direction[2]
    for i in range(len(chain)):
        after = mirrored(faces, chain[i], way, 0.0)
        at_face(tables.te, tables.tm, faces.surface[chain[i]], vector(faces.normal, chain[i]), way, after, field)
        way = after
    return way


@innermost
def travelled(
    walls: Walls, field: np.ndarray, direction: Point, chain: np.ndarray, start: Point, points: np.ndarray, end: Point, pane_ids: np.ndarray
) -> None:
    """Apply to a field (Q, 3), in place, the reflections of a chain and the panes between `start`, the points of reflection and `end`.

    Args:
        points: (len(chain), 3) points of reflection, in the order of the path.
        pane_ids: (MAX_PANES,) memory.
    """
    m, tables = len(chain), walls.tables
    at, way = (start[0], start[1], start[2]), (direction[0], direction[1], direction[2])
    for i in range(m + 1):
        to = vector(points, i) if i < m else (end[0], end[1], end[2])
        panes = max(crossed(walls.tree, at, to, walls.opaque, pane_ids), 0)
        cross_panes(walls.tree, tables.through_te, tables.through_tm, at, to, pane_ids, panes, field)
        if i < m:
            way = reflected(walls.faces, tables, field, way, chain[i : i + 1])
        at = to


@innermost
def angle(faces: Faces, e: int, direction: Point) -> float:
    """Return the angle of a direction about edge `e`, from face 0 through the open sector, in [0, 2 pi)."""
    value = math.atan2(dot(direction, vector(faces.up, e)), dot(direction, vector(faces.into, e)))
    return value if value >= -1e-9 else value + 2 * math.pi


@innermost
def open_angle(faces: Faces, e: int, direction: Vector, slack: float) -> float:
    """Return the angle of a direction as `angle`; a direction at most OPEN_RAD inside a face of the edge has the angle of this face.

    slack: by which the direction can turn, rad; a direction that can leave the face is turned as far as possible.
    """
    value, last = angle(faces, e, direction), faces.opening[e] * math.pi
    if value <= last:
        return value
    inside, other = value - last, 2 * math.pi - value
    if min(inside, other) >= OPEN_RAD + slack:
        return value
    opened = min(slack, 0.5 * last)
    return last - opened if inside < other else opened


@innermost
def keller(start: Point, along: Point, source: Point, receiver: Point) -> float:
    """Return the place in metres along a line where the path from source over the line to receiver is shortest."""
    z_s, z_r, h_s, h_r = beside_line(start, along, source, receiver)
    h_s, h_r = math.sqrt(h_s), math.sqrt(h_r)
    return (z_s * h_r + z_r * h_s) / max(h_s + h_r, 1e-12)


@innermost
def end_wave(wavenumber: float, excess: float, late: float) -> complex:
    """Return the wave of an end of an edge relative to the wave of the infinite edge: 1/2 for an end at the point of diffraction.

    Args:
        excess: length of the path over the end minus that over the point of diffraction, m. late: minus that over the path's own point, m.
    """
    excess = max(excess, 0.0)
    return half_plane(-math.sqrt(2 / math.pi * wavenumber * excess)) * cmath.exp(1j * wavenumber * (excess - late))


@innermost
def across_share(faces: Faces, e: int, side: int, bend: Vector) -> float:
    """Return the part of the wave of an end of edge `e` that belongs to this edge on face 0 (side 0) or face n (side 1).

    In physical optics, the field of a face is an integral along its border. Where two edges meet, each contributes a part of the wave of
    the corner. Ref: W. B. Gordon, IEEE Trans. AP 23 (1975) 590.

    bend: gradient of the path length at the end.
    """
    phi = faces.opening[e] * math.pi if side == 1 else 0.0
    into = math.cos(phi) * dot(bend, vector(faces.into, e)) + math.sin(phi) * dot(bend, vector(faces.up, e))
    along = dot(bend, vector(faces.along, e))
    size = into * into + along * along
    return into * into / size if size > 1e-20 else 0.5


@innermost
def ends_weight(faces: Faces, e: int, x: Point, source: Point, receiver: Point, wavenumber: float) -> tuple[complex, complex, complex]:
    """Return the weight of an edge relative to an infinite edge, and the parts of the weight that faces 0 and n leave to other edges.

    The waves of the ends belong to the edge, except for the parts of physical optics that belong to the neighbouring edges
    (`across_share`).

    Args:
        x: point of the edge whose path length is the phase of the weight. source, receiver: unfolded points before and after the edge.
    """
    start, along, length = vector(faces.start, e), vector(faces.along, e), faces.length[e]
    place = keller(start, along, source, receiver)
    least = distance(moved(start, along, place), source) + distance(moved(start, along, place), receiver)
    here = distance(x, source) + distance(x, receiver)
    weight, other_0, other_n = (1.0 + 0j if 0 <= place <= length else 0j), 0j, 0j
    for far in range(2):
        end = moved(start, along, length if far else 0.0)
        before, after = distance(source, end), distance(end, receiver)
        # the wave of an end is subtracted where the point of diffraction lies on the edge's side of this end, otherwise added
        sign = -1.0 if (place <= length if far else place >= 0) else 1.0
        wave = sign * end_wave(wavenumber, before + after - least, before + after - here)
        bend = toward(toward(end, receiver, max(after, 1e-12)), toward(source, end, max(before, 1e-12)), 1.0)
        weight += wave
        other_0 += wave * (1 - across_share(faces, e, 0, bend))
        other_n += wave * (1 - across_share(faces, e, 1, bend))
    return weight, other_0, other_n


@innermost
def face_matrix(
    tables: Tables, surface: int, q: int, phi: float, phi0: float, sine: float, cosine: float
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
    r_te, r_tm = looked_up(tables.te, surface, incidence, q), looked_up(tables.tm, surface, incidence, q)
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
        face_phi = middle if side == 0 else faces.opening[e] * math.pi - middle
        surface = faces.surface[faces.sides[e, side]]
        incidence = abs(math.sin(face_phi)) * sine
        t_te, t_tm = looked_up(tables.through_te, surface, incidence, q), looked_up(tables.through_tm, surface, incidence, q)
        # components of the face's normal along the soft and the hard direction, over the sine of the angle of incidence
        soft, hard = -cosine * math.sin(face_phi), math.cos(face_phi) * (1.0 if side == 0 else -1.0)
        size = math.sqrt(soft * soft + hard * hard)
        if size < 1e-9:
            soft, hard, size = 0.0, 1.0, 1.0
        soft, hard = soft / size, hard / size
        across, within = t_te * hard * hard + t_tm * soft * soft, t_te * soft * soft + t_tm * hard * hard
        mixed = (t_tm - t_te) * soft * hard
        ss, sh, hs, hh = across * ss + mixed * hs, across * sh + mixed * hh, mixed * ss + within * hs, mixed * sh + within * hh
    return ss, sh, hs, hh


@innermost
def doubled_matrix(
    faces: Faces, tables: Tables, e: int, q: int, phi: float, phi0: float, sine: float, cosine: float
) -> tuple[complex, complex, complex, complex]:
    """Return the elements ss, sh, hs and hh of the matrix of the reflection at both faces of the inner corner `e`, as in `face_matrix`.

    The angles are those of the doubly reflected wave that begins or ends at the edge: the ray meets its first face at the angle of the
    source, and its second face at the angle of the observer.
    """
    over, forward = faces.opening[e] * math.pi, (phi > phi0) == (faces.opening[e] > 0.5)  # forward: face 0 is the first face
    first, second, along = (0, 1, cosine) if forward else (1, 0, -cosine)
    at, left = (phi0, over - phi) if forward else (over - phi0, phi)
    ss1, sh1, hh1 = face_matrix(tables, faces.surface[faces.sides[e, first]], q, math.pi - at, at, sine, along)
    ss2, sh2, hh2 = face_matrix(tables, faces.surface[faces.sides[e, second]], q, left, math.pi - left, sine, -along)
    return ss2 * ss1 - sh2 * sh1, ss2 * sh1 + sh2 * hh1, -sh2 * ss1 - hh2 * sh1, hh2 * hh1 - sh2 * sh1


@innermost
def edge_terms(
    faces: Faces, tables: Tables, e: int, before: Point, after: Point, distance_m: float, wavenumber: float,
    weights: tuple[complex, complex, complex], phi0: float, phi: float, out: np.ndarray,
) -> None:  # fmt: skip
    """Write the diffraction matrices (3, 2, 2) of edge `e` and their derivatives by the observer's and by the source's angle.

    Behind faces that transmit, the field jumps by the part of the wave that the faces do not transmit. This part multiplies the shadow
    terms. At an inner corner, the shadow terms continue the waves that both faces reflect, so that `doubled_matrix` multiplies them.

    Rows: soft and hard component after the edge; columns: before it. The derivatives are those of metal faces.

    Args:
        before, after: directions of travel (3,). distance_m: distance parameter without the square of the sine.
        weights: of `ends_weight`. phi0, phi: angles of source and observer about the edge, in its open sector, rad.
    """
    for i in range(1, 3):
        out[i, 0, 1], out[i, 1, 0] = 0j, 0j
    cosine, cosine_after = dot(before, vector(faces.along, e)), dot(after, vector(faces.along, e))
    # beyond the end of an edge, the two angles between ray and edge differ
    sine = math.sqrt(max(math.sqrt(max((1 - cosine * cosine) * (1 - cosine_after * cosine_after), 0.0)), SMALL_SINE * SMALL_SINE))
    n = faces.opening[e]
    shadow, mirror_0, mirror_n, slope, bend = coefficients(phi, phi0, n, wavenumber, sine, distance_m * sine * sine)
    q = tables.te.shape[2] // 2
    ss, sh, hs, hh = passing_matrix(faces, tables, e, q, phi, phi0, sine, cosine)
    lost = 1 - ss, -sh, -hs, 1 - hh
    jump = doubled_matrix(faces, tables, e, q, phi, phi0, sine, cosine) if n < 1 else lost
    ss0, sh0, hh0 = face_matrix(tables, faces.surface[faces.sides[e, 0]], q, phi, phi0, sine, cosine)
    ssn, shn, hhn = face_matrix(tables, faces.surface[faces.sides[e, 1]], q, n * math.pi - phi, n * math.pi - phi0, sine, -cosine)
    weight = weights[0]
    # physical optics of the lit faces, whose waves of the ends belong in part to other edges
    kl = wavenumber * distance_m * sine * sine
    dark_0, bright_0 = face_terms(phi, phi0, kl)
    dark_n, bright_n = face_terms(n * math.pi - phi, n * math.pi - phi0, kl)
    scale = -_TURN.conjugate() / (2 * math.sqrt(2 * math.pi * wavenumber) * sine)
    shadow, dark = weight * shadow, scale * (weights[1] * dark_0 + weights[2] * dark_n)
    mirror_0 = weight * mirror_0 - scale * weights[1] * bright_0
    mirror_n = weight * mirror_n - scale * weights[2] * bright_n
    turned = sh0 * mirror_0 + shn * mirror_n
    out[0, 0, 0] = shadow * jump[0] - dark * lost[0] + ss0 * mirror_0 + ssn * mirror_n
    out[0, 0, 1] = shadow * jump[1] - dark * lost[1] + turned
    out[0, 1, 0] = shadow * jump[2] - dark * lost[2] - turned
    out[0, 1, 1] = shadow * jump[3] - dark * lost[3] + hh0 * mirror_0 + hhn * mirror_n
    out[1, 0, 0], out[1, 1, 1] = weight * (slope * jump[0] - bend), weight * (slope * jump[3] + bend)
    out[2, 0, 0], out[2, 1, 1] = weight * (-slope * jump[0] - bend), weight * (-slope * jump[3] + bend)


@innermost
def _largest_wave(walls: Walls, e: int, phi0: float, phi: float, sine: float, distance_m: float) -> float:
    """Return an upper bound of the elements of the diffraction matrix of edge `e` without its ends: the terms of `wedge.coefficients`
    without the Fresnel integrals, and at most their values at the boundaries.

    Args:
        phi0, phi: angles of source and observer, rad. sine: of the angle between ray and edge.
        distance_m: distance parameter without the square of the sine.
    """
    n, total, face_0, face_n = walls.faces.opening[e], 0.0, walls.faces.sides[e, 0], walls.faces.sides[e, 1]
    # the shadow terms of faces that transmit multiply 1 minus the transmission, which can have any phase
    jump = 1 + walls.through[walls.faces.surface[face_0]] * (1.0 if face_0 == face_n else walls.through[walls.faces.surface[face_n]])
    c, most = 1 / (2 * n * math.sqrt(2 * math.pi * walls.wavenumber) * sine), 0.5 * math.sqrt(distance_m)
    for i in range(4):  # shadow boundaries of faces n and 0, then reflection boundaries of faces n and 0
        sign, beta = (1.0 if i % 2 == 0 else -1.0), (phi - phi0 if i < 2 else phi + phi0)
        tangent = abs(math.tan((math.pi + sign * beta) / (2 * n)))
        share = jump if i < 2 else walls.envelope[face_n if i == 2 else face_0, 0]
        total += share * min(c / max(tangent, 1e-12), most)
    return total


@innermost
def _largest_reflection(walls: Walls, i: int, path: Work) -> float:
    """Return an upper bound of the product of the reflection coefficients of leg `i`, at its angles of incidence."""
    way, total, columns = vector(path.leave, i), 1.0, walls.envelope.shape[1] - 1
    for j in range(path.count[i]):
        p = path.chain[i, j]
        total *= walls.envelope[p, int(min(abs(dot(way, vector(walls.faces.normal, p))), 1.0) * columns)]
        way = mirrored(walls.faces, p, way, 0.0)
    return total


@innermost
def soft_and_hard(along: Point, direction: Point) -> tuple[Vector, Vector]:
    """Return the soft and the hard direction of a ray at an edge: in the plane of ray and edge, and across this plane."""
    cosine = dot(along, direction)
    sine = math.sqrt(max(1 - cosine * cosine, SMALL_SINE * SMALL_SINE))
    soft = toward(moved(ZERO, direction, cosine), along, sine)
    return soft, cross(soft, direction)


@innermost
def edge_point(faces: Faces, e: int, place: float) -> Vector:
    """Return the point of edge `e` at `place` metres, or the nearest point of the edge, moved by OUTSIDE_M towards the middle of the open
    sector.

    A line that grazes a face exactly then passes the face on its open side.
    """
    half = 0.5 * math.pi * faces.opening[e]
    z = min(max(place, INSIDE_M), faces.length[e] - INSIDE_M)
    x = moved(vector(faces.start, e), vector(faces.along, e), z)
    return moved(moved(x, vector(faces.into, e), OUTSIDE_M * math.cos(half)), vector(faces.up, e), OUTSIDE_M * math.sin(half))


@compiled
def evaluate(begin, stop, faces_of, nodes, *arguments) -> None:
    """Compute the paths `begin` to `stop` - 1 of N pairs of a pose and a sequence of at most `faces_of` faces, at `nodes` frequencies. The
    loop of `_evaluate`, to which the other arguments go, creates no arrays, so that it counts no references.
    """
    path = Work(
        np.empty((4, 3)), np.empty((4, 3)), np.empty((3, faces_of), np.int64), np.empty(3, np.int64), np.empty((3, faces_of + 1, 3)),
        np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((2, 3)),
        np.empty((2, 3, 2, 2), np.complex128), np.empty(2, np.complex128), np.empty((2, nodes, 3), np.complex128),
        np.empty(nodes, np.complex128), np.empty(faces_of, np.int64), np.empty(MAX_PANES, np.int64),
    )  # fmt: skip
    _evaluate(path, begin, stop, *arguments)


@innermost
def _evaluate(
    path: Work, begin: int, stop: int, walls: Walls, nudge: np.ndarray, count: np.ndarray, chain: np.ndarray, edge: np.ndarray,
    pose: np.ndarray, which: np.ndarray, sensor: np.ndarray, axis: np.ndarray, least: np.ndarray, margin: float, amplitude: np.ndarray,
    length: np.ndarray, departure: np.ndarray, arrival: np.ndarray, met: np.ndarray,
) -> None:  # fmt: skip
    """Compute the paths of `evaluate`.

    Args:
        path: memory of one path.
        nudge: (F, 3) offset of the source, and half the offset of the receiver, for tests of existence and for angles. Without the offset,
            a sensor exactly in the plane of a face or exactly opposite a corner would lie on both sides of it.
        count: (K, 3) reflections before, between and after the edges. chain: (K, C) faces. edge: (K, 2) edges or -1.
        pose, which: (N,) pose and sequence of each pair. sensor, axis: (F, 3) place and antenna axis. least: (F,) weakest |field|.
        margin: by which the sensor can move, m. A path that exists within the margin counts as existing, with about its largest field.
        amplitude (N, Q), length (N, 3), departure and arrival (N, 3): results; the length is zero where no path exists, and WEAK where
            the field is below `least`.
        met: (N, V, 3) receives the points of reflection and diffraction in their order; the array must hold nan.
    """
    faces, wavenumber, field, level = walls.faces, walls.wavenumber, path.field[0], path.level
    for n in range(begin, stop):
        s = which[n]
        place, antenna = vector(sensor, pose[n]), vector(axis, pose[n])
        edges = int(edge[s, 0] >= 0) + int(edge[s, 1] >= 0)
        _divide(count[s], chain[s], edges, path)
        # geometry: source and receiver, the points of diffraction, then reflections and lengths of the legs
        source, receiver = moved(place, vector(nudge, pose[n]), 1.0), moved(place, vector(nudge, pose[n]), 2.0)
        put(path.touched, 0, source)
        put(path.touched, edges + 1, receiver)
        put(path.node, 0, source if edges else place)
        put(path.node, edges + 1, receiver if edges else place)
        _diffraction_points(faces, edge[s], edges, wavenumber, path)
        if not _legs(faces, edge[s], edges, wavenumber, margin, path):
            continue
        # spreading, and the diffraction matrices of the edges
        factor = _edges(walls, edge[s], edges, margin, least[pose[n]], path)
        if factor.real <= 0:
            length[n, 0] = factor.real
            continue
        twice = edges == 0 and reversed_at_corners(path.chain[0, : path.count[0]], path.points[0], CORNER / wavenumber, path.other_order)
        if twice:  # each of the two orders of the faces carries half of the field
            factor *= 0.5
        back = vector(path.arrive, edges)
        # the test of visibility is expensive, so that weak paths are left out before it
        _carry(walls, edge[s], edges, antenna, twice, False, path)
        if _received(field, transverse(antenna, back), factor, level) < least[pose[n]]:
            length[n, 0] = WEAK
            continue
        panes = 0
        for i in range(edges + 1):
            if panes >= 0:
                shift = vector(path.beside, i)
                here, there = moved(vector(path.touched, i), shift, 1.0), moved(vector(path.touched, i + 1), shift, 1.0)
                more = panes_on(walls.tree, walls.opaque, here, path.points[i], path.count[i], there, path.pane_ids)
                panes = panes + more if more >= 0 else -1
        if panes < 0:
            continue
        if panes:  # the field again, now through the panes
            _carry(walls, edge[s], edges, antenna, twice, True, path)
            if _received(field, transverse(antenna, back), factor, level) < least[pose[n]]:
                length[n, 0] = WEAK
                continue
        for q in range(len(level)):
            amplitude[n, q] = level[q]
        _met(path, edges, met[n])
        # unfolded lengths to the first edge, between the edges and from the last edge; without edges, half of the path each
        length[n, 0] = length[n, 2] = 0.5 * path.size[0]
        if edges:
            length[n, 0] = distance(image(faces, place, path.chain[0, : path.count[0]], 1.0), vector(path.node, 1))
            length[n, 1] = path.size[1] if edges == 2 else 0.0
            length[n, 2] = distance(vector(path.node, edges), image(faces, place, path.chain[edges, : path.count[edges]][::-1], 1.0))
        put(departure, n, vector(path.leave, 0))
        put(arrival, n, moved(ZERO, back, -1.0))


@innermost
def _divide(count: np.ndarray, chain: np.ndarray, edges: int, path: Work) -> None:
    """Divide the faces (C,) of a sequence into the chains of its legs. count: (3,) faces before, between and after the edges."""
    start = 0
    for i in range(edges + 1):
        path.count[i] = count[i if edges != 1 or i == 0 else 2]
        for j in range(path.count[i]):
            path.chain[i, j] = chain[start + j]
        start += path.count[i]


@innermost
def _kept(place: float, length: float, wavenumber: float) -> float:
    """Return the place on an edge of the given length that is nearest to `place`."""
    inside = min(INSIDE / wavenumber, 0.25 * length)
    return min(max(place, inside), length - inside)


@innermost
def _diffraction_points(faces: Faces, edge: np.ndarray, edges: int, wavenumber: float, path: Work) -> None:
    """Write the points of diffraction of the shortest path to the rows 1 to `edges` of `path.node` and `path.touched`.

    The faces before the first edge mirror the source. All that follows the first edge is mirrored to the space of this edge.
    """
    if edges == 0:
        return
    source = image(faces, vector(path.node, 0), path.chain[0, : path.count[0]], 1.0)
    receiver = vector(path.node, edges + 1)
    for i in range(edges, 0, -1):
        receiver = image(faces, receiver, path.chain[i, : path.count[i]][::-1], 1.0)
    start1, along1, length1 = vector(faces.start, edge[0]), vector(faces.along, edge[0]), faces.length[edge[0]]
    places = _kept(keller(start1, along1, source, receiver), length1, wavenumber), 0.0
    if edges == 2:
        back, length2 = path.chain[1, : path.count[1]][::-1], faces.length[edge[1]]
        start2, along2 = image(faces, vector(faces.start, edge[1]), back, 1.0), image(faces, vector(faces.along, edge[1]), back, 0.0)
        place1, place2 = 0.5 * length1, 0.0
        for _ in range(ROUNDS):
            known = place1
            place2 = _kept(keller(start2, along2, moved(start1, along1, place1), receiver), length2, wavenumber)
            place1 = _kept(keller(start1, along1, source, moved(start2, along2, place2)), length1, wavenumber)
            if abs(place1 - known) < 1e-8:
                break
        places = place1, place2
    for i in range(edges):
        put(path.node, i + 1, moved(vector(faces.start, edge[i]), vector(faces.along, edge[i]), places[i]))
        put(path.touched, i + 1, edge_point(faces, edge[i], places[i]))


@innermost
def _legs(faces: Faces, edge: np.ndarray, edges: int, wavenumber: float, margin: float, path: Work) -> bool:
    """Write the points of reflection, the lengths and the directions of all legs of a path; return whether all legs exist."""
    for i in range(edges + 1):
        chain = path.chain[i, : path.count[i]]
        start, end = vector(path.node, i), image(faces, vector(path.node, i + 1), chain[::-1], 1.0)
        path.size[i] = distance(start, end)
        if path.size[i] < 1e-6:  # as after four reflections in a corner of 90 degrees, which map the sensor to itself
            return False
        way = toward(start, end, path.size[i])
        put(path.leave, i, way)
        put(path.arrive, i, image(faces, way, chain, 0.0))
        if 0 < i < edges:
            cosine1, cosine2 = dot(way, vector(faces.along, edge[i - 1])), dot(vector(path.arrive, i), vector(faces.along, edge[i]))
            if path.size[i] * math.sqrt(max(1 - max(cosine1 * cosine1, cosine2 * cosine2), 0.0)) < APART / wavenumber:
                return False
        path.share[i] = 1.0
        put(path.beside, i, (0.0, 0.0, 0.0))
        here, there = vector(path.touched, i), vector(path.touched, i + 1)
        p = grazed_face(faces, edge[i - 1], edge[i], chain, way) if 0 < i < edges else -1
        if p >= 0:
            # The ray grazes the common face. The incident field at the second edge then contains the reflected field already. Both sides
            # of a sheet carry such a ray.
            path.share[i] = 0.0
            for side in range(2):
                shift = beside(faces, edge[i - 1], edge[i], p, side)
                open_side = shift[0] != 0 or shift[1] != 0 or shift[2] != 0
                if open_side and reflect_points(faces, moved(here, shift, 1.0), chain, moved(there, shift, 1.0), path.points[i], margin):
                    path.share[i] += 0.5
                    put(path.beside, i, shift)
            here, there = moved(here, vector(path.beside, i), 1.0), moved(there, vector(path.beside, i), 1.0)
        if path.share[i] == 0 or not reflect_points(faces, here, chain, there, path.points[i], margin):
            return False
    return True


@innermost
def _edges(walls: Walls, edge: np.ndarray, edges: int, margin: float, least: float, path: Work) -> complex:
    """Write the diffraction matrices and the factors of the slope terms of a path; return its spreading times the shares of its legs.

    The function returns 0 if the path has no field, and WEAK if the waves of two edges cannot give a field of `least`.
    """
    faces, wavenumber = walls.faces, walls.wavenumber
    # radii of curvature of the wave: across the previous edge, and in the plane of this edge and the ray
    across, within = path.size[0], path.size[0]
    factor, largest = 1 / path.size[0], _largest_reflection(walls, 0, path) if edges == 2 else 1.0
    for i in range(edges):
        e, line = edge[i], vector(faces.along, edge[i])
        before, after, s = vector(path.arrive, i), vector(path.leave, i + 1), path.size[i + 1]
        # angles about the edge; a ray that grazes a face has the angle of the side on which it runs
        in_way = moved(before, vector(path.beside, i), -TILT_RAD / OUTSIDE_M)
        out_way = moved(after, vector(path.beside, i + 1), TILT_RAD / OUTSIDE_M)
        # the margin turns the directions by at most this angle times metres
        sine = math.sqrt(max(1 - dot(line, before) ** 2, SMALL_SINE * SMALL_SINE))
        turned = 0.5 * math.pi * margin / sine
        phi0 = open_angle(faces, e, (-in_way[0], -in_way[1], -in_way[2]), min(turned / path.size[i], 0.5 * math.pi))
        phi = open_angle(faces, e, out_way, min(turned / s, 0.5 * math.pi))
        if max(phi0, phi) > faces.opening[e] * math.pi:
            return 0j
        # curvature of the wave from the previous edge, in the plane of ray and edge
        rho, path.bend[i] = within, 0j
        if i > 0:
            chain, known, begin = path.chain[i, : path.count[i]], vector(faces.along, edge[i - 1]), vector(path.leave, i)
            cos_square = dot(image(faces, soft_and_hard(known, begin)[0], chain, 0.0), soft_and_hard(line, before)[0]) ** 2
            rho = 1 / (cos_square / within + (1 - cos_square) / across)
            # slope term: a larger angle at the previous edge moves the ray along `rise`; the source's angle here grows along `other`
            rise, other = image(faces, cross(known, begin), chain, 0.0), cross(before, line)
            area = norm(rise) * norm(other)
            gradient = dot(rise, other) / area / path.size[i] if area > 0 else 0.0
            path.bend[i] = gradient / (1j * wavenumber * sine)
            factor *= path.share[i]
        # distance parameter without the square of the sine
        parameter = s * (rho + s) * across * within / (rho * (across + s) * (within + s))
        path.angles[i, 0], path.angles[i, 1], path.angles[i, 2] = phi0, phi, parameter
        if edges == 2:
            largest *= _largest_wave(walls, e, phi0, phi, sine, parameter) * _largest_reflection(walls, i + 1, path)
        # spreading from the edge to the next point
        factor *= math.sqrt(rho / (s * (rho + s)))
        across, within = s, rho + s
    if edges == 2 and BOUND * factor * largest < least:
        return complex(WEAK)
    for i in range(edges):
        x, before, after = vector(path.node, i + 1), vector(path.arrive, i), vector(path.leave, i + 1)
        # weight for the ends of the edge, seen from the unfolded previous point and the unfolded following point
        weights = ends_weight(faces, edge[i], x, moved(x, before, -path.size[i]), moved(x, after, path.size[i + 1]), wavenumber)
        if abs(weights[0]) < (OUTSIDE if margin == 0 else 0.3 * OUTSIDE):
            return 0j
        largest *= abs(weights[0]) + abs(weights[1]) + abs(weights[2])
        if edges == 2 and BOUND * factor * largest < least:
            return complex(WEAK)
        in_way = moved(before, vector(path.beside, i), -TILT_RAD / OUTSIDE_M)
        out_way = moved(after, vector(path.beside, i + 1), TILT_RAD / OUTSIDE_M)
        phi0, phi, parameter = path.angles[i]
        edge_terms(faces, walls.tables, edge[i], in_way, out_way, parameter, wavenumber, weights, phi0, phi, path.matrix[i])
    return factor + 0j


@innermost
def _carry(walls: Walls, edge: np.ndarray, edges: int, antenna: Point, twice: bool, through: bool, path: Work) -> None:
    """Carry the field (Q, 3) of the source to the end of a path. Spreading is not part of the field.

    Args:
        antenna: axis of the antenna. twice: whether to add the field over the faces in `path.other_order`.
        through: whether legs cross panes.
    """
    field, slope = path.field[0], path.field[1]
    polarised(field, transverse(antenna, vector(path.leave, 0)))
    if twice:
        polarised(slope, transverse(antenna, vector(path.leave, 0)))
        _over_leg(walls, path.other_order[: path.count[0]], 0, through, path, slope)
    for i in range(edges + 1):
        _over_leg(walls, path.chain[i, : path.count[i]], i, through, path, field)
        if i > 0 and edges == 2:
            _over_leg(walls, path.chain[i, : path.count[i]], i, through, path, slope)
        if i == edges:
            break
        line = vector(walls.faces.along, edge[i])
        enters, leaves = soft_and_hard(line, vector(path.arrive, i)), soft_and_hard(line, vector(path.leave, i + 1))
        # `slope` is the derivative of the field by the angle of the ray behind the previous edge
        if i > 0:
            _passed(slope, path.matrix[i], 2, enters, leaves, slope)
        elif edges == 2:
            _passed(field, path.matrix[i], 1, enters, leaves, slope)
        _passed(field, path.matrix[i], 0, enters, leaves, field)
        if i > 0:
            _add(field, slope, path.bend[i])
    if twice:
        _add(field, slope, 1.0)


@innermost
def _over_leg(walls: Walls, chain: np.ndarray, i: int, through: bool, path: Work, field: np.ndarray) -> None:
    """Apply to a field (Q, 3), in place, the reflections of leg `i` at the faces of a chain and, if `through`, the panes on this leg."""
    if through:
        shift = vector(path.beside, i)
        start, end = moved(vector(path.touched, i), shift, 1.0), moved(vector(path.touched, i + 1), shift, 1.0)
        travelled(walls, field, vector(path.leave, i), chain, start, path.points[i], end, path.pane_ids)
    else:
        reflected(walls.faces, walls.tables, field, vector(path.leave, i), chain)


@innermost
def _met(path: Work, edges: int, out: np.ndarray) -> None:
    """Write the points of reflection and diffraction of a path in their order to the rows of `out` (V, 3)."""
    row = 0
    for i in range(edges + 1):
        for j in range(path.count[i]):
            put(out, row + j, vector(path.points[i], j))
        row += path.count[i] + 1
        if i < edges:
            put(out, row - 1, vector(path.touched, i + 1))


@innermost
def grazed_face(faces: Faces, e1: int, e2: int, chain: np.ndarray, way: Vector) -> int:
    """Return the face of two edges along which a ray between them runs, over the faces of a chain, or -1 if there is no such face.

    way: direction of the ray at the first edge.
    """
    for i in range(2):
        for j in range(2):
            p = faces.sides[e1, i]
            if p != faces.sides[e2, j]:
                continue
            phi = faces.opening[e1] * math.pi if i == 1 else 0.0
            within = math.cos(phi) * dot(way, vector(faces.into, e1)) + math.sin(phi) * dot(way, vector(faces.up, e1)) > 0
            for k in range(len(chain)):
                within = within and abs(dot(vector(faces.normal, p), vector(faces.normal, chain[k]))) < LEVEL
            if within:
                return p
    return -1


@innermost
def beside(faces: Faces, e1: int, e2: int, p: int, i: int) -> Vector:
    """Return the offset of a ray that grazes the face `p` of two edges, onto the side of its normal (i = 0) or onto the other side.

    The offset is zero if a wedge fills this side.
    """
    normal = vector(faces.normal, p)
    height = OUTSIDE_M if i == 0 else -OUTSIDE_M
    for j in range(2):
        e = e1 if j == 0 else e2
        if faces.opening[e] < FREE:
            phi = 0.0 if p == faces.sides[e, 0] else faces.opening[e] * math.pi
            # direction from the face into the open sector
            sign = 1.0 if p == faces.sides[e, 0] else -1.0
            out = sign * (math.cos(phi) * dot(normal, vector(faces.up, e)) - math.sin(phi) * dot(normal, vector(faces.into, e)))
            if out * height < 0:
                return 0.0, 0.0, 0.0
    return height * normal[0], height * normal[1], height * normal[2]


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
