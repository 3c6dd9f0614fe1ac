"""Tabulate the reflection coefficients of a scene's materials over the angle of incidence, for the ray tracer.

A table holds the coefficients at a few frequency nodes, which are the Chebyshev nodes of the radar's frequency sweep. Between the nodes,
the synthesis uses the polynomial through the node values. The number of nodes is the smallest that brings the interpolation error below
TOLERANCE. A half-space or a metal needs one node. A plasterboard of 12 mm needs several nodes, because its reflection changes by 4 dB
within the frequency sweep.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.materials import Layered, reflection

COSINES = 1024  # number of cosines of incidence in a table
# Largest error of a reflection coefficient by interpolation between frequency nodes. It is -50 dB relative to the incident field, smaller
# than all other errors of the tracer.
TOLERANCE = 3e-3
_NODE_COUNTS = (1, 3, 5, 8, 12)  # numbers of frequency nodes that `_nodes` tries, in this order


@dataclass(frozen=True)
class ReflectionTable:
    """Hold reflection coefficients of S surfaces at Q frequencies."""

    te: np.ndarray  # (S, COSINES, Q) complex TE reflection coefficients at COSINES equally spaced cosines of incidence from 0 to 1
    tm: np.ndarray  # (S, COSINES, Q) complex TM reflection coefficients, with the same axes as `te`
    frequencies_hz: np.ndarray  # (Q,) frequency nodes in Hz
    # (material, rms roughness in metres) of each of the S surfaces, by which `curved.shell` recognises hollow objects
    surfaces: tuple[tuple[str | Layered, float], ...] = ()

    def envelope(self) -> "ReflectionTable":
        """Return a table with a single frequency node that holds the largest magnitude of each coefficient over the frequency sweep.

        The tracer uses this table to find the tubes whose contribution is not negligible.
        """
        te, tm = (np.abs(c).max(axis=2, keepdims=True).astype(complex) for c in (self.te, self.tm))
        return ReflectionTable(-te, tm, self.frequencies_hz.mean(keepdims=True))


def chebyshev_nodes(low_hz: float, high_hz: float, count: int) -> np.ndarray:
    """Return the Chebyshev nodes (count,) of the frequency interval from `low_hz` to `high_hz`, in ascending order.

    If `count` is 1, the node is the middle of the interval.
    """
    angle = (2 * np.arange(count)[::-1] + 1) * np.pi / (2 * count)
    return (low_hz + high_hz) / 2 + (high_hz - low_hz) / 2 * np.cos(angle)


def lagrange_basis(nodes_hz: np.ndarray, frequency_hz: np.ndarray) -> np.ndarray:
    """Return the values (Q, N) of the Q Lagrange polynomials of the frequency nodes `nodes_hz` at the N frequencies `frequency_hz`.

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
    """Return the cosines of incidence (COSINES,) at which a reflection table has values."""
    cosines = np.linspace(0, 1, COSINES)
    cosines[0] = 1e-6  # a small cosine replaces zero, because the TM reflection changes its sign at grazing incidence
    return cosines


def build(surfaces: Sequence[tuple[str | Layered, float]], low_hz: float, high_hz: float | None = None) -> ReflectionTable:
    """Tabulate the reflection coefficients of surfaces over the frequency sweep from `low_hz` to `high_hz`.

    Args:
        surfaces: (material, rms roughness in metres) of each surface of a geometry.
        low_hz: lowest frequency of the sweep in Hz.
        high_hz: highest frequency of the sweep in Hz; None builds a table for the single frequency `low_hz`.
    Raises:
        MaterialError: a material is unknown, or a material has no values at these frequencies.
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
    """Return the smallest set of frequency nodes whose interpolation error is below TOLERANCE for every material at sixteen angles."""
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
