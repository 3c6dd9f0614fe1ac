"""Small things of a room creep while a recording is made: as the room warms up and cools, each moves along a level way of its own.

A tenth of a millimetre turns an echo's phase by a third of a radian, so what stands still in the log does not stand still in the
background of a turntable's later revolutions. All things follow one course, the room's temperature; the room is traced in the middle, at
both ends and at as many states between as leave them 0.2 mm apart, and a polynomial through them gives its signal at every frame: it meets
an echo straight back, whose phase goes as 4 pi s / lambda, to 0.02 of that echo (under test); a shift across the line of sight does less.

The size is an order of magnitude: over half a metre, a degree lengthens plastics by 0.05 mm, and ten per cent of relative humidity wood and
cardboard by a few tenths; a board settles, a cable sways as much.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radartwin.scene.scene import Surface
from radartwin.scene.trajectories.trajectory import pose

REACH = 2.0  # standard deviations: where a course turns back
STEP_M = 0.2e-3  # of each thing, from state to state
_TOGETHER = 64  # frames


@dataclass(frozen=True)
class DriftErrors:
    """Attributes:
    creep_m: standard deviation of each thing's shift; settling_s: in which the room forgets how warm it was.
    """

    creep_m: float = 0.1e-3
    settling_s: float = 100.0

    def scaled(self, strength: float) -> DriftErrors:
        return replace(self, creep_m=strength * self.creep_m)


@dataclass(frozen=True, eq=False)
class Drift:
    """What a drifting room adds to a recording in which it rests.

    Attributes:
        states: (S, T, R, N) complex64, its signal at S places evenly over the course, S odd.
        course: (F,) where it is at each frame, in standard deviations, within REACH.
    """

    states: NDArray[np.complex64]
    course: NDArray[np.float64]

    def at(self, frames: slice = slice(None)) -> NDArray[np.complex64]:
        """(F, T, R, N): the change against the room at rest."""
        at = self.course[frames]
        nodes = np.linspace(-REACH, REACH, len(self.states))
        weights = np.ones((len(at), len(nodes)))
        for k, node in enumerate(nodes):
            for other in np.delete(nodes, k):
                weights[:, k] *= (at - other) / (node - other)
        weights[:, len(nodes) // 2] -= 1
        return np.tensordot(weights.astype(np.float32), self.states, axes=1).astype(np.complex64)

    def add_to(self, iq: NDArray[np.complex64]) -> None:
        """To all chirps of every frame of (F, C, T, R, N), in place."""
        for first in range(0, len(iq), _TOGETHER):
            block = slice(first, first + _TOGETHER)
            iq[block] += self.at(block)[:, None]


def traced(signal: Callable[[float], NDArray], errors: DriftErrors) -> NDArray[np.complex64]:
    """(S, T, R, N) of `signal`, which gives (T, R, N) of the room at so many standard deviations."""
    half = max(1, int(np.ceil(REACH * errors.creep_m / STEP_M - 1e-9)))
    return np.stack([signal(state) for state in np.linspace(-REACH, REACH, 2 * half + 1)]).astype(np.complex64)


def shifted(surfaces: Iterable[Surface], names: Collection[str], state: float, errors: DriftErrors, seed: int) -> list[Surface]:
    """The surfaces with those of these names, each along its own way, so many standard deviations off.

    Args:
        seed: of the place; its recordings share the ways.
    """
    out = []
    for surface in surfaces:
        if surface.name in names and state:
            angle = 2 * np.pi * np.random.default_rng(np.random.SeedSequence([seed, *b"drift", *surface.name.encode()])).random()
            shift = state * errors.creep_m * np.array([np.cos(angle), np.sin(angle), 0.0])
            surface = surface.moved(pose(shift))
        out.append(surface)
    return out


def course(times_s: NDArray[np.float64], errors: DriftErrors, seed: int) -> NDArray[np.float64]:
    """(F,) of one recording, in standard deviations: stationary, forgotten within settling_s, turned back at REACH."""
    draws = np.random.default_rng(np.random.SeedSequence([seed, *b"drift of a recording"])).standard_normal(len(times_s))
    kept = np.exp(-np.maximum(np.diff(times_s, prepend=times_s[:1]), 0.0) / errors.settling_s)
    out = draws.copy()
    for f in range(1, len(out)):
        out[f] = kept[f] * out[f - 1] + np.sqrt(1 - kept[f] ** 2) * draws[f]
    return REACH - np.abs((out + REACH) % (4 * REACH) - 2 * REACH)  # folded at both ends: no jump, no clipping
