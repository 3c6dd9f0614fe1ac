"""Integral of a second-order phase over a tube's footprint. Import only after a Mitsuba variant is active."""

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

STEEP = 14.0  # radians of phase across half a tube; beyond it, the integral follows from the kinks of the weight
MOST_TWIST = 2.0  # radians; limit of the mixed second-order phase
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def footprint_moments(alpha: Any, beta: Any, hat: Any) -> list[tuple[Any, Any]]:
    """Return the integrals of w(x) exp(-j beta x^2) times cos(alpha x), x sin(alpha x) and x^2 cos(alpha x), as real and imaginary parts.

    The weight w is a hat on [-1, 1] or a box on [-1/2, 1/2].

    If the phase changes by less than about two cycles per side, the integrals are computed by Gauss-Legendre quadrature (error: 1e-7).
    Otherwise the first integral is the leading asymptotic term of the hat's three kinks (error: below 2e-3), or of the box without
    curvature, and the other two integrals are zero.
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
    """Integrate w(x) w(y) exp(-j (alpha . (x, y) + beta . (x^2, y^2) + twist x y)) over a footprint; real and imaginary part.

    The factor exp(-j twist x y) is expanded to second order.
    """
    first, second = (footprint_moments(a, b, hat) for a, b in zip(alpha, beta, strict=True))
    products = [(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]) for a, b in zip(first, second, strict=True)]
    twist = dr.clip(twist, -MOST_TWIST, MOST_TWIST)
    square = 0.5 * twist * twist
    (even_re, even_im), (odd_re, odd_im), (square_re, square_im) = products
    return even_re - twist * odd_im - square * square_re, even_im + twist * odd_re - square * square_im
