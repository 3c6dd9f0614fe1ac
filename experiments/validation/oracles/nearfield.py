"""Near-field physical optics of metal panels by Gauss-Legendre quadrature over their true surface, with geometric-optics illumination.

    a = j/(4 pi) integral of P . (n x (k x E)) / (L_i L_o) exp(+j k (L_i + L_o)) dS

Symbols: E, P -> transmit and receive polarisation (the antenna axis projected onto the plane across the ray, normalised), n -> normal on
the lit side, k -> wave vector, L_i -> distance from the source (or its image in the panels that the path hits first) to the surface, L_o
-> distance from the surface to the receiver. |a|^2 is received over transmitted power between isotropic antennas. The phase of a belongs
to the whole path: an infinite panel at distance d returns -lambda/(8 pi d) exp(+j k 2 d). As in physical optics, edge currents are left
out. Ref: C. Balanis, Advanced Engineering Electromagnetics (2012), section 7.10.
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

MOST_POINTS = 10_000  # points of a panel that are computed together
CYCLES_PER_CELL = 12.0  # largest phase per cell
# Gauss-Legendre points per cell. Over c cycles, the series of exp(j x) in Legendre polynomials falls off above degree pi c; n points
# integrate degree 2 n - 1. Largest relative error over random panels: 1e-8 (8e-7 with MORE_POINTS = 10).
PER_CYCLE, MORE_POINTS = np.pi / 2, 12
TOUCHING_M = 1e-12  # a sensor within this distance of a panel's plane counts as lying in the plane
SAME_M = 1e-9  # corners within this distance are merged
EMPTY_M2 = 1e-14  # pieces with less area are dropped
AXIS = np.array([0.0, 0.0, 1.0])  # polarisation vector of both antennas; it has no effect if both antennas share a position


def panel_quadrature(corners: ArrayLike, sensor: ArrayLike, wavelength: float, *, receiver: ArrayLike | None = None) -> complex:
    """Return the received amplitude of one flat metal panel, seen from either side. The arguments are those of `chain_quadrature`.

    >>> plate = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> a = panel_quadrature(np.array(plate) * 0.05, [0, 0, 80.0], 0.0039)
    >>> bool(abs(abs(a) / (0.1**2 / (4 * np.pi * 80.0**2)) - 1) < 0.01)
    True
    """
    return chain_quadrature([corners], sensor, wavelength, receiver=receiver)


def chain_quadrature(panels: Sequence[ArrayLike], sensor: ArrayLike, wavelength: float, *, receiver: ArrayLike | None = None) -> complex:
    """Return the received amplitude of the path that hits `panels` in the given order, with the phase exp(+j k L). No panel casts a shadow.

    A panel is its corners (n, 3) in metres, in order around a simple polygon in one plane. All panels except the last reflect like mirrors
    and must be convex: rays from the sensor's image in a mirror that pass through it illuminate the next panel. The last panel is treated
    by physical optics and may be concave. Without `receiver` (3,), the sensor (3,) transmits and receives. The amplitude is zero if both
    are on different sides of a panel. Raises ValueError for corners not in one plane, or a sensor in the plane of a panel.
    """
    source = np.array(sensor, float)
    target = source.copy() if receiver is None else np.array(receiver, float)
    shapes = [np.asarray(panel, float) for panel in panels]
    field_map = np.eye(3)  # maps a field at departure to the field after the mirrors so far
    mirror = np.eye(3)  # maps a direction at departure to the direction after the mirrors
    last = shapes.pop()
    pieces = _triangles(last)
    for number, shape in enumerate(shapes):
        normal, offset = _plane(shape)
        height = float(normal @ source - offset)
        if abs(height) < TOUCHING_M:
            raise ValueError("the sensor, or its image, lies in the plane of a panel")
        source = source - 2 * height * normal
        # the next panel is lit only on the side of the arriving ray and inside the cone from the image through this panel
        cone = [(np.sign(height) * normal, np.sign(height) * offset), *_cone(source, shape)]
        if number + 1 < len(shapes):
            shapes[number + 1] = _clip(shapes[number + 1], cone)
            if _area(shapes[number + 1]) < EMPTY_M2:
                return 0j
        else:
            cut = (_clip(triangle, cone) for triangle in pieces)
            pieces = [np.array([polygon[0], polygon[i], polygon[i + 1]]) for polygon in cut for i in range(1, len(polygon) - 1)]
        reflect = np.eye(3) - 2 * np.outer(normal, normal)
        mirror, field_map = reflect @ mirror, -reflect @ field_map
    normal, offset = _plane(last)
    side, other = float(normal @ source - offset), float(normal @ target - offset)
    if min(abs(side), abs(other)) < TOUCHING_M:
        raise ValueError("the sensor, or its image, lies in the plane of a panel")
    if side * other < 0:
        return 0j
    lit, total = np.sign(side) * normal, 0j
    for triangle in pieces:
        if _area(triangle) < EMPTY_M2:
            continue
        u, weight_u, v, weight_v = _rule(triangle, source, target, wavelength)
        a, b, c = triangle[..., None, None]
        for rows in np.array_split(np.arange(len(u)), -(-len(u) * len(v) // MOST_POINTS)):
            points = a + u[rows, None] * (b - a + v * (c - b))
            inward, first = _unit(points - source[:, None, None])
            outward, second = _unit(target[:, None, None] - points)
            field, reception = _turned(field_map, _across(_turned(mirror.T, inward))), _across(outward)
            # P . (n x (k x E)) = (P . k)(n . E) - (P . E)(n . k)
            value = _dot(reception, inward) * _turned(lit, field) - _dot(reception, field) * _turned(lit, inward)
            value = value / (first * second) * np.exp(2j * np.pi / wavelength * (first + second))
            total += 2 * _area(triangle) * np.einsum("u,uv,v", (weight_u * u)[rows], value, weight_v)
    if not np.isfinite(total):
        raise ValueError("a ray runs along AXIS, where its polarisation has no direction; move the sensor or the receiver")
    return complex(1j / (4 * np.pi) * total)


def corner_quadrature(panels: Sequence[ArrayLike], sensor: ArrayLike, wavelength: float) -> complex:
    """Return the amplitude of all paths that hit each panel of a dihedral or trihedral at most once, without shadows."""
    orders = (order for count in range(1, len(panels) + 1) for order in permutations(panels, count))
    return sum((chain_quadrature(order, sensor, wavelength) for order in orders), 0j)


def _plane(corners: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the unit normal (by Newell's rule) and the offset of the plane through a polygon."""
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 3:
        raise ValueError(f"a panel needs (n, 3) corners, n at least 3, not {corners.shape}")
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    normal /= np.linalg.norm(normal)
    offset = float(normal @ corners.mean(axis=0))
    if np.abs(corners @ normal - offset).max() > 1e-6 * np.ptp(corners, axis=0).max():
        raise ValueError("the corners of a panel must lie in one plane")
    return normal, offset


