"""Scattering of metal strips in two dimensions by the method of moments, with the electric field along the strips' axis z.

Ref: Harrington, Field Computation by Moment Methods (1968), section 3-2, for the equation; Wu and Martinsson, Adv. Comput. Math. 47 (2021)
45, for the quadrature; Senior, IEEE Trans. AP 27 (1979) 577, for resistive sheets. Symbols: G(r) = (j/4) H0(1)(k r) is the field of a unit
line source, so a path of length L has the phase exp(+j k L). The unknown q is the surface current times j k eta, so that the scattered
field is the integral of q G along all strips.

The electric-field integral equation sets the total field to zero on metal. The equation holds at the nodes of all strips (point matching),
and the integral is the trapezoidal rule over the same nodes. The module uses two corrections of this rule instead of cells of constant
current (pulses):

- The kernel has the singularity log(r) at the node of the equation. The weights of this node and of two nodes on each side are corrected by
  the zeta function, so that the rule is of order 7.
- At the end of a strip the current grows as 1/sqrt(distance). The nodes are equally spaced in a variable t with distance = t^2 near the
  end, so that current times weight is smooth.

With 5 nodes per wavelength, the error of the field is 1e-4 and 0.1 degrees for a cylinder, 6e-4 for a single strip, and 2e-3 for a group of
boxes and strips. Cells of constant current, with integrals over neighbouring cells, are wrong by 1 % for the cylinder (7 cells per
wavelength) and by 2 % for a strip turned by 20 degrees (16 cells per wavelength).

The field inside a closed body must not affect the field outside, but at an interior resonance the equation does not determine the current.
Therefore every closed body contains a sheet of resistance eta/2, which damps the field inside and does not change the field outside.

LAPACK's LU decomposition in single precision solves every frequency directly.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.linalg import lu_factor, lu_solve
from scipy.special import hankel1, j0, y0, zeta

from experiments.validation.oracles.case import SPEED_OF_LIGHT
from radartwin.compiled import compiled, innermost

PER_WAVELENGTH = 5.0  # nodes per wavelength of the highest frequency
ROUNDING = 3.0  # number of nodes over which the spacing shrinks towards the end of a strip
BORDER = 4.0  # argument at which the approximation of the Hankel function changes from one polynomial to the other
INSET = 0.1  # the ends of a damping sheet are moved from the corners of its body towards the centroid by this share
EULER = 0.5772156649015329
# Corrections (self, first, second neighbour) of the trapezoidal rule for log|t| times a polynomial: their moments of t^2 and t^4 are
# 2 zeta'(-2) and 2 zeta'(-4). The moment of the constant is in the self term.
SECOND, FOURTH = -float(zeta(3)) / (2 * np.pi**2), 3 * float(zeta(5)) / (2 * np.pi**4)
CORRECTIONS = np.array([-(5 * SECOND - FOURTH) / 4, (4 * SECOND - FOURTH) / 6, (FOURTH - SECOND) / 24])


@cache
def _coefficients() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the polynomials of `_hankel`: J0 and the regular part of Y0 in x^2 below BORDER, and the real and imaginary part of
    sqrt(x) exp(-j x) H0 in 1/x above BORDER.
    """

    def fitted(function: Any, degree: int, end: float) -> np.ndarray:
        return Chebyshev.interpolate(function, degree, [0.0, end]).convert(kind=Polynomial, domain=[-1, 1], window=[-1, 1]).coef

    def regular(square: np.ndarray) -> np.ndarray:
        x = np.sqrt(np.maximum(square, 1e-12))
        return y0(x) - 2 / np.pi * np.log(x / 2) * j0(x)

    def slow(inverse: Any) -> Any:
        x = 1 / np.maximum(inverse, 1e-6)
        return np.sqrt(x) * np.exp(-1j * x) * hankel1(0, x)

    square, inverse = BORDER**2, 1 / BORDER
    return (
        fitted(lambda t: j0(np.sqrt(t)), 10, square), fitted(regular, 10, square),
        fitted(lambda t: slow(t).real, 8, inverse), fitted(lambda t: slow(t).imag, 8, inverse),
    )  # fmt: skip


@innermost
def _polynomial(coefficients, x):
    value = coefficients[-1]
    for i in range(len(coefficients) - 2, -1, -1):
        value = value * x + coefficients[i]
    return value


@innermost
def _hankel(x, regular_j, regular_y, slow_real, slow_imaginary):
    """Return H0(1)(x) for x > 0."""
    if x < BORDER:
        bessel = _polynomial(regular_j, x * x)
        return complex(bessel, _polynomial(regular_y, x * x) + 2 / np.pi * np.log(x / 2) * bessel)
    phase = complex(np.cos(x), np.sin(x)) / np.sqrt(x)
    return phase * complex(_polynomial(slow_real, 1 / x), _polynomial(slow_imaginary, 1 / x))


