"""Transmission of stacks, independently of the package where `FITS` or the oracle has the material, for the time factor exp(+j omega t)."""

import numpy as np
from scipy.constants import epsilon_0

from experiments.validation.oracles import stack
from radartwin.constants import SPEED_OF_LIGHT as C

# relative permittivity at f GHz: real part, and c and d of the conductivity c f^d (ITU-R P.2040-4, table 3); HDPE from J. Lamb 1996
FITS = {
    **stack.BUILDING,
    "chipboard": (2.58, 0.0217, 0.7800),
    "ceiling_board": (1.48, 0.0011, 1.0750),
    "floorboard": (3.66, 0.0044, 1.3515),
}
PANES = {
    "glass 6 mm": [("glass", 0.006)],
    "plasterboard 15 mm": [("plasterboard", 0.015)],
    "wood 8 mm": [("wood", 0.008)],
    "HDPE 2 mm": [("hdpe", 0.002)],
    "cardboard": [("chipboard", 0.0003), ("air", 0.0034), ("chipboard", 0.0003)],  # 4 mm in all
    "double glazing": [("glass", 0.004), ("air", 0.016), ("glass", 0.004)],
}


def permittivity(name, f):
    if name == "hdpe":
        return 2.31 * (1 - 0.0003j)
    if name not in FITS:
        return stack.permittivity(name, f)
    real, c, d = FITS[name]
    return real - 1j * c * (f / 1e9) ** d / (2 * np.pi * f * epsilon_0)


def tangential(layers, backing, cosine, f, parallel):
    """Return reflection and transmission of the tangential electric field: layers of (permittivity, thickness) before a half-space.

    Ref: Abeles' characteristic matrices, M. Born, E. Wolf, Principles of Optics, 1.6.
    """
    sine2 = 1 - cosine**2

    def admittance(eps):
        normal = np.sqrt(eps - sine2 + 0j)
        return eps / normal if parallel else normal

    matrix = np.eye(2, dtype=complex)
    for eps, depth in layers:
        turn, y = 2 * np.pi * f / C * np.sqrt(eps - sine2 + 0j) * depth, admittance(eps)
        matrix = matrix @ np.array([[np.cos(turn), 1j * np.sin(turn) / y], [1j * y * np.sin(turn), np.cos(turn)]])
    electric, magnetic = matrix @ np.array([1, admittance(backing)])
    air = admittance(1.0)
    return (air * electric - magnetic) / (air * electric + magnetic), 2 * air / (air * electric + magnetic)


def transmitted(layers, cosine, f):
    """Return (te, tm): the field behind a pane over the field there without the pane."""
    stack = [(permittivity(name, f), depth) for name, depth in layers]
    air = np.exp(2j * np.pi * f / C * cosine * sum(depth for _, depth in layers))
    return [tangential(stack, 1.0, cosine, f, parallel)[1] * air for parallel in (False, True)]