def _cone(apex: np.ndarray, convex: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Return the half-spaces (inward normal, offset) that bound the cone from an apex through the edges of a convex polygon."""
    centre = convex.mean(axis=0)
    planes = []
    for start, end in zip(convex, np.roll(convex, -1, axis=0), strict=True):
        normal = np.cross(start - apex, end - start)
        length = np.linalg.norm(normal)
        if length == 0:
            continue
        normal = normal / length * np.sign(normal @ (centre - apex))
        planes.append((normal, float(normal @ start)))  # the offset is that of a point of the panel, because the apex may be far away
    return planes


def _clip(polygon: np.ndarray, planes: Sequence[tuple[np.ndarray, float]]) -> np.ndarray:
    """Cut a convex polygon by half-spaces. The result may be empty. Ref: Sutherland and Hodgman, CACM 17 (1974) 32."""
    for normal, offset in planes:
        if len(polygon) == 0:
            break
        height = polygon @ normal - offset
        height[np.abs(height) < SAME_M] = 0.0
        kept = []
        for i, (here, after) in enumerate(zip(height, np.roll(height, -1), strict=True)):
            start, end = polygon[i], polygon[(i + 1) % len(polygon)]
            if here >= 0:
                kept.append(start)
            if here * after < 0:
                kept.append(start + (end - start) * (here / (here - after)))
        polygon = np.array(kept).reshape(-1, 3)
        if len(polygon):  # merge equal corners, because they make edges without a direction
            polygon = polygon[np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1) > SAME_M]
    return polygon


def _triangles(corners: np.ndarray) -> list[np.ndarray]:
    """Split a polygon into triangles: a fan if the polygon is convex, ear clipping if it is concave."""
    normal, _ = _plane(corners)
    left = [np.asarray(corner) for corner in corners]
    triangles = []
    while len(left) > 3:
        for i in range(len(left)):
            a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
            if np.cross(b - a, c - b) @ normal <= 0:
                continue
            others = [p for p in left if p is not a and p is not b and p is not c]
            if not any(all(np.cross(q - p, o - p) @ normal > 0 for p, q in ((a, b), (b, c), (c, a))) for o in others):
                triangles.append(np.array([a, b, c]))
                del left[i]
                break
        else:
            raise ValueError("the corners do not go round a simple polygon")
    return [*triangles, np.array(left)]


def _area(corners: np.ndarray) -> float:
    return float(np.linalg.norm(np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0))) / 2 if len(corners) > 2 else 0.0


def _rule(triangle: np.ndarray, source: np.ndarray, target: np.ndarray, wavelength: float) -> list[np.ndarray]:
    """Return nodes and weights along u and v of p = a + u (b - a) + u v (c - b), in cells small enough for the phase of the path."""
    steps = np.linspace(0, 1, 65)[:, None]
    rules: list[np.ndarray] = []
    for ends in ([(triangle[0], triangle[1]), (triangle[0], triangle[2])], [(triangle[1], triangle[2])]):
        cycles = 1.0
        for start, end in ends:
            points = start + steps * (end - start)
            path = np.linalg.norm(points - source, axis=1) + np.linalg.norm(points - target, axis=1)
            cycles = max(cycles, 64 * np.abs(np.diff(path)).max() / wavelength)
        cells = int(np.ceil(cycles / CYCLES_PER_CELL))
        nodes, weights = leggauss(int(np.ceil(PER_CYCLE * cycles / cells)) + MORE_POINTS)
        rules += [((np.arange(cells)[:, None] + (nodes + 1) / 2) / cells).ravel(), np.tile(weights / 2 / cells, cells)]
    return rules


def _across(ray: np.ndarray) -> np.ndarray:
    """Return the unit vectors (3, ...) of the polarisation AXIS across rays (3, ...); NaN for a ray along AXIS."""
    with np.errstate(invalid="ignore"):
        return _unit(AXIS[:, None, None] - _turned(AXIS, ray) * ray)[0]


def _unit(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions (3, ...) and the lengths of vectors (3, ...)."""
    length = np.sqrt(_dot(vectors, vectors))
    return vectors / length, length


def _turned(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.tensordot(matrix, vectors, 1)


def _dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.einsum("c...,c...", first, second)