@compiled
def _hankels(x, out, regular_j, regular_y, slow_real, slow_imaginary):
    for i in range(len(x)):
        out[i] = _hankel(x[i], regular_j, regular_y, slow_real, slow_imaginary)


def hankel(x: np.ndarray) -> np.ndarray:
    """Return the Hankel function H0(1) of positive arguments, with a relative error below 1e-9.

    >>> bool(np.allclose(hankel(np.array([0.01, 3.9, 4.1, 5000.0])), hankel1(0, [0.01, 3.9, 4.1, 5000.0]), rtol=1e-9))
    True
    """
    out = np.zeros(x.size, complex)
    _hankels(np.ascontiguousarray(x, float).ravel(), out, *_coefficients())
    return out.reshape(x.shape)


@compiled
def _fill(matrix, k, x, y, weight, regular_j, regular_y, slow_real, slow_imaginary):
    """Fill the matrix (N, N), in Fortran order, with the fields at nodes (rows) of unit q at other nodes (columns)."""
    for source in range(len(x)):
        for field in range(source):
            away_x, away_y = x[field] - x[source], y[field] - y[source]
            argument = k * np.sqrt(away_x * away_x + away_y * away_y)
            value = complex(0.0, 0.25) * _hankel(argument, regular_j, regular_y, slow_real, slow_imaginary)
            matrix[field, source] = value * weight[source]
            matrix[source, field] = value * weight[field]


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
    """Return the nodes of a strip between two points (2, 2), at most `spacing_m` apart.

    The position along the strip is the integral of tanh(t/ROUNDING) near its start, so it grows as t^2 there, and likewise near its end.
    The mirror image of a node beyond an end is a node of the strip.
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
    """Return the ends (2, 2) of a resistive sheet inside a closed convex body with vertices (V, 2) in order.

    The sheet lies near a diagonal but is turned off the diagonal, because some modes of a square vanish on its diagonals.
    """
    inner, half = body + INSET * (body.mean(axis=0) - body), len(body) // 2
    return np.array([inner[0], 0.65 * inner[half] + 0.35 * inner[half + 1]])


def nodes(surfaces: Iterable[np.ndarray], frequency_hz: float, per_wavelength: float = PER_WAVELENGTH) -> Nodes:
    """Return the nodes of surfaces for frequencies up to `frequency_hz`. Each surface is an array of strips (S, 2, 2).

    A surface is a closed body if each strip starts where the strip before it ends.
    """
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
    """Return the scattered field at receivers (R, 2) of a unit line source at (2,), for one frequency.

    Args:
        at: the nodes of all strips.
        frequency_hz: frequency in Hz.
        source: position in metres. receivers: positions in metres.
        precision: number type of the matrix.

    Returns:
        (R,) complex. The incident field of the line source is G, so the field has no unit.
    """
    k = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    current = lu_solve(
        lu_factor(_matrix(at, k, precision), overwrite_a=True, check_finite=False),
        -_green(k, at.point, source[None])[:, 0].astype(precision), check_finite=False,
    )  # fmt: skip
    return (_green(k, receivers, at.point) * at.weight) @ current.astype(complex)


def sweep(at: Nodes, frequencies_hz: np.ndarray, source: np.ndarray, receiver: np.ndarray) -> np.ndarray:
    """Return the scattered field (F,) of a unit line source at one receiver, both at positions (2,), at frequencies (F,)."""
    return np.array([field(at, f, source, receiver[None])[0] for f in frequencies_hz])


def _green(k: float, to: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return the fields (N, M) at points (N, 2) of unit line sources at points (M, 2)."""
    return 0.25j * hankel(k * np.linalg.norm(to[:, None] - origin[None], axis=2))


def _matrix(at: Nodes, k: float, precision: type) -> np.ndarray:
    """Return the matrix (N, N) of the integral equation. The near field of a node is -log(r) J0(k r)/(2 pi) plus a smooth function."""
    matrix = np.zeros((len(at), len(at)), precision, order="F")
    _fill(matrix, k, *at.point.T.copy(), at.weight, *_coefficients())
    row = np.arange(len(at))
    for column, correction in zip(at.beside.T, CORRECTIONS[[1, 2, 1, 2]], strict=True):
        away = k * np.linalg.norm(at.point[column] - at.point, axis=1)
        np.add.at(matrix, (row, column), (-correction / (2 * np.pi) * j0(away) * at.weight[column]).astype(precision))
    self_term = 0.25j - (np.log(k * at.weight / (4 * np.pi)) + EULER + CORRECTIONS[0]) / (2 * np.pi)
    matrix[row, row] += (self_term * at.weight - np.where(at.resistive, 0.5 / (1j * k), 0)).astype(precision)
    return matrix
