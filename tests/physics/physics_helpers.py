"""Constants and helpers that several physics tests share."""

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
    """Sum of the hits' fields at 77 GHz."""
    return (hits.amplitude[:, 0] * np.exp(1j * K * (hits.length_in_m + hits.length_out_m)))[keep].sum()


def relative_error(ours, exact):
    """Norm of the difference over the norm of `exact`."""
    return float(np.linalg.norm(ours - exact) / np.linalg.norm(exact))


def at(x, y=0.0, z=0.0):
    """(4, 4) pose at a point, with the axes of the world."""
    return trajectory.pose([x, y, z])


def mie_backscatter(radius):
    """Cross-section of a metal sphere, as the limit of a very large refractive index."""
    import miepython

    return miepython.efficiencies_mx(1e4 - 1e4j, 2 * np.pi * radius / WAVELENGTH)[2] * np.pi * radius**2
