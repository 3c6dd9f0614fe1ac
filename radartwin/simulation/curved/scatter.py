"""Compute the contribution of a ray tube's footprint (its cross-section on the surface) to the received signal.

`radartwin.simulation.curved.tubes` explains the formulas and symbols. Import this module only after a Mitsuba variant is active.
"""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.contact import Contact
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import WHOLE, PieceArrays, Tubes

# Largest second-order phase across a tube's footprint on a curved surface, in radians. A steep first-order phase raises this limit.
MOST_BEND = 3.0
TERMINATOR = 0.4  # cosine of incidence below which the currents on a curved surface fade out, except towards the mirror direction
# If the phase changes by more than this many radians across half a tube, the footprint integral is computed from the kinks of the weight.
STEEP = 14.0
CLOSE = 0.03  # phases of the corners of a triangle, in radians, that differ by less than this are close
# Largest phase across half a tube, in radians. Tubes spread wider after many reflections in a hollow object, as in a mug. Their echo is
# negligible, phases in single precision are wrong by more than 0.06 rad there, and the sine of Dr.Jit exceeds 1 for phases above 1e7 rad.
MOST_PHASE = 1e6
MOST_TWIST = 2.0  # largest mixed second-order phase (the term u v of the phase expansion) across a tube's footprint, in radians
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


class Reception(NamedTuple):
    """Describe the receiver as seen from the points where tubes meet surfaces."""

    direction: Any  # unit vector from the point on the surface to the receiver
    length: Any  # distance from the point on the surface to the receiver, in metres
    across: Any  # receive polarisation vector without walls between the surface and the receiver
    plane: bool  # whether the receiver is infinitely far away, as for the far-field radar cross-section


def scatter(
    device: Device, tubes: Tubes, contact: Contact, reception: Reception, wavenumber: Any, active: Any, corner: Any = None
) -> list[Any]:
    """Compute how the receiver sees the reflected tubes, whose reflection at the contact is already among their encounters.

    The array `corner` holds the corners of the pieces among the tubes, as in `flight.PieceArrays`.

    Returns:
        The real and the imaginary part of the footprint's factor, and the eight factors `received` of `jones.Coefficients.amplitudes`.
    """
    re, im = _footprint(device, tubes, contact, reception, wavenumber, active, corner)
    re, im = dr.select(tubes.caustics & 1 == 1, -im, re), dr.select(tubes.caustics & 1 == 1, re, im)
    sign = dr.select(tubes.caustics & 2 == 2, mi.Float(-1.0), 1.0)
    s, ways = tubes.across, (tubes.direction, contact.mirrored(tubes.direction))
    fields = [(way, e) for way in ways for e in (s, dr.cross(way, s))]
    radiated = []
    for way, e in fields:
        electric = dr.cross(contact.normal, dr.cross(way, e))
        magnetic = dr.cross(dr.cross(e, contact.normal), reception.direction)
        radiated.append(electric + magnetic)
    ends = reception.across, dr.cross(reception.direction, reception.across)
    return [sign * re, sign * im, *(dr.dot(end, vector) for end in ends for vector in radiated)]


