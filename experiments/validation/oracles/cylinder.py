"""Exact scattering of infinitely long round cylinders at normal incidence, with the electric field along the axis.

Ref: Balanis (2012), section 11.5. Symbols: a_n -> coefficients of the outgoing wave relative to J_n of the incident wave, k_i ->
wavenumber in layer i. Time convention exp(+j omega t): outgoing waves are Hankel functions of the second kind, loss is eta' - j eta''. The
field in each layer is J_n(k r) + b_n H_n(k r); the electric field E and its radial derivative are continuous at the boundaries of the
layers. Scaled Bessel functions prevent overflow in lossy liquids.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import hankel2e, jve


def _orders(size: float) -> np.ndarray:
    """Return the orders n that the series needs for a circumference of `size` wavelengths. Ref: Wiscombe, Appl. Opt. 19 (1980) 1505."""
    return np.arange(int(np.ceil(size + 4.05 * size ** (1 / 3) + 10)) + 1)


def conductor_width(radius_m: float, wavelength_m: float) -> float:
    """Return the backscatter echo width in metres of an infinitely long, perfectly conducting cylinder.

    >>> bool(abs(conductor_width(0.5, 0.004) / (np.pi * 0.5) - 1) < 1e-3)
    True
    """
    return layered_width([radius_m], [], wavelength_m)


def layered_width(radii_m: Sequence[float], permittivities: Sequence[complex], wavelength_m: float) -> float:
    """Return the backscatter echo width in metres of concentric layers, outermost first; without the last permittivity on a conductor."""
    k0 = 2 * np.pi / wavelength_m
    order = _orders(k0 * radii_m[0])
    sign = np.where(order == 0, 1, 2) * (-1.0) ** order
    return float(4 / k0 * abs((sign * coefficients(radii_m, permittivities, wavelength_m, order)).sum()) ** 2)


def coefficients(radii_m: Sequence[float], permittivities: Sequence[complex], wavelength_m: float, order: np.ndarray) -> np.ndarray:
    """Return a_n exp(-j k a) (N,) of the scattered wave sum of (-j)^n a_n H_n(k r) exp(j n phi), for the outer radius a."""
    k0 = 2 * np.pi / wavelength_m
    # E'/E at each radius, computed outwards from the core
    slope = None
    for number in range(len(radii_m) - 1, -1, -1):
        radius = radii_m[number]
        if number < len(permittivities):
            k = k0 * np.sqrt(complex(permittivities[number]))
            inside = radii_m[number + 1] if number + 1 < len(radii_m) else None
            slope = _carried(order, k, inside, radius, slope)
        else:
            slope = np.full(len(order), np.inf)
    assert slope is not None
    x = k0 * radii_m[0]
    j, dj = _bessel(order, x)
    h, dh = _hankel(order, x)
    if np.isinf(slope).all():
        return -j / h
    return -(k0 * dj - slope * j) / (k0 * dh - slope * h)


def _carried(order: np.ndarray, k: complex, inner: float | None, outer: float, slope: np.ndarray | None) -> np.ndarray:
    """Return E'/E at the outer radius of a layer from E'/E at its inner radius. The core has no inner radius."""
    j, dj = _bessel(order, k * outer)
    if inner is None or slope is None:
        return k * dj / j
    h, dh = _hankel(order, k * outer)
    ji, dji = _bessel(order, k * inner)
    hi, dhi = _hankel(order, k * inner)
    # jve and hankel2e are scaled by exp(-|Im z|) and exp(+j z); this undoes the scaling between the two radii
    ratio = -ji / hi if np.isinf(slope).all() else -(k * dji - slope * ji) / (k * dhi - slope * hi)
    decay = np.exp(abs((k * inner).imag) - abs((k * outer).imag)) * np.exp(1j * (k * inner - k * outer))
    b = ratio * decay
    return k * (dj + b * dh) / (j + b * h)


def _bessel(order: np.ndarray, z: complex) -> tuple[np.ndarray, np.ndarray]:
    """Return the Bessel function J_n and its derivative, both multiplied by exp(-|Im z|)."""
    value = jve(order, z)
    return value, jve(order - 1, z) - order / z * value


def _hankel(order: np.ndarray, z: complex) -> tuple[np.ndarray, np.ndarray]:
    """Return the Hankel function H_n of the second kind and its derivative, both multiplied by exp(+j z)."""
    value = hankel2e(order, z)
    return value, hankel2e(order - 1, z) - order / z * value
