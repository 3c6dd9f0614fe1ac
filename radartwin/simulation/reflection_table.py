"""Tabulate the reflection and transmission coefficients of a scene's materials over the angle of incidence, for the ray tracer.

A table holds the coefficients at equally spaced cosines of incidence, between which the tracer interpolates linearly, and at a few
frequency nodes, which are the Chebyshev nodes of the radar's frequency sweep. Between the nodes, the synthesis uses the polynomial through
the node values. The numbers of cosines and nodes are the smallest that bring each of the two interpolation errors below TOLERANCE. A
half-space or a metal needs one node. A plasterboard of 12 mm needs several nodes, because its reflection changes by 4 dB within the
frequency sweep. A cavity of thickness D delays its echoes by multiples of 2 D cos t, where t is the angle of incidence, so that both
numbers grow with D. With the sweep of 3.44 GHz, a cavity between plasterboards of 12.5 mm needs these numbers:

| cavity | nodes | cosines |
|---|---|---|
| 75 mm | 16 | 3072 |
| 150 mm | 25 | 6144 |
| 300 mm | 52 | 12288 |

If the largest table is not enough, `build` warns. The coefficients are those of plane waves. Such coefficients neglect that a delayed echo
has a less curved wavefront than the echo of the outer face.

A path that crosses a sheet has the length of the straight line through the mesh, as if the sheet were not there. The transmission
coefficient of a sheet of thickness d therefore contains the factor exp(+j k d cos t), where k is the wavenumber and t the angle of
incidence: it is the field behind the sheet over the field that the wave would have there in air. The frequency nodes carry the delay that
the layers add. For the sheets of `materials.sheets`, the number of nodes that reflection needs is also enough for four crossings, with an
error below 3e-3. Only a door of 40 mm wood needs more nodes for transmission (3) than for reflection (1).
"""

import functools
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials import Layered, layered, reflection, transmission
from radartwin.materials.containers import EMPTY
from radartwin.store.digest import array_digest, spec_digest

# Largest error of a coefficient by interpolation between frequency nodes, and by interpolation between cosines. It is -50 dB relative to
# the incident field, smaller than all other errors of the tracer.
TOLERANCE = 3e-3
SILENT = 1e-3  # a surface whose transmission coefficients are all below this is opaque (-120 dB there and back)
# Numbers of frequency nodes and of cosines of incidence that `_size` tries, in this order.
_NODES = (1, 3, 5, 8, 12, 16, 20, 25, 30, 36, 43, 52, 64, 76)
_COSINES = (1024, 1536, 2048, 3072, 4096, 6144, 8192, 12288, 16384)
TABLES_IN_MEMORY = 8  # a furnished room of 20 surfaces needs a table of about 60 MB
_GRAZING = 0.06  # cosine of incidence of 86.6 degrees; closer to grazing incidence, the errors are not limited


class DispersionWarning(UserWarning):
    """Warn that the reflection of a surface changes faster over frequency or angle than a table can hold."""


@dataclass(frozen=True)
class ReflectionTable:
    """Hold reflection and transmission coefficients of S surfaces at Q frequencies."""

    te: np.ndarray  # (S, C, Q) complex TE reflection coefficients at C equally spaced cosines of incidence from 0 to 1
    tm: np.ndarray  # (S, C, Q) complex TM reflection coefficients, with the same axes as `te`
    through_te: np.ndarray  # (S, C, Q) complex TE transmission coefficients; zero for opaque surfaces
    through_tm: np.ndarray  # (S, C, Q) complex TM transmission coefficients; zero for opaque surfaces
    frequencies_hz: np.ndarray  # (Q,) frequency nodes in Hz
    # (material, rms roughness in metres) of each of the S surfaces, by which `curved.shell` recognises hollow objects
    surfaces: tuple[tuple[str | Layered, float], ...]

    @functools.cached_property
    def opaque(self) -> np.ndarray:
        """Return the mask (S,) of the surfaces that transmit nothing."""
        return np.array([not (te.any() or tm.any()) for te, tm in zip(self.through_te, self.through_tm, strict=True)], bool)

    @functools.cached_property
    def digest(self) -> str:
        """Return the digest of the coefficients and frequencies, for keys of stored paths."""
        arrays = self.te, self.tm, self.through_te, self.through_tm, self.frequencies_hz
        return spec_digest([array_digest(array) for array in arrays])


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


def grid_of_cosines(count: int) -> np.ndarray:
    """Return the cosines of incidence (count,) at which a reflection table has values."""
    cosines = np.linspace(0, 1, count)
    cosines[0] = 1e-6  # a small cosine replaces zero, because the TM reflection changes its sign at grazing incidence
    return cosines


