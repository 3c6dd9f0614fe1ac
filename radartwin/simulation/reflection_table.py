"""Tabulate the reflection and transmission coefficients of a scene's materials over the angle of incidence, for the ray tracer.

A table holds the coefficients at a few frequency nodes, which are the Chebyshev nodes of the radar's frequency sweep. Between the nodes,
the synthesis uses the polynomial through the node values. The number of nodes is the smallest that brings the interpolation error below
TOLERANCE. A half-space or a metal needs one node. A plasterboard of 12 mm needs several nodes, because its reflection changes by 4 dB
within the frequency sweep.

A path that crosses a sheet has the length of the straight line through the mesh, as if the sheet were not there. The transmission
coefficient of a sheet of thickness d therefore contains the factor exp(+j k d cos t), where k is the wavenumber and t the angle of
incidence: it is the field behind the sheet over the field that the wave would have there in air. The frequency nodes carry the delay that
the layers add. For the sheets of `materials.sheets`, the nodes that reflection needs also carry four crossings with an error below 3e-3.
Only a door of 40 mm wood needs more nodes for transmission (3) than for reflection (1).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials import Layered, layered, reflection, transmission
from radartwin.materials.containers import EMPTY

COSINES = 1024  # number of cosines of incidence in a table
# Largest error of a coefficient by interpolation between frequency nodes. It is -50 dB relative to the incident field, smaller
# than all other errors of the tracer.
TOLERANCE = 3e-3
SILENT = 1e-3  # a surface whose transmission coefficients are all below this is opaque (-120 dB there and back)
_NODE_COUNTS = (1, 3, 5, 8, 12)  # numbers of frequency nodes that `_nodes` tries, in this order


@dataclass(frozen=True)
class ReflectionTable:
    """Hold reflection and transmission coefficients of S surfaces at Q frequencies."""

    te: np.ndarray  # (S, COSINES, Q) complex TE reflection coefficients at COSINES equally spaced cosines of incidence from 0 to 1
    tm: np.ndarray  # (S, COSINES, Q) complex TM reflection coefficients, with the same axes as `te`
    through_te: np.ndarray  # (S, COSINES, Q) complex TE transmission coefficients; zero for opaque surfaces
    through_tm: np.ndarray  # (S, COSINES, Q) complex TM transmission coefficients; zero for opaque surfaces
    frequencies_hz: np.ndarray  # (Q,) frequency nodes in Hz
    # (material, rms roughness in metres) of each of the S surfaces, by which `curved.shell` recognises hollow objects
    surfaces: tuple[tuple[str | Layered, float], ...]

    @property
    def opaque(self) -> np.ndarray:
        """Return the mask (S,) of the surfaces that transmit nothing."""
        return ~np.any([self.through_te, self.through_tm], axis=(0, 2, 3))

    def envelope(self) -> "ReflectionTable":
        """Return a table with a single frequency node that holds the largest magnitude of each coefficient over the frequency sweep.

        The tracer uses this table to find the tubes whose contribution is not negligible.
        """
        largest = (np.abs(c).max(axis=2, keepdims=True).astype(complex) for c in (self.te, self.tm, self.through_te, self.through_tm))
        te, tm, through_te, through_tm = largest
        middle = self.frequencies_hz.mean(keepdims=True)
        return replace(self, te=-te, tm=tm, through_te=through_te, through_tm=through_tm, frequencies_hz=middle)


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
    """Tabulate the reflection and transmission coefficients of surfaces over the frequency sweep from `low_hz` to `high_hz`.

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
    shape = len(surfaces), 4, COSINES, len(nodes)
    te, tm, through_te, through_tm = np.swapaxes(np.array([values[entry] for entry in surfaces]).reshape(shape), 0, 1)
    return ReflectionTable(te, tm, through_te, through_tm, nodes, tuple(surfaces))


def _evaluate(entry: tuple[str | Layered, float], cosines: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return the TE and TM reflection and the TE and TM transmission coefficients (4, C, N) at C cosines and N frequencies."""
    material, roughness_m = entry
    stack = layered(material)
    reflected = reflection(stack, cosines[:, None], nodes, roughness_m)
    passed = np.zeros((2, len(cosines), len(nodes)), complex)
    if stack.layers and stack.backing in EMPTY:
        delay_m = sum(thickness for _, thickness in stack.layers) * cosines[:, None]
        shift = np.exp(2j * np.pi / SPEED_OF_LIGHT * nodes * delay_m)
        passed = np.stack(transmission(stack, cosines[:, None], nodes, roughness_m)) * shift
        if np.abs(passed).max() < SILENT:
            passed[:] = 0
    return np.stack([*reflected, *passed])


def _nodes(distinct: Sequence[tuple[str | Layered, float]], low_hz: float, high_hz: float) -> np.ndarray:
    """Return the smallest set of frequency nodes whose interpolation error is below TOLERANCE for every material at sixteen angles."""
    fine = np.linspace(low_hz, high_hz, 48)
    cosines = np.linspace(0.06, 1, 16)
    truth = [_evaluate(entry, cosines, fine) for entry in distinct]
    nodes = chebyshev_nodes(low_hz, high_hz, 1)
    for count in _NODE_COUNTS:
        nodes = chebyshev_nodes(low_hz, high_hz, count)
        basis = lagrange_basis(nodes, fine)
        error = [np.abs(_evaluate(e, cosines, nodes) @ basis - t).max() for e, t in zip(distinct, truth, strict=True)]
        if max(error, default=0.0) < TOLERANCE:
            break
    return nodes