def _footprint(
    device: Device, tubes: Tubes, contact: Contact, reception: Reception, wavenumber: Any, active: Any, corner: Any
) -> tuple[Any, Any]:
    """Return the real and imaginary part of sqrt(dOmega A)/(8 pi L_o cos t) I, the scalar factor of each tube's contribution.

    The real and the imaginary part of the factor are zero for ray tubes that `active` excludes.
    """
    outgoing = reception.direction
    inverse_out = mi.Float(0.0) if reception.plane else dr.rcp(reception.length)
    gradient = tubes.direction - outgoing  # gradient of the path length with respect to the position of the hit
    # Increase of the path length per metre by which the surface lies deeper, measured along the normal.
    deeper = (1 - dr.dot(tubes.direction, outgoing)) * dr.rcp(contact.cosine)
    spreads = tubes.direction_du, tubes.direction_dv
    steps = [contact.step(tubes.direction, derivative) for derivative in (tubes.position_du, tubes.position_dv)]
    turns = [contact.turn(step) for step in steps] if device.curved else []
    alongs = [dr.dot(step, outgoing) for step in steps]

    def bend(i: int, j: int) -> Any:
        value = dr.dot(spreads[i], steps[j]) + (dr.dot(steps[i], steps[j]) - alongs[i] * alongs[j]) * inverse_out
        return value + deeper * dr.dot(turns[i], steps[j]) if device.curved else value

    slopes = [wavenumber * dr.dot(gradient, step) for step in steps]
    bends = [0.5 * wavenumber * bend(i, i) for i in range(2)]
    if device.curved:  # near the shadow line of a curved surface, the second-order expansion of the phase is not valid beyond this limit
        for i, slope in enumerate(slopes):
            most = dr.select(contact.is_curved(), dr.maximum(0.25 * dr.abs(slope), MOST_BEND), dr.inf)
            bends[i] = dr.clip(bends[i], -most, most)
    twist = wavenumber * bend(0, 1)
    re, im = footprint_integral(slopes, bends, twist, tubes.share)
    if tubes.share is not None:
        cut = active & (tubes.share & WHOLE == 0)
        corners = PieceArrays.corners(corner, tubes.share, cut)
        re, im = (dr.select(cut, a, b) for a, b in zip(piece_integral(corners, slopes, bends, twist), (re, im), strict=True))
    # The field varies as the inverse square root of the tube's cross-section. The product of field and area therefore stays finite where
    # the cross-section is zero.
    cross_section = dr.abs(dr.dot(dr.cross(tubes.position_du, tubes.position_dv), tubes.direction))
    level = dr.sqrt(tubes.weight * cross_section) * dr.rcp(8 * np.pi * contact.cosine) * (1.0 if reception.plane else inverse_out)
    if device.curved:
        # Physical optics ends the currents abruptly at the shadow line of a curved surface. Fade the currents out near this line, except
        # for receivers in the mirror direction.
        fade = TERMINATOR * 0.5 * (1 - dr.dot(contact.mirrored(tubes.direction), outgoing))
        least = dr.minimum(contact.cosine, dr.dot(contact.normal, outgoing))
        x = dr.clip(least * dr.rcp(dr.maximum(fade, 1e-6)), 0, 1)
        level *= dr.select(contact.is_curved(), x * x * (3 - 2 * x), 1.0)
    for phase in (*slopes, *bends):
        active = active & (dr.abs(phase) < MOST_PHASE)
    return dr.select(active, re * level, 0.0), dr.select(active, im * level, 0.0)


def footprint_moments(alpha: Any, beta: Any) -> list[list[tuple[Any, Any]]]:
    """Compute the integrals of (1 - |x|) x^n exp(-j (alpha x + beta x^2)) over [-1, 0] and over [0, 1] for n = 0, 1, 2.

    The variable x is a grid coordinate across the tube, in tube widths. If the phase changes by less than about two cycles, the function
    uses Gauss-Legendre quadrature with an error of 1e-7. If the phase changes more, the function uses an asymptotic expression, which
    contains the leading terms of both ends and has an error below 2e-3.

    Returns:
        For both halves, one pair (real part, imaginary part) for each of the three integrals.
    """
    halves = []
    waves = []
    for node, weight in zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True):
        sine, cosine = dr.sincos(beta * float(node * node))
        odd, even = dr.sincos(alpha * float(node))
        waves.append((float(node), float(weight * (1 - node)), sine, cosine, odd, even))
    for side in (-1.0, 1.0):
        moments = [[mi.Float(0.0), mi.Float(0.0)] for _ in range(3)]
        for x, weight, sine, cosine, odd, even in waves:
            for n, moment in enumerate(moments):
                part = weight * (side * x) ** n
                moment[0] += part * (cosine * even - side * sine * odd)
                moment[1] -= part * (sine * even + side * cosine * odd)
        slope = side * alpha
        end = dr.rcp(dr.square(slope + 2 * beta))
        sine, cosine = dr.sincos(slope + beta)
        steep = (dr.abs(alpha) > STEEP) & (dr.abs(alpha) > 3.9 * dr.abs(beta))
        inverse = dr.rcp(slope)
        tip, kink = (-cosine * end, sine * end), dr.square(inverse)
        far = [(tip[0] + kink * (1 + 2 * beta * inverse), tip[1] - inverse), (side * (tip[0] - kink), side * tip[1]), tip]
        halves.append([tuple(dr.select(steep, f, m) for f, m in zip(*pair, strict=True)) for pair in zip(far, moments, strict=True)])
    return halves


