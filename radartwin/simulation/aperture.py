"""Fresnel factor of a flat polygon: what share of an image's field comes through it.

The field that a plane returns of a source is its image's. What a polygon of that plane returns is the image's times

    F = W - 1/(2 pi) sum over edges of s [G(d, t_b) - G(d, t_a)],   G(d, t) = integral_0^t d/(d^2 + x^2) exp(+j pi (d^2 + x^2)/2) dx

the boundary form of 1/(2j) times the integral of exp(+j pi r^2/2) over the polygon, r = 0 at the specular point. W is 1 with the
specular point inside and 0 outside, s = +-1 the side of the edge it lies on. In place of the paraxial r, the EXACT excess D of the path
over the point above the specular path enters: pi r^2/2 = k D, at the corners and at the least excess along the edge's line, which has a
closed form; each edge counts with the obliquity and spreading of the currents at its nearest point, over those at the specular point
(0.1 to 1 m metal panels at 0.5 to 4 m, sensor up to a width beyond the edge: 0.0003 rms and 0.002 at most from quadrature; without this
weight 0.002 and 0.01). On a straight edge far from all corners F is the half-plane factor (1 - (1 - j)(C + jS))/2; for a rectangle it is
the product of two such differences. Polygons are convex here, counter-clockwise; whatever is left of one behind another is a few convex
pieces.
Ref: K. Miyamoto, E. Wolf, J. Opt. Soc. Am. 52 (1962) 615, for diffraction as a boundary wave.
"""

import math

import numpy as np

from radartwin.simulation.compiled import compiled

MAX_CORNERS = 24  # of a polygon in the making; a rectangle cut by eight planes has twelve
MAX_PIECES = 64
SLIVER_M2 = 2e-9  # twice the area below which a piece is rounding
_NEAR = 2.0  # Fresnel coordinate below which the integral is summed directly
_X, _WX = np.polynomial.legendre.leggauss(16)
_LAGUERRE, _WL = np.polynomial.laguerre.laggauss(14)
_HERMITE, _WH = np.polynomial.hermite.hermgauss(20)


@compiled
def _to_infinity(d: float) -> complex:
    """G(d, infinity) = pi/2 erfc(d sqrt(-j pi/2)), d >= 0."""
    if d < _NEAR:  # C + jS by its power series
        step = 1j * math.pi / 2 * d * d
        term = complex(d, 0.0)
        total = term
        for n in range(1, 60):
            term = term * step / n
            total += term / (2 * n + 1)
            if abs(term) < 1e-14:
                break
        return math.pi / 2 * (1 - (1 - 1j) * total)
    total = 0j
    for i in range(len(_HERMITE)):  # along the path of steepest descent
        y2 = _HERMITE[i] * _HERMITE[i]
        total += _WH[i] / (d * d + 2j * y2 / math.pi)
    return d / math.pi * np.exp(0.5j * math.pi * d * d) * total * 1j / np.sqrt(2j / math.pi)


@compiled
def _from_zero(d: float, t: float) -> complex:
    """G(d, t), 0 <= t <= _NEAR, d > 0."""
    total = 0j
    for i in range(len(_X)):
        x = 0.5 * t * (1 + _X[i])
        r2 = d * d + x * x
        phase = 0.5 * math.pi * r2
        value = 0.5j * math.pi if phase < 1e-6 else (np.exp(1j * phase) - 1) / r2
        total += 0.5 * t * _WX[i] * value
    return math.atan2(t, d) + d * total


@compiled
def _tail(d: float, t: float) -> complex:
    """G(d, infinity) - G(d, t), t > _NEAR, along the path of steepest descent."""
    total = 0j
    for i in range(len(_LAGUERRE)):
        shift = 2j * _LAGUERRE[i] / math.pi
        total += _WL[i] / ((d * d + t * t + shift) * np.sqrt(t * t + shift))
    return 1j * d / math.pi * np.exp(0.5j * math.pi * (d * d + t * t)) * total


@compiled
def edge_wave(d: float, t_a: float, t_b: float) -> complex:
    """G(d, t_b) - G(d, t_a) for d >= 0 and t_a <= t_b."""
    if d == 0.0:  # the limit from the lit side; W counts the same side
        return complex(0.5 * math.pi * (np.sign(t_b) - np.sign(t_a)), 0.0)
    if t_a > _NEAR:
        return _tail(d, t_a) - _tail(d, t_b)
    if t_b < -_NEAR:
        return _tail(d, -t_b) - _tail(d, -t_a)
    return _signed(d, t_b) - _signed(d, t_a)


