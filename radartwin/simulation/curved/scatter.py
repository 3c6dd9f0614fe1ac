"""Compute the contribution of a ray tube's footprint (its cross-section on the surface) to the received signal.

`radartwin.simulation.curved.tubes` explains the formulas and symbols. Import this module only after a Mitsuba variant is active.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.contact import Contact, encounter
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Tubes

# Largest second-order phase across a tube's footprint on a curved surface, in radians. A steep first-order phase raises this limit.
MOST_BEND = 3.0
TERMINATOR = 0.4  # cosine of incidence below which the currents on a curved surface fade out, except towards the mirror direction
# If the phase changes by more than this many radians across half a tube, the footprint integral is computed from the kinks of the weight.
STEEP = 14.0
MOST_TWIST = 2.0  # largest mixed second-order phase (the term u v of the phase expansion) across a tube's footprint, in radians
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


class Reception(NamedTuple):
    """Describe the receiver as seen from the points where tubes meet surfaces."""

    direction: Any  # unit vector from the point on the surface to the receiver
    length: Any  # distance from the point on the surface to the receiver, in metres
    across: Any  # receive polarisation vector without walls between the surface and the receiver
    plane: bool  # whether the receiver is infinitely far away, as for the far-field radar cross-section


def scatter(device: Device, tubes: Tubes, contact: Contact, reception: Reception, wavenumber: Any, active: Any) -> list[Any]:
    """Add the reflection at the contact to the encounters of the tubes, and compute how the receiver sees the reflected tubes.

    Returns:
        The real and the imaginary part of the footprint's factor, and the eight factors `received` of `jones.Coefficients.amplitudes`.
    """
    re, im = _footprint(device, tubes, contact, reception, wavenumber, active)
    re, im = dr.select(tubes.caustics & 1 == 1, -im, re), dr.select(tubes.caustics & 1 == 1, re, im)
    sign = dr.select(tubes.caustics & 2 == 2, mi.Float(-1.0), 1.0)
    s, met = encounter(device, contact, tubes.direction, tubes.across, False, active)
    tubes.across, tubes.encounters = s, [*tubes.encounters, met]
    fields = [(way, e) for way in (tubes.direction, contact.mirrored(tubes.direction)) for e in (s, dr.cross(way, s))]
    radiated = []
    for way, e in fields:
        electric = dr.cross(contact.normal, dr.cross(way, e))
        magnetic = dr.cross(dr.cross(e, contact.normal), reception.direction)
        radiated.append(electric + magnetic)
    ends = reception.across, dr.cross(reception.direction, reception.across)
    return [sign * re, sign * im, *(dr.dot(end, vector) for end in ends for vector in radiated)]


def _footprint(device: Device, tubes: Tubes, contact: Contact, reception: Reception, wavenumber: Any, active: Any) -> tuple[Any, Any]:
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

    hat = device.hats
    if device.curved:
        hat = hat | contact.is_curved()
    slopes = [wavenumber * dr.dot(gradient, step) for step in steps]
    bends = [0.5 * wavenumber * bend(i, i) for i in range(2)]
    if device.curved:  # near the shadow line of a curved surface, the second-order expansion of the phase is not valid beyond this limit
        for i, slope in enumerate(slopes):
            most = dr.select(contact.is_curved(), dr.maximum(0.25 * dr.abs(slope), MOST_BEND), dr.inf)
            bends[i] = dr.clip(bends[i], -most, most)
    re, im = footprint_integral(slopes, bends, wavenumber * bend(0, 1), hat)
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
    if tubes.hat_share is not None:
        level *= dr.select(hat, tubes.hat_share, dr.select(tubes.in_box, mi.Float(1.0), 0.0))
    return dr.select(active, re * level, 0.0), dr.select(active, im * level, 0.0)


def footprint_moments(alpha: Any, beta: Any, hat: Any) -> list[tuple[Any, Any]]:
    """Compute the integrals of w(x) exp(-j beta x^2) times cos(alpha x), times x sin(alpha x) and times x^2 cos(alpha x).

    The variable x is a grid coordinate across the tube, in tube widths. The weight w is a triangle (hat) on [-1, 1] where `hat` is true,
    and a constant (box) on [-1/2, 1/2] elsewhere. If the phase changes by less than about two cycles across half the weight, the function
    uses Gauss-Legendre quadrature with an error of 1e-7. If the phase changes more, the function uses an asymptotic expression for the
    first integral and sets the second and third integral to zero. For a hat, this expression contains the leading terms of its three kinks
    and has an error below 2e-3. For a box, the expression is the exact integral for beta = 0.

    Returns:
        One pair (real part, imaginary part) for each of the three integrals.
    """
    half, slope = dr.select(hat, mi.Float(1.0), 0.5), dr.select(hat, mi.Float(1.0), 0.0)
    moments = [[mi.Float(0.0), mi.Float(0.0)] for _ in range(3)]
    for node, weight in zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True):
        x = half * float(node)
        share = half * float(2 * weight) * (1 - slope * float(node))
        sine, cosine = dr.sincos(beta * x * x)
        odd, even = dr.sincos(alpha * x)
        for moment, part in zip(moments, (share * even, share * x * odd, share * x * x * even), strict=True):
            moment[0] += part * cosine
            moment[1] -= part * sine
    up, down = dr.rcp(dr.square(alpha + 2 * beta)), dr.rcp(dr.square(alpha - 2 * beta))
    (sine_up, cosine_up), (sine_down, cosine_down) = dr.sincos(beta + alpha), dr.sincos(beta - alpha)
    steep = (dr.abs(alpha) * half > STEEP) & (dr.abs(alpha) > 3.9 * dr.abs(beta))
    box = 2 * dr.sin(0.5 * alpha) * dr.rcp(alpha)
    far_re = dr.select(hat, 2 * dr.rcp(dr.square(alpha)) - cosine_up * up - cosine_down * down, box)
    far_im = dr.select(hat, sine_up * up + sine_down * down, 0.0)
    far = [(far_re, far_im), (mi.Float(0.0), mi.Float(0.0)), (mi.Float(0.0), mi.Float(0.0))]
    return [tuple(dr.select(steep, f, n) for f, n in zip(*pair, strict=True)) for pair in zip(far, moments, strict=True)]


def footprint_integral(alpha: Sequence[Any], beta: Sequence[Any], twist: Any, hat: Any) -> tuple[Any, Any]:
    """Integrate w(x) w(y) exp(-j (alpha . (x, y) + beta . (x^2, y^2) + twist x y)) over a tube's footprint.

    The function expands the factor exp(-j twist x y) to second order in `twist`.

    Returns:
        Real part and imaginary part of the integral.
    """
    first, second = (footprint_moments(a, b, hat) for a, b in zip(alpha, beta, strict=True))
    products = [(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]) for a, b in zip(first, second, strict=True)]
    twist = dr.clip(twist, -MOST_TWIST, MOST_TWIST)
    square = 0.5 * twist * twist
    (even_re, even_im), (odd_re, odd_im), (square_re, square_im) = products
    return even_re - twist * odd_im - square * square_re, even_im + twist * odd_re - square * square_im
