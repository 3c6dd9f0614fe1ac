"""Uniform diffraction coefficients of a wedge, and the Fresnel integral that they and finite edges need.

Time factor exp(+j omega t). A wedge fills the angles from n pi to 2 pi. The angles phi (observer) and phi0 (source) are measured from face
0 of the wedge through the open sector, perpendicular to the edge. With the source at the distance s0 from the edge point and the observer
at s, the diffracted field is

    E = D E0 / sqrt(s0 s (s0 + s)) exp(-j k (s0 + s)),   D = c [(a + b) I + R_n c_n + R_0 c_0]

for a source whose field is E0 exp(-j k r)/r. The terms a and b belong to the two shadow boundaries, c_n and c_0 to the reflection
boundaries of face n and face 0. R_n, R_0 are the reflection matrices of the faces. On metal, R_n and R_0 are -1 for the field along the
edge and +1 for the field across it. The sum of the incident, reflected and diffracted fields is continuous at every boundary. For a
half-plane of metal and a plane wave, the sum is Sommerfeld's exact solution.

Ref: R. G. Kouyoumjian, P. H. Pathak, Proc. IEEE 62 (1974) 1448, for the coefficient; R. J. Luebbers, IEEE Trans. AP 32 (1984) 70, for
faces that are not metal; Y. M. Hwang, R. G. Kouyoumjian, URSI (1974), for the slope term.
"""

import cmath
import math

import numpy as np
from scipy.special import wofz

from radartwin.compiled import inner

STEPS, LAST = 2048, 8.0  # table of `scaled_tail`; cubic interpolation between its steps has an error below 1e-12
_GRID = np.linspace(0, LAST, STEPS + 1)
TAIL = np.sqrt(np.pi) / 2 * np.exp(-0.25j * np.pi) * wofz(1j * np.exp(0.25j * np.pi) * _GRID)
_NEAR = 1e-6  # sine of an angle to a boundary below which the limits of the terms are used
_TURN = cmath.exp(0.25j * math.pi)


@inner
def scaled_tail(u: float) -> complex:
    """Return exp(j u^2) times the integral of exp(-j t^2) from u >= 0 to infinity."""
    if u >= LAST:
        x = u * u
        return (1 + 0.5j / x - 0.75 / (x * x) - 1.875j / (x * x * x)) / (2j * u)
    place = u * (STEPS / LAST)
    i = int(place)
    t, step = place - i, LAST / STEPS
    rest, low, high = 1 - t, TAIL[i], TAIL[i + 1]
    # slopes 2j u I - 1 of the values I, times the step; a table of them would need half of a processor's first cache
    slope_low, slope_high = (2j * step * i * low - 1) * step, (2j * step * (i + 1) * high - 1) * step
    ends = low * (1 + 2 * t) * rest * rest + high * t * t * (3 - 2 * t)
    return ends + slope_low * t * rest * rest - slope_high * t * t * rest


@inner
def half_plane(v: float) -> complex:
    """Return the Fresnel integral of exp(-j pi t^2/2) from minus infinity to v over the integral over all t: 0 in shadow, 1 in light.

    >>> round(abs(half_plane(0.0)), 12), round(abs(half_plane(50.0)), 2)
    (0.5, 1.0)
    """
    u = abs(v) * math.sqrt(0.5 * math.pi)
    rest = math.sqrt(2 / math.pi) * scaled_tail(u) * cmath.exp(-1j * u * u) / (1 - 1j)
    return 1 - rest if v >= 0 else rest


@inner
def _term(sign: float, beta: float, n: float, kl: float) -> tuple[complex, complex]:
    """Return cot((pi + sign beta)/2n) F(kl a), and its derivative by beta at constant a, which has no jump at the boundary."""
    order = round((sign * math.pi + beta) / (2 * math.pi * n))
    argument = (math.pi + sign * beta) / (2 * n)
    sine = math.sin(argument)
    if abs(sine) < _NEAR:
        beside = sign * (beta - 2 * math.pi * n * order) + math.pi
        side = 1.0 if beside >= 0 else -1.0
        limit = n * (math.sqrt(2 * math.pi * kl) * side - 2 * kl * beside * _TURN) * _TURN
        return limit, complex(0.0, -2 * sign * n * kl)
    u = math.sqrt(2 * kl) * abs(math.cos(math.pi * n * order - 0.5 * beta))
    transition = 2j * u * scaled_tail(u)
    slope = -sign / (2 * n * sine * sine) * 2j * u * u * (1 - transition)
    return math.cos(argument) / sine * transition, slope


@inner
def coefficients(
    phi: float, phi0: float, n: float, wavenumber: float, sine: float, distance: float
) -> tuple[complex, complex, complex, complex, complex]:
    """Return the terms of the diffraction coefficient, in square roots of metres.

    Args:
        phi, phi0: angles of observer and source, rad. n: open angle of the wedge over pi. wavenumber: rad/m.
        sine: sine of the angle between ray and edge. distance: distance parameter s0 s/(s0 + s) sine^2, metres.
    Returns:
        The sum of both shadow-boundary terms; the reflection-boundary terms of face 0 and of face n; the derivatives by phi of the sum of
        the shadow terms and of the sum of the reflection terms for metal. The derivatives by phi0 are the negative of the first derivative,
        and equal to the second derivative.
    """
    kl = wavenumber * distance
    c = -_TURN.conjugate() / (2 * n * math.sqrt(2 * math.pi * wavenumber) * sine)
    shadow_n, slope_n = _term(1.0, phi - phi0, n, kl)
    shadow_0, slope_0 = _term(-1.0, phi - phi0, n, kl)
    mirror_n, bend_n = _term(1.0, phi + phi0, n, kl)
    mirror_0, bend_0 = _term(-1.0, phi + phi0, n, kl)
    return c * (shadow_n + shadow_0), c * mirror_0, c * mirror_n, c * (slope_n + slope_0), c * (bend_n + bend_0)


@inner
def face_terms(phi: float, phi0: float, kl: float) -> tuple[complex, complex]:
    """Return the terms of the shadow boundary and of the reflection boundary of one face in physical optics.

    The terms have the jumps of the terms of `coefficients` at the boundaries. Physical optics is not reciprocal, so that the function
    returns the mean over both directions of the path. A face that is not lit has no terms. The change from a lit to an unlit face is
    smooth, because a wave that grazes the face has a transition there.

    Args:
        phi, phi0: angles of observer and source from the face, rad. kl: distance parameter times wavenumber.
    """
    there = 0.25 * (1 + math.erf(math.sqrt(2 * kl) * math.cos(0.5 * phi0)))
    back = 0.25 * (1 + math.erf(math.sqrt(2 * kl) * math.cos(0.5 * phi)))
    if there + back < 1e-6:
        return 0j, 0j
    shadow = there * _term(-1.0, phi - phi0, 1.0, kl)[0] + back * _term(-1.0, phi0 - phi, 1.0, kl)[0]
    return shadow, (there + back) * _term(-1.0, phi + phi0, 1.0, kl)[0]