@compiled
def _signed(d: float, t: float) -> complex:
    """G(d, t), odd in t."""
    value = _from_zero(d, abs(t)) if abs(t) <= _NEAR else _to_infinity(d) - _tail(d, abs(t))
    return value if t > 0 else -value


@compiled
def clip(polygon: np.ndarray, count: int, a: float, b: float, c: float, out: np.ndarray) -> int:
    """Part of a convex polygon (count, 2) with a x + b y + c >= 0, written to `out`; its number of corners."""
    kept = 0
    previous = count - 1
    before = a * polygon[previous, 0] + b * polygon[previous, 1] + c
    for i in range(count):
        here = a * polygon[i, 0] + b * polygon[i, 1] + c
        if (here >= 0) != (before >= 0) and kept < MAX_CORNERS:
            share = before / (before - here)
            for k in range(2):
                out[kept, k] = polygon[previous, k] + share * (polygon[i, k] - polygon[previous, k])
            kept += 1
        if here >= 0 and kept < MAX_CORNERS:
            for k in range(2):
                out[kept, k] = polygon[i, k]
            kept += 1
        previous, before = i, here
    return kept if kept > 2 else 0


@compiled
def clip_space(polygon: np.ndarray, count: int, normal: np.ndarray, offset: float, out: np.ndarray) -> int:
    """Part of a convex polygon (count, 3) with normal . x >= offset, written to `out`; its number of corners."""
    kept = 0
    previous = count - 1
    before = polygon[previous, 0] * normal[0] + polygon[previous, 1] * normal[1] + polygon[previous, 2] * normal[2] - offset
    for i in range(count):
        here = polygon[i, 0] * normal[0] + polygon[i, 1] * normal[1] + polygon[i, 2] * normal[2] - offset
        if (here >= 0) != (before >= 0) and kept < MAX_CORNERS:
            share = before / (before - here)
            for k in range(3):
                out[kept, k] = polygon[previous, k] + share * (polygon[i, k] - polygon[previous, k])
            kept += 1
        if here >= 0 and kept < MAX_CORNERS:
            for k in range(3):
                out[kept, k] = polygon[i, k]
            kept += 1
        previous, before = i, here
    return kept if kept > 2 else 0