def build(
    surfaces: Sequence[tuple[str | Layered, float]], low_hz: float, high_hz: float | None = None, names: Sequence[str] = ()
) -> ReflectionTable:
    """Tabulate the reflection and transmission coefficients of surfaces over the frequency sweep from `low_hz` to `high_hz`.

    A cache holds the most recently used tables. Calls with equal surfaces and frequencies return the same table, whose arrays are therefore
    read-only.

    Args:
        surfaces: (material, rms roughness in metres) of each surface of a geometry.
        low_hz: lowest frequency of the sweep in Hz.
        high_hz: highest frequency of the sweep in Hz; None builds a table for the single frequency `low_hz`.
        names: names of the surfaces, which the warning uses; empty if the surfaces have no names.
    Raises:
        MaterialError: a material is unknown, or a material has no values at these frequencies.
    Warns:
        DispersionWarning: the interpolation error of a material exceeds TOLERANCE, because its layers are too thick.
    """
    table, errors = _tabulated(tuple(surfaces), low_hz, high_hz or low_hz)
    for entry, error in errors.items():
        if error >= TOLERANCE:
            where = f"surface {names[surfaces.index(entry)]!r}: " if names else ""
            warnings.warn(
                f"{where}the coefficients of {entry[0]} are wrong by up to {error:.2g} of the incident field, over the tolerance of "
                f"{TOLERANCE:g}, because its layers are too thick for the sweep; use thinner layers or a smaller bandwidth",
                DispersionWarning, stacklevel=2,
            )  # fmt: skip
    return table


@functools.lru_cache(maxsize=TABLES_IN_MEMORY)
def _tabulated(
    surfaces: tuple[tuple[str | Layered, float], ...], low_hz: float, high_hz: float
) -> tuple[ReflectionTable, dict[tuple[str | Layered, float], float]]:
    """Return the table of `build`, of the size that `_size` finds for each material, and the interpolation error of each material."""
    sizes = {entry: _size(entry, low_hz, high_hz) for entry in dict.fromkeys(surfaces)}
    nodes = chebyshev_nodes(low_hz, high_hz, max((nodes for nodes, _, _ in sizes.values()), default=1))
    cosines = grid_of_cosines(max((cosines for _, cosines, _ in sizes.values()), default=_COSINES[0]))
    table = np.empty((4, len(surfaces), len(cosines), len(nodes)), complex)
    for entry in sizes:
        table[:, [other == entry for other in surfaces]] = _evaluate(entry, cosines, nodes)[:, None]
    table.flags.writeable = nodes.flags.writeable = False
    te, tm, through_te, through_tm = table
    return ReflectionTable(te, tm, through_te, through_tm, nodes, surfaces), {entry: error for entry, (_, _, error) in sizes.items()}


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


@functools.lru_cache(maxsize=1024)
def _size(entry: tuple[str | Layered, float], low_hz: float, high_hz: float) -> tuple[int, int, float]:
    """Return the numbers of frequency nodes and of cosines of the smallest table of a material whose interpolation errors are below
    TOLERANCE, or else of the largest table, and the larger of the two errors.
    """
    nodes, in_frequency = _smallest(_NODES, lambda count: _frequency_error(entry, low_hz, high_hz, count))
    cosines, in_angle = _smallest(_COSINES, lambda count: _angle_error(entry, low_hz, high_hz, count))
    return nodes, cosines, max(in_frequency, in_angle)


def _smallest(counts: Sequence[int], error: Callable[[int], float]) -> tuple[int, float]:
    """Return the first count whose error is below TOLERANCE, or else the last count, with its error."""
    errors = {}
    for count in counts:
        errors[count] = error(count)
        if errors[count] < TOLERANCE:
            break
    return errors.popitem()


def _frequency_error(entry: tuple[str | Layered, float], low_hz: float, high_hz: float, count: int) -> float:
    """Return the largest error of interpolation between `count` frequency nodes, at 48 angles."""
    cosines = np.linspace(_GRAZING, 1, 48)
    fine, nodes = np.linspace(low_hz, high_hz, max(48, 4 * count)), chebyshev_nodes(low_hz, high_hz, count)
    if low_hz == high_hz:
        return 0.0
    return float(np.abs(_evaluate(entry, cosines, nodes) @ lagrange_basis(nodes, fine) - _evaluate(entry, cosines, fine)).max())


def _angle_error(entry: tuple[str | Layered, float], low_hz: float, high_hz: float, count: int) -> float:
    """Return the largest error of linear interpolation between `count` cosines, in the middle of each interval and at three frequencies."""
    half_steps = np.arange(2 * int(_GRAZING * count), 2 * count - 1)
    values = _evaluate(entry, half_steps / 2 / (count - 1), np.linspace(low_hz, high_hz, 3))
    ends, middles = values[:, ::2], values[:, 1::2]
    return float(np.abs((ends[:, :-1] + ends[:, 1:]) / 2 - middles).max())
