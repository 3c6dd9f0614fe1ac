"""Compute the transmission of panes by characteristic matrices, independently of the package, for the time factor exp(+j omega t)."""

import numpy as np

C = 299_792_458.0
EPS0 = 8.8541878128e-12
# relative permittivity at f GHz: real part, and c and d of the conductivity c f^d (ITU-R P.2040-4, table 3); HDPE from J. Lamb 1996
FITS = {
    "glass": (6.31, 0.0036, 1.3394), "plasterboard": (2.73, 0.0085, 0.9395), "wood": (1.99, 0.0047, 1.0718),
    "chipboard": (2.58, 0.0217, 0.7800), "ceiling_board": (1.48, 0.0011, 1.0750),
}  # fmt: skip
PANES = {
    "glass 6 mm": [("glass", 0.006)],
    "plasterboard 15 mm": [("plasterboard", 0.015)],
    "wood 8 mm": [("wood", 0.008)],
    "HDPE 2 mm": [("hdpe", 0.002)],
    "cardboard": [("chipboard", 0.0003), ("air", 0.0034), ("chipboard", 0.0003)],  # 4 mm in all
    "double glazing": [("glass", 0.004), ("air", 0.016), ("glass", 0.004)],
}


def permittivity(name, f):
    if name == "air":
        return 1.0 + 0j
    if name == "hdpe":
        return 2.31 * (1 - 0.0003j)
    real, c, d = FITS[name]
    return real - 1j * c * (f / 1e9) ** d / (2 * np.pi * f * EPS0)


def transmitted(layers, cosine, f):
    """Return (te, tm): the field behind a pane over the field there without the pane (M. Born, E. Wolf, Principles of Optics, 1.6)."""
    sine2 = 1 - cosine**2
    out = []
    for tm in (False, True):
        matrix = np.eye(2, dtype=complex)
        for name, depth in layers:
            eps = permittivity(name, f)
            normal = np.sqrt(eps - sine2)
            admittance = eps / normal if tm else normal
            turn = 2 * np.pi * f / C * normal * depth
            matrix = matrix @ np.array([[np.cos(turn), 1j * np.sin(turn) / admittance], [1j * admittance * np.sin(turn), np.cos(turn)]])
        air = 1 / cosine if tm else cosine
        through = 2 * air / ((matrix[0, 0] + matrix[0, 1] * air) * air + matrix[1, 0] + matrix[1, 1] * air)
        out.append(through * np.exp(2j * np.pi * f / C * cosine * sum(depth for _, depth in layers)))
    return out
