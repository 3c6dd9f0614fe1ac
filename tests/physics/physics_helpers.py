"""Define constants and helper functions that several physics tests use."""

from typing import Any

import numpy as np

from radartwin.scene.trajectories import trajectory

FREQUENCY = 77e9
WAVELENGTH = 299_792_458.0 / FREQUENCY
K = 2 * np.pi / WAVELENGTH
UP = np.array([[0.0, 0.0, 1.0]])


def db(power_ratio):
    return 10 * np.log10(power_ratio)


def coherent(hits, keep: Any = slice(None)):
    """Return the complex sum of the fields of ray hits at 77 GHz."""
    return (hits.amplitude[:, 0] * np.exp(1j * K * (hits.length_in_m + hits.length_out_m)))[keep].sum()


def relative_error(ours, exact):
    """Return the norm of the difference between `ours` and `exact`, divided by the norm of `exact`."""
    return float(np.linalg.norm(ours - exact) / np.linalg.norm(exact))


def at(x, y=0.0, z=0.0):
    """Return the pose (4, 4) of a body at this point, with its axes along the world axes."""
    return trajectory.pose([x, y, z])


def mie_backscatter(radius):
    """Return the cross-section of a metal sphere from the Mie series with a very large refractive index."""
    import miepython

    return miepython.efficiencies_mx(1e4 - 1e4j, 2 * np.pi * radius / WAVELENGTH)[2] * np.pi * radius**2


def geometric_optics_of_a_sphere(centre, radius, source, target, wavelength=WAVELENGTH):
    """Return (amplitude, path length, reflection point) of the wave that a metal sphere reflects. Source and target may be anywhere outside
    the sphere; the polarisation is ignored.

    The wave leaves the reflection point with the curvature 1/r + 2/(a cos t) in the plane of incidence and 1/r + 2 cos t/a at right angles
    to it. Here r is the distance from the source, a the radius of the sphere and t the angle of incidence. Ref: J. Keller, J. Opt. Soc. Am.
    52 (1962) 116, section on reflection.
    """
    out, back = source - centre, target - centre
    # the point of shortest way: by bisection on the great circle between the two directions
    u = out / np.linalg.norm(out)
    v = back - (back @ u) * u
    opening = np.arctan2(np.linalg.norm(v), back @ u)
    v = v / np.linalg.norm(v) if opening > 1e-9 else np.cross(u, np.eye(3)[np.argmin(np.abs(u))])

    def point(t):
        return centre + radius * (np.cos(t) * u + np.sin(t) * v)

    low, high = 0.0, opening
    for _ in range(100):
        third, other = (2 * low + high) / 3, (low + 2 * high) / 3
        a, b = (np.linalg.norm(point(t) - source) + np.linalg.norm(point(t) - target) for t in (third, other))
        low, high = (low, other) if a < b else (third, high)
    place = point((low + high) / 2)
    r1, r2 = np.linalg.norm(place - source), np.linalg.norm(place - target)
    cosine = (place - centre) @ (source - place) / (radius * r1)
    within, across = 1 / r1 + 2 / (radius * cosine), 1 / r1 + 2 * cosine / radius
    spread = 1 / np.sqrt((1 + r2 * within) * (1 + r2 * across))
    return wavelength / (4 * np.pi) * spread / r1, r1 + r2, place
