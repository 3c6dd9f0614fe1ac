"""Scattering of metal strips in two dimensions by the method of moments, with the electric field along the strips' axis z.

Refs: Harrington, Field Computation by Moment Methods (1968), section 3-2 (equation); Wu and Martinsson, Adv. Comput. Math. 47 (2021) 45
(quadrature); Senior, IEEE Trans. AP 27 (1979) 577 (resistive sheets). Symbols: G(r) = (j/4) H0(1)(k r) is the field of a unit line source,
so a path of length L has the phase exp(+j k L). The unknown q is the surface current times j k eta; the scattered field is the integral of
q G.

The total field is zero at the nodes of all strips, and the integral is the trapezoidal rule over the same nodes, with two corrections: the
weights of a node and of two on each side are corrected for the singularity log(r), to order 7; and near an end, where the current grows as
1/sqrt(distance), the nodes are equally spaced in t with distance = t^2. With 5 nodes per wavelength the error of the field is 1e-4 for a
cylinder, 6e-4 for a strip, and 2e-3 for a group of boxes and strips; cells of constant current are wrong by 1 to 2 %.

At an interior resonance of a closed body the equation does not determine the current. Every closed body therefore contains a sheet of
resistance eta/2, which damps the field inside and does not change the field outside.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from scipy.spatial.distance import cdist, pdist, squareform
from scipy.special import j0, y0, zeta

from experiments.validation.oracles.case import SPEED_OF_LIGHT

PER_WAVELENGTH = 5.0  # nodes per wavelength of the highest frequency
ROUNDING = 3.0  # number of nodes over which the spacing shrinks towards the end of a strip
INSET = 0.1  # the ends of a damping sheet are moved from the corners of its body towards the centroid by this share
EULER = 0.5772156649015329
# Corrections (self, first, second neighbour) of the trapezoidal rule for log|t| times a polynomial: their moments of t^2 and t^4 are
# 2 zeta'(-2) and 2 zeta'(-4). The moment of the constant is in the self term.
SECOND, FOURTH = -float(zeta(3)) / (2 * np.pi**2), 3 * float(zeta(5)) / (2 * np.pi**4)
CORRECTIONS = np.array([-(5 * SECOND - FOURTH) / 4, (4 * SECOND - FOURTH) / 6, (FOURTH - SECOND) / 24])


@dataclass(frozen=True)
class Nodes:
    """The N nodes of all strips: positions `point` (N, 2) and quadrature weights `weight` (N,) in metres. `beside` (N, 4) has the indices
    of the nodes at the places -1, -2, +1 and +2 along the strip; beyond an end of the strip, the mirrored node counts. `resistive` (N,)
    states which nodes belong to a resistive sheet.
    """

    point: np.ndarray
    weight: np.ndarray
    beside: np.ndarray
    resistive: np.ndarray

    def __len__(self) -> int:
        return len(self.weight)

    def __add__(self, other: "Nodes") -> "Nodes":
        moved = replace(other, beside=other.beside + len(self))
        return Nodes(*(np.concatenate([getattr(self, f.name), getattr(moved, f.name)]) for f in fields(self)))


def strip(ends: np.ndarray, spacing_m: float, resistive: bool = False) -> Nodes:
    """Return the nodes of a strip between two points (2, 2), at most `spacing_m` apart. The position is the integral of tanh(t/ROUNDING)
    near an end, so that it grows as t^2, and the mirror image of a node beyond the end is a node of the strip.
    """
    length = float(np.linalg.norm(ends[1] - ends[0]))
    n = int(np.ceil(length / spacing_m + 2 * np.log(2) * ROUNDING))
    t = np.arange(n) + 0.5

    def place(t: np.ndarray) -> np.ndarray:
        def rounded(u: np.ndarray) -> np.ndarray:
            return ROUNDING * np.logaddexp(u / ROUNDING, -u / ROUNDING)

        return rounded(t) - rounded(n - t) - t

    first, last = place(np.array([0.0, n]))
    rate = np.tanh(t / ROUNDING) + np.tanh((n - t) / ROUNDING) - 1
    point = ends[0] + ((place(t) - first) / (last - first))[:, None] * (ends[1] - ends[0])
    beside = np.arange(n)[:, None] + [-1, -2, 1, 2]
    beside = np.where(beside < 0, -1 - beside, beside)
    return Nodes(point, rate * length / (last - first), np.where(beside >= n, 2 * n - 1 - beside, beside), np.full(n, resistive))


def damping_sheet(body: np.ndarray) -> np.ndarray:
    """Return the ends (2, 2) of a resistive sheet inside a convex body (V, 2), off the diagonals, where some modes of a square vanish."""
    inner, half = body + INSET * (body.mean(axis=0) - body), len(body) // 2
    return np.array([inner[0], 0.65 * inner[half] + 0.35 * inner[half + 1]])


def nodes(surfaces: Iterable[np.ndarray], frequency_hz: float, per_wavelength: float = PER_WAVELENGTH) -> Nodes:
    """Return the nodes of surfaces (S, 2, 2), of which those whose strips join in a ring are closed bodies."""
    spacing = SPEED_OF_LIGHT / frequency_hz / per_wavelength
    parts = []
    for strips in surfaces:
        parts += [strip(ends, spacing) for ends in strips]
        if len(strips) > 2 and np.allclose(strips[:, 1], np.roll(strips[:, 0], -1, axis=0)):
            parts.append(strip(damping_sheet(strips[:, 0]), spacing, resistive=True))
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def field(at: Nodes, frequency_hz: float, source: np.ndarray, receivers: np.ndarray, precision: type = np.complex64) -> np.ndarray:
    """Return the scattered field (R,) at receivers (R, 2) of a unit line source at (2,), both in metres, for one frequency. The incident
    field of the line source is G, so the field has no unit. `precision` is the number type of the matrix.
    """
    k = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    current = lu_solve(
        lu_factor(_matrix(at, k, precision), overwrite_a=True, check_finite=False),
        -_green(k, cdist(at.point, source[None]))[:, 0].astype(precision), check_finite=False,
    )  # fmt: skip
    return (_green(k, cdist(receivers, at.point)) * at.weight) @ current.astype(complex)


def sweep(at: Nodes, frequencies_hz: np.ndarray, source: np.ndarray, receiver: np.ndarray) -> np.ndarray:
    """Return the scattered field (F,) of a unit line source at one receiver, both at positions (2,), at frequencies (F,)."""
    return np.array([field(at, f, source, receiver[None])[0] for f in frequencies_hz])


def _green(k: float, distance_m: np.ndarray) -> np.ndarray:
    """Return the field of a unit line source at distances in metres."""
    return 0.25j * (j0(k * distance_m) + 1j * y0(k * distance_m))


def _matrix(at: Nodes, k: float, precision: type) -> np.ndarray:
    """Return the matrix (N, N) of the integral equation. The near field of a node is -log(r) J0(k r)/(2 pi) plus a smooth function."""
    matrix = squareform(_green(k, pdist(at.point)).astype(precision)) * at.weight.astype(np.finfo(precision).dtype)
    row = np.arange(len(at))
    for column, correction in zip(at.beside.T, CORRECTIONS[[1, 2, 1, 2]], strict=True):
        away = k * np.linalg.norm(at.point[column] - at.point, axis=1)
        np.add.at(matrix, (row, column), (-correction / (2 * np.pi) * j0(away) * at.weight[column]).astype(precision))
    self_term = 0.25j - (np.log(k * at.weight / (4 * np.pi)) + EULER + CORRECTIONS[0]) / (2 * np.pi)
    matrix[row, row] += (self_term * at.weight - np.where(at.resistive, 0.5 / (1j * k), 0)).astype(precision)
    return matrix