@compiled
def orient(polygon: np.ndarray, count: int) -> float:
    """Twice the area of a polygon (count, 2), which is made counter-clockwise."""
    area = 0.0
    previous = count - 1
    for i in range(count):
        area += polygon[previous, 0] * polygon[i, 1] - polygon[previous, 1] * polygon[i, 0]
        previous = i
    if area < 0:
        for i in range(count // 2):
            j = count - 1 - i
            for k in range(2):
                swap = polygon[i, k]
                polygon[i, k] = polygon[j, k]
                polygon[j, k] = swap
    return abs(area)


@compiled
def intersect(polygon: np.ndarray, count: int, other: np.ndarray, corners: int, spare: np.ndarray) -> int:
    """Make `polygon` its intersection with the convex, counter-clockwise `other`; its number of corners."""
    previous = corners - 1
    for i in range(corners):
        x, y = other[previous, 0], other[previous, 1]
        a, b = y - other[i, 1], other[i, 0] - x
        count = clip(polygon, count, a, b, -(a * x + b * y), spare)
        polygon[:count] = spare[:count]
        if count == 0:
            return 0
        previous = i
    return count


@compiled
def subtract(pieces: np.ndarray, counts: np.ndarray, number: int, other: np.ndarray, corners: int, spare: np.ndarray) -> int:
    """Take a convex, counter-clockwise polygon away from convex pieces (MAX_PIECES, MAX_CORNERS, 2), in place; how many are left."""
    total = number
    left = 0
    for p in range(number):
        count = counts[p]
        spare[0, :count] = pieces[p, :count]
        common = intersect(spare[0], count, other, corners, spare[1])
        if common == 0 or orient(spare[0], common) < SLIVER_M2:  # out of reach
            if left != p:
                pieces[left, :count] = pieces[p, :count]
                counts[left] = count
            left += 1
            continue
        spare[0, :count] = pieces[p, :count]
        previous = corners - 1
        for i in range(corners):
            x, y = other[previous, 0], other[previous, 1]
            a, b = y - other[i, 1], other[i, 0] - x
            c = -(a * x + b * y)
            outside = clip(spare[0], count, -a, -b, -c, spare[1])
            if outside and total < MAX_PIECES and orient(spare[1], outside) > SLIVER_M2:
                pieces[total, :outside] = spare[1, :outside]
                counts[total] = outside
                total += 1
            count = clip(spare[0], count, a, b, c, spare[1])
            spare[0, :count] = spare[1, :count]
            previous = i
            if count == 0:
                break
    for p in range(number, total):
        pieces[left, : counts[p]] = pieces[p, : counts[p]]
        counts[left] = counts[p]
        left += 1
    return left


@compiled
def polygon_factor(
    polygon: np.ndarray,
    count: int,
    origin: np.ndarray,
    u_axis: np.ndarray,
    v_axis: np.ndarray,
    source: np.ndarray,
    receiver: np.ndarray,
    length: float,
    wavenumber: float,
) -> complex:
    """F of one convex polygon.

    Args:
        polygon: (count, 2) counter-clockwise, metres along `u_axis`, `v_axis` (3,) from `origin` (3,), the specular point.
        source: (3,) image of the source, behind the plane; receiver: (3,). length: between them, metres.
        wavenumber: rad/m.
    """
    normal = np.cross(u_axis, v_axis)
    spreading = _spreading(origin, source, receiver, normal)
    inside = True
    total = 0j
    previous = count - 1
    a = origin + polygon[previous, 0] * u_axis + polygon[previous, 1] * v_axis
    excess_a = _distance(a, source) + _distance(a, receiver) - length
    for i in range(count):
        b = origin + polygon[i, 0] * u_axis + polygon[i, 1] * v_axis
        excess_b = _distance(b, source) + _distance(b, receiver) - length
        cross = polygon[previous, 0] * polygon[i, 1] - polygon[previous, 1] * polygon[i, 0]
        if cross < 0:
            inside = False
        along = b - a
        side = math.sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2])
        if side > 1e-9:
            along = along / side
            # the least excess along the edge's line: unfold source and receiver about it
            z_s, z_r = 0.0, 0.0
            for k in range(3):
                z_s += (source[k] - a[k]) * along[k]
                z_r += (receiver[k] - a[k]) * along[k]
            h_s, h_r = 0.0, 0.0
            for k in range(3):
                h_s += (source[k] - a[k] - z_s * along[k]) ** 2
                h_r += (receiver[k] - a[k] - z_r * along[k]) ** 2
            h_s, h_r = math.sqrt(h_s), math.sqrt(h_r)
            z = (z_s * h_r + z_r * h_s) / max(h_s + h_r, 1e-12)
            least = max(math.sqrt((h_s + h_r) ** 2 + (z_s - z_r) ** 2) - length, 0.0)
            scale = 2 * wavenumber / math.pi
            d = math.sqrt(scale * least)
            t_a = math.sqrt(scale * max(excess_a - least, 0.0)) * (1.0 if z < 0 else -1.0)
            t_b = math.sqrt(scale * max(excess_b - least, 0.0)) * (1.0 if z < side else -1.0)
            near = a + min(max(z, 0.0), side) * along
            part = edge_wave(d, t_a, t_b) * _spreading(near, source, receiver, normal) / spreading
            total += part if cross >= 0 else -part
        previous, a, excess_a = i, b, excess_b
    return (1.0 if inside else 0.0) - total / (2 * math.pi)


@compiled
def _spreading(point: np.ndarray, source: np.ndarray, receiver: np.ndarray, normal: np.ndarray) -> float:
    """Obliquity over path length at a point of the plane, up to a factor: what currents there weigh per unit of excess."""
    down, up = _distance(point, source), _distance(point, receiver)
    depth_in, depth_out = 0.0, 0.0
    for k in range(3):
        depth_in += (point[k] - source[k]) * normal[k]
        depth_out += (receiver[k] - point[k]) * normal[k]
    return abs(depth_in / down + depth_out / up) / (down + up)


@compiled
def _distance(a: np.ndarray, b: np.ndarray) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
