"""Echoes of metal objects to a small antenna at a finite distance, with phase: a sphere (exact), and a cylinder seen broadside.

Each echo is received over transmitted amplitude between isotropic antennas, with the phase exp(+j k L). Symbols: a -> radius, r -> distance
of the antenna from the centre, R_n -> reflection of the multipole of order n. Sphere: (j/4) sum (2n+1) [R_n^TE h_n(kr)^2 + R_n^TM
(zeta_n'(kr)/(kr))^2]. Ref: R. Ruppin, J. Chem. Phys. 76 (1982) 1681. Cylinder: the field of a mirrored point source, times the series of
the infinite cylinder over geometric optics, times the Fresnel integral over the length; its relative error is of the order of the square of
half the length over the distance. Ref: C. Balanis (2012), section 11.5.
"""

import numpy as np
from scipy.special import fresnel, spherical_jn, spherical_yn

from experiments.validation.oracles.case import SPEED_OF_LIGHT
from experiments.validation.oracles.cylinder import _orders, coefficients


def sphere_echo(radius_m: float, distance_m: float, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Return the complex echo amplitude (F,) of a conducting sphere whose centre is `distance_m` away.

    >>> far = sphere_echo(0.05, 100.0, 77e9)  # sigma = pi a^2 within a few per cent: a = 80 wavelengths / 2 pi
    >>> sigma = (4 * np.pi) ** 3 * 100.0**4 * abs(far[0]) ** 2 / (SPEED_OF_LIGHT / 77e9) ** 2
    >>> bool(abs(sigma / (np.pi * 0.05**2) - 1) < 0.02)
    True
    """
    out = []
    for k in 2 * np.pi * np.atleast_1d(frequency_hz) / SPEED_OF_LIGHT:
        order = np.arange(1, len(_orders(k * radius_m)))
        jn, h, slope_j, slope_h = _radial(order, k * radius_m)
        _, far, _, slope_far = _radial(order, k * distance_m)
        terms = -jn / h * far**2 - slope_j / slope_h * slope_far**2
        # a slope is (z f)'/z; the factor 1/z cancels in slope_j / slope_h
        out.append(0.25j * np.sum((2 * order + 1) * terms))
    return np.array(out)


def _radial(order: np.ndarray, z: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the spherical Bessel function j_n, the spherical Hankel function h_n of the first kind, and (z j_n)'/z, (z h_n)'/z."""
    jn, yn = spherical_jn(order, z), spherical_yn(order, z)
    dj, dy = spherical_jn(order, z, True), spherical_yn(order, z, True)
    h, dh = jn + 1j * yn, dj + 1j * dy
    return jn, h, dj + jn / z, dh + h / z


def cylinder_echo(radius_m: float, length_m: float, distance_m: float, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Return the echo (F,) of an upright conducting cylinder at the radar's height, `distance_m` from its axis, vertically polarised."""
    near = distance_m - radius_m
    mirrored = 1 / (1 / near + 2 / radius_m)  # radius of curvature of the reflected wave around the cylinder
    level = np.sqrt(mirrored / (mirrored + near) / 2) / near
    out = []
    for k in 2 * np.pi * np.atleast_1d(frequency_hz) / SPEED_OF_LIGHT:
        size = k * radius_m
        order = _orders(size)
        scattered = coefficients([radius_m], [], 2 * np.pi / k, order) * np.exp(1j * size)  # removes exp(-j k a) of `coefficients`
        series = np.conj(np.sum(np.where(order == 0, 1, 2) * (-1.0) ** order * scattered))
        limit = -np.sqrt(np.pi * size) / 2 * np.exp(1j * (np.pi / 4 - 2 * size))
        sine, cosine = fresnel(length_m * np.sqrt(k / (2 * np.pi * near)))
        truncated = (cosine + 1j * sine) / (0.5 + 0.5j)
        out.append(-level / (2 * k) * series / limit * truncated * np.exp(2j * k * near))
    return np.array(out)
