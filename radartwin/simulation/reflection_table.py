"""Reflection coefficients of a scene's materials, tabulated over the angle of incidence for the tracer's kernels.

A table has a few frequency nodes (Chebyshev nodes of the sweep); between them, coefficients follow the interpolating polynomial. The
number of nodes is the smallest that brings the interpolation error below TOLERANCE. A half-space or a metal needs one node. A
plasterboard of 12 mm needs several nodes, because its reflection changes by 4 dB within the sweep.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.materials import Layered, reflection

COSINES = 1024
TOLERANCE = 3e-3  # largest interpolation error relative to the incident field: -50 dB, smaller than all other errors of the tracer
_NODE_COUNTS = (1, 3, 5, 8, 12)


@dataclass(frozen=True)
class ReflectionTable:
    """Hold reflection coefficients of S surfaces at Q frequencies."""

    te: np.ndarray  # (S, COSINES, Q) complex coefficients on a grid of cosines of incidence from 0 to 1
    tm: np.ndarray
    frequencies_hz: np.ndarray  # (Q,) nodes
    surfaces: tuple[tuple[str | Layered, float], ...] = ()  # (material, roughness_m) of each surface, to recognise shells

    def envelope(self) -> "ReflectionTable":
        """Return a table with the largest magnitudes over the sweep at a single node, to find the tubes that can matter."""
        te, tm = (np.abs(c).max(axis=2, keepdims=True).astype(complex) for c in (self.te, self.tm))
        return ReflectionTable(-te, tm, self.frequencies_hz.mean(keepdims=True))


def chebyshev_nodes(low_hz: float, high_hz: float, count: int) -> np.ndarray:
    """Return the Chebyshev nodes (count,) of an interval, ascending. A single node lies in the middle."""
    angle = (2 * np.arange(count)[::-1] + 1) * np.pi / (2 * count)
    return (low_hz + high_hz) / 2 + (high_hz - low_hz) / 2 * np.cos(angle)


def lagrange_basis(nodes_hz: np.ndarray, frequency_hz: np.ndarray) -> np.ndarray:
    """Return the Lagrange polynomials (Q, N) of Q nodes at N frequencies.

    >>> np.round(lagrange_basis(np.array([1.0, 2.0]), np.array([1.0, 1.5])), 3)
    array([[1. , 0.5],
           [0. , 0.5]])
    """
    count = len(nodes_hz)
    basis = np.ones((count, len(frequency_hz)))
    for i in range(count):
        for j in range(count):
            if i != j:
                basis[i] *= (frequency_hz - nodes_hz[j]) / (nodes_hz[i] - nodes_hz[j])
    return basis


def grid_of_cosines() -> np.ndarray:
    """Return the cosines of incidence (COSINES,) at which a table has values."""
    cosines = np.linspace(0, 1, COSINES)
    cosines[0] = 1e-6  # grazing limit, where TM reflection changes sign
    return cosines


def build(surfaces: Sequence[tuple[str | Layered, float]], low_hz: float, high_hz: float | None = None) -> ReflectionTable:
    """Tabulate the reflection of surfaces.

    Args:
        surfaces: (material, roughness_m) per surface of a geometry.
        low_hz, high_hz: limits of the sweep. high_hz=None: the single frequency low_hz.
    Raises:
        MaterialError: a material is unknown, or has no values at these frequencies.
    """
    cosines = grid_of_cosines()
    distinct = list(dict.fromkeys(surfaces))
    nodes = np.array([low_hz]) if high_hz is None else _nodes(distinct, low_hz, high_hz)
    values = {entry: _evaluate(entry, cosines, nodes) for entry in distinct}
    te = np.array([values[entry][0] for entry in surfaces]).reshape(len(surfaces), COSINES, len(nodes))
    tm = np.array([values[entry][1] for entry in surfaces]).reshape(len(surfaces), COSINES, len(nodes))
    return ReflectionTable(te, tm, nodes, tuple(surfaces))


def _evaluate(entry: tuple[str | Layered, float], cosines: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    material, roughness_m = entry
    return reflection(material, cosines[:, None], nodes[None, :], roughness_m)


def _nodes(distinct: Sequence[tuple[str | Layered, float]], low_hz: float, high_hz: float) -> np.ndarray:
    """Return the fewest nodes whose interpolation error is below TOLERANCE for every material at sixteen angles."""
    fine = np.linspace(low_hz, high_hz, 48)
    cosines = np.linspace(0.06, 1, 16)
    truth = [np.stack(_evaluate(entry, cosines, fine)) for entry in distinct]
    nodes = chebyshev_nodes(low_hz, high_hz, 1)
    for count in _NODE_COUNTS:
        nodes = chebyshev_nodes(low_hz, high_hz, count)
        basis = lagrange_basis(nodes, fine)
        error = [np.abs(np.stack(_evaluate(e, cosines, nodes)) @ basis - t).max() for e, t in zip(distinct, truth, strict=True)]
        if max(error, default=0.0) < TOLERANCE:
            break
    return nodes