def footprint_integral(alpha: Sequence[Any], beta: Sequence[Any], twist: Any, share: Any = None) -> tuple[Any, Any]:
    """Integrate w(x) w(y) exp(-j (alpha . (x, y) + beta . (x^2, y^2) + twist x y)) over a tube's footprint, with w(x) = 1 - |x|.

    The integral only includes the squares in which the tube contributes, as in `TubeSelection.share`; None: all four. The function expands
    the factor exp(-j twist x y) to second order in `twist`.

    Returns:
        Real part and imaginary part of the integral.
    """
    first, second = (footprint_moments(a, b) for a, b in zip(alpha, beta, strict=True))
    products = [(mi.Float(0.0), mi.Float(0.0)) for _ in range(3)]
    for n in range(3):
        for bit, (j, i) in enumerate(itertools.product(range(2), repeat=2)):
            a, b = first[i][n], second[j][n]
            part = a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]
            if share is not None:
                part = [dr.select(share & (1 << bit) != 0, value, 0.0) for value in part]
            products[n] = products[n][0] + part[0], products[n][1] + part[1]
    twist = dr.clip(twist, -MOST_TWIST, MOST_TWIST)
    square = 0.5 * twist * twist
    (even_re, even_im), (odd_re, odd_im), (square_re, square_im) = products
    return even_re + twist * odd_im - square * square_re, even_im - twist * odd_re - square * square_im


def piece_integral(corners: Sequence[tuple[Any, Any]], alpha: Sequence[Any], beta: Sequence[Any], twist: Any) -> tuple[Any, Any]:
    """Integrate exp(-j (alpha . (x, y) + beta . (x^2, y^2) + twist x y)) over a convex piece of a tube's footprint.

    The triangles between the first corner and each side have a closed form for a phase that is linear between their corners. The mean of
    what the second-order phase differs from this is taken away from the phase of each triangle.

    Returns:
        Real part and imaginary part of the integral.
    """

    def second(x: Any, y: Any) -> Any:
        return x * (beta[0] * x + twist * y) + beta[1] * y * y

    twist = dr.clip(twist, -MOST_TWIST, MOST_TWIST)
    phases = [alpha[0] * x + alpha[1] * y + second(x, y) for x, y in corners]
    re, im = mi.Float(0.0), mi.Float(0.0)
    (x0, y0), p0 = corners[0], phases[0]
    for ((x1, y1), p1), ((x2, y2), p2) in itertools.pairwise(zip(corners[1:], phases[1:], strict=True)):
        twice_area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
        bulge = (second(x1 - x0, y1 - y0) + second(x2 - x0, y2 - y0) + second(x2 - x1, y2 - y1)) / 12
        part_re, part_im = triangle_integral(p0, p1, p2)
        sine, cosine = dr.sincos(bulge)
        re += twice_area * (part_re * cosine - part_im * sine)
        im += twice_area * (part_re * sine + part_im * cosine)
    return re, im


def triangle_integral(p0: Any, p1: Any, p2: Any) -> tuple[Any, Any]:
    """Integrate exp(-j p) over a triangle with twice the area 1, on which the phase p is linear between its values at the corners.

    The integral is the divided difference [S(p0, p1) - S(p0, p2)]/(-j (p1 - p2)), where S is the mean of exp(-j p) between two corners. The
    function calls those corners 1 and 2 whose phases differ most, and uses a power series if all phases are close.

    Returns:
        Real part and imaginary part of the integral.
    """
    first, second, third = dr.abs(p1 - p2), dr.abs(p2 - p0), dr.abs(p0 - p1)
    middle = dr.select(first >= dr.maximum(second, third), p0, dr.select(second >= third, p1, p2))
    end_1 = dr.select(middle == p0, p1, p0)
    end_2 = p0 + p1 + p2 - middle - end_1
    a, b = end_1 - middle, end_2 - middle
    far = dr.abs(a - b)
    scale = dr.rcp(dr.select(far < CLOSE, 1.0, b - a))
    means = []
    for x in (a, b):  # mean of exp(-j p) between the middle corner and the other one, relative to the middle corner
        sine, cosine = dr.sincos(0.5 * x)
        sinc = dr.select(dr.abs(x) < 1e-3, 1.0, 2 * sine * dr.rcp(x))
        means.append((sinc * cosine, -sinc * sine))
    (re_a, im_a), (re_b, im_b) = means
    re = dr.select(far < CLOSE, 0.5 - (a * a + a * b + b * b) / 24, (im_a - im_b) * scale)
    im = dr.select(far < CLOSE, -(a + b) / 6, (re_b - re_a) * scale)
    sine, cosine = dr.sincos(middle)
    return re * cosine + im * sine, im * cosine - re * sine
