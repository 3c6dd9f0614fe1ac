"""Small things of a room creep while a recording is made: they warm up, take up moisture, hang in a draught.

A thing wanders along a level direction of its own, by a tenth of a millimetre or two in minutes: what stands still in the log turns its
echo's phase by a radian, and a turntable's later revolutions see another background than its first. Each thing is traced at a few shifts
along its way; in between a polynomial through these states gives its signal, at every frame. Between five states 0.2 mm apart the phase
of an echo straight back, 4 pi s / lambda at 77 GHz, is met to 0.005 of that echo (under test); a shift across the line of sight does less.

The size is an order of magnitude: paper and cardboard grow by a part in a thousand for 10 % of relative humidity, plastics by a ten
thousandth for a degree, 0.1 to 0.4 mm over half a metre in either case; a cable that hangs free sways as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radartwin.scene.trajectory import pose

STATES = 5  # traced of each thing, evenly over its reach
REACH = 2.0  # standard deviations: where a course turns back


@dataclass(frozen=True)
class DriftErrors:
    """Attributes:
    creep_m: standard deviation of a thing's shift; settling_s: in which it forgets where it was.
    """

    creep_m: float = 0.2e-3
    settling_s: float = 100.0

    def scaled(self, strength: float) -> DriftErrors:
        return replace(self, creep_m=strength * self.creep_m)

    @property
    def shifts_m(self) -> NDArray[np.float64]:
        """(STATES,) at which a thing is traced."""
        return np.linspace(-REACH, REACH, STATES) * self.creep_m


@dataclass(frozen=True, eq=False)
class Drift:
    """What drifting things add to a recording in which they rest.

    Attributes:
        states: (K, STATES, T, R, N) complex64, the signal of K things at their shifts.
        courses: (F, K) where each is at each frame, in standard deviations, within REACH.
    """

    states: NDArray[np.complex64]
    courses: NDArray[np.float64]

    def at(self, frames: slice = slice(None)) -> NDArray[np.complex64]:
        """(F, T, R, N): the change against all things at rest."""
        weights = state_weights(self.courses[frames])
        weights[..., STATES // 2] -= 1
        return np.tensordot(weights, self.states, ((1, 2), (0, 1))).astype(np.complex64)

    def add_to(self, iq: NDArray[np.complex64]) -> None:
        """To all chirps of every frame of (F, C, T, R, N), in place."""
        for first in range(0, len(iq), 64):
            block = slice(first, first + 64)
            iq[block] += self.at(block)[:, None]


def traced(signal: Callable[[int, NDArray[np.float64]], NDArray], count: int, errors: DriftErrors, seed: int) -> NDArray[np.complex64]:
    """States (K, STATES, T, R, N) of `count` things, each along a level direction that the seed of the place gives it.

    Args:
        signal: (k, poses) -> (STATES, T, R, N), of thing k moved by `poses` (STATES, 4, 4), in world coordinates.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, *b"drift of a place"]))
    ways = np.exp(2j * np.pi * rng.random(count))
    found = []
    for k, way in enumerate(ways):
        poses = np.stack([pose([way.real * shift, way.imag * shift, 0.0]) for shift in errors.shifts_m])
        found.append(signal(k, poses))
    return np.stack(found).astype(np.complex64)


def courses(count: int, times_s: NDArray[np.float64], errors: DriftErrors, seed: int) -> NDArray[np.float64]:
    """(F, K) of one recording, in standard deviations: stationary, forgotten within settling_s, turned back at REACH."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, *b"drift of a recording"]))
    draws = rng.standard_normal((len(times_s), count))
    kept = np.exp(-np.maximum(np.diff(times_s, prepend=times_s[:1]), 0.0) / errors.settling_s)[:, None]
    out = draws.copy()
    for f in range(1, len(out)):
        out[f] = kept[f] * out[f - 1] + np.sqrt(1 - kept[f] ** 2) * draws[f]
    return REACH - np.abs((out + REACH) % (4 * REACH) - 2 * REACH)  # folded at both ends: no jump, no clipping


def state_weights(course: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., STATES) of the polynomial through the states (Lagrange); they sum to one.

    >>> state_weights(np.array([0.0, 2.0])).round(12).tolist()
    [[0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0]]
    """
    nodes = np.linspace(-REACH, REACH, STATES)
    parts = []
    for k, node in enumerate(nodes):
        parts.append(np.prod([(course - other) / (node - other) for other in np.delete(nodes, k)], axis=0))
    return np.stack(parts, axis=-1)
