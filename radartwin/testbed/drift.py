"""Simulate the slow drift of small objects in the room during a recording. Each object moves along its own horizontal direction.

At 77 GHz, a shift of 0.1 mm changes the phase of an echo by a third of a radian. Objects that should be at rest therefore change the
background between the revolutions of a turntable. All shifts are proportional to one random process, the room's temperature, whose value
is called the state. The room is simulated at the middle state, at both extreme states and at enough states between them that an object
moves at most 0.2 mm between neighbouring states. A polynomial in the state through these signals gives the signal at every frame. For a
path straight back to the radar, whose phase is 4 pi s / lambda for a shift s, the polynomial's error is less than 0.02 of the path's
amplitude (tested). A shift across the line of sight changes the phase less.

The default size of the drift is an order of magnitude. A plastic object of half a metre expands by 0.05 mm per degree. Wood and cardboard
of this length expand by a few tenths of a millimetre if the relative humidity rises by ten per cent. Boards settle and cables sway by
similar lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radartwin.scene.scene import Surface
from radartwin.scene.trajectories.trajectory import pose

REACH = 2.0  # largest absolute state, standard deviations; the random process is reflected at this value
STEP_M = 0.2e-3  # largest shift of an object between neighbouring states
_BATCH = 64  # frames


@dataclass(frozen=True)
class DriftErrors:
    """Size and speed of the drift.

    Attributes:
        creep_m: standard deviation of each object's shift over time.
        settling_s: correlation time of the room's temperature.
    """

    creep_m: float = 0.1e-3
    settling_s: float = 100.0

    def scaled(self, strength: float) -> DriftErrors:
        return replace(self, creep_m=strength * self.creep_m)


@dataclass(frozen=True, eq=False)
class Drift:
    """The signal that drift adds to a recording of the room at rest.

    Attributes:
        states: (S, T, R, N) complex64, the room's signal at S evenly spaced states, S odd.
        course: (F,) state at each frame, standard deviations, within REACH.
    """

    states: NDArray[np.complex64]
    course: NDArray[np.float64]

    def at(self, frames: slice = slice(None)) -> NDArray[np.complex64]:
        """Return the room's signal at the frames minus its signal at rest, (F, T, R, N)."""
        at = self.course[frames]
        nodes = np.linspace(-REACH, REACH, len(self.states))
        weights = np.ones((len(at), len(nodes)))
        for k, node in enumerate(nodes):
            for other in np.delete(nodes, k):
                weights[:, k] *= (at - other) / (node - other)
        weights[:, len(nodes) // 2] -= 1
        return np.tensordot(weights.astype(np.float32), self.states, axes=1).astype(np.complex64)

    def add_to(self, iq: NDArray[np.complex64]) -> None:
        """Add the drift's signal to all chirps of iq (F, C, T, R, N), in place."""
        for first in range(0, len(iq), _BATCH):
            block = slice(first, first + _BATCH)
            iq[block] += self.at(block)[:, None]


def traced(signal: Callable[[float], NDArray], errors: DriftErrors) -> NDArray[np.complex64]:
    """Compute `Drift.states` (S, T, R, N). `signal` maps a state (standard deviations) to the room's signal (T, R, N)."""
    half = max(1, int(np.ceil(REACH * errors.creep_m / STEP_M - 1e-9)))
    return np.stack([signal(state) for state in np.linspace(-REACH, REACH, 2 * half + 1)]).astype(np.complex64)


def shifted(surfaces: Iterable[Surface], names: Collection[str], state: float, errors: DriftErrors, seed: int) -> list[Surface]:
    """Return the surfaces; those in `names` are shifted to `state` (standard deviations), each in its own direction.

    Args:
        seed: seed of the room. All recordings of one room share the directions.
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
    """Draw the state (F,) at each frame of one recording, standard deviations: a stationary random process, reflected at REACH."""
    draws = np.random.default_rng(np.random.SeedSequence([seed, *b"drift of a recording"])).standard_normal(len(times_s))
    memory = np.exp(-np.maximum(np.diff(times_s, prepend=times_s[:1]), 0.0) / errors.settling_s)
    out = draws.copy()
    for f in range(1, len(out)):
        out[f] = memory[f] * out[f - 1] + np.sqrt(1 - memory[f] ** 2) * draws[f]
    return REACH - np.abs((out + REACH) % (4 * REACH) - 2 * REACH)  # reflected at both ends, without jumps or clipping
