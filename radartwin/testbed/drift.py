"""Simulate the slow drift of small objects in the room during a recording. Each object moves along its own horizontal direction.

At 77 GHz, a shift of 0.1 mm towards the radar changes the phase of an echo by a third of a radian. Objects that should be at rest therefore
change the background signal between two revolutions of a turntable. All shifts are proportional to one random process, the room's
temperature. The value of this process, in standard deviations, is called the temperature state. The room is simulated at the middle
temperature state, at both extreme states, and at enough states between them that an object moves at most 0.2 mm between neighbouring
states. A polynomial in the temperature state is fitted to the simulated signals of the room. This polynomial gives the room's signal at
every frame. For a path straight back to the radar, whose phase is 4 pi s / lambda for a shift s, the error of the polynomial is less than
0.02 of the path's amplitude (tested). An object's shift across the line of sight changes the echo's phase less than a shift along it.

The default size of the drift is an order-of-magnitude estimate. A plastic object of half a metre expands by 0.05 mm per degree. Wood and
cardboard of this length expand by a few tenths of a millimetre if the relative humidity rises by ten per cent. Furniture boards settle and
cables sway by similar lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radartwin.scene.scene import Surface
from radartwin.scene.trajectories.trajectory import pose
from radartwin.testbed.motion_errors import wander

REACH = 2.0  # largest absolute temperature state, in standard deviations; the random process is reflected at this value
STEP_M = 0.2e-3  # largest shift of an object between two neighbouring simulated temperature states, in metres
_BATCH = 64  # number of frames that are processed at once


@dataclass(frozen=True)
class DriftErrors:
    """Size and speed of the slow drift of objects in the room.

    Attributes:
        creep_m: standard deviation over time of each object's shift, in metres.
        settling_s: correlation time of the room's temperature, in seconds.
    """

    creep_m: float = 0.1e-3
    settling_s: float = 100.0

    def scaled(self, strength: float) -> DriftErrors:
        return replace(self, creep_m=strength * self.creep_m)


@dataclass(frozen=True, eq=False)
class Drift:
    """The signal that the drift of objects adds to a recording of the room with all objects at rest.

    Attributes:
        states: (S, T, R, N) complex64, the room's signal at S evenly spaced temperature states; S is odd.
        course: (F,) temperature state at each frame, in standard deviations, between -REACH and REACH.
    """

    states: NDArray[np.complex64]
    course: NDArray[np.float64]

    def at(self, frames: slice = slice(None)) -> NDArray[np.complex64]:
        """Return, for the given frames, the room's signal with drift minus its signal at rest, (F, T, R, N)."""
        at = self.course[frames]
        nodes = np.linspace(-REACH, REACH, len(self.states))
        weights = np.ones((len(at), len(nodes)))
        for k, node in enumerate(nodes):
            for other in np.delete(nodes, k):
                weights[:, k] *= (at - other) / (node - other)
        weights[:, len(nodes) // 2] -= 1
        return np.tensordot(weights.astype(np.float32), self.states, axes=1).astype(np.complex64)

    def add_to(self, iq: NDArray[np.complex64]) -> None:
        """Add the signal of the drift to all chirps of the array iq (F, C, T, R, N), which is changed in place."""
        for first in range(0, len(iq), _BATCH):
            block = slice(first, first + _BATCH)
            iq[block] += self.at(block)[:, None]


def nodes(errors: DriftErrors) -> NDArray[np.float64]:
    """Return the temperature states (S,) in standard deviations at which the room is simulated."""
    half = max(1, int(np.ceil(REACH * errors.creep_m / STEP_M - 1e-9)))
    return np.linspace(-REACH, REACH, 2 * half + 1)


def traced(signal: Callable[[float], NDArray], errors: DriftErrors) -> NDArray[np.complex64]:
    """Compute `Drift.states` (S, T, R, N). `signal` maps a temperature state (standard deviations) to the room's signal (T, R, N)."""
    return np.stack([signal(state) for state in nodes(errors)]).astype(np.complex64)


def shift(name: str, state: float, errors: DriftErrors, seed: int) -> NDArray[np.float64]:
    """Return the pose (4, 4) by which the surface `name` is moved in a temperature state; the other arguments are those of `shifted`."""
    angle = 2 * np.pi * np.random.default_rng(np.random.SeedSequence([seed, *b"drift", *name.encode()])).random()
    return pose(state * errors.creep_m * np.array([np.cos(angle), np.sin(angle), 0.0]))


def shifted(surfaces: Iterable[Surface], names: Collection[str], state: float, errors: DriftErrors, seed: int) -> list[Surface]:
    """Return the surfaces, with each surface in `names` shifted along its own direction as the temperature state requires.

    Args:
        state: temperature state, in standard deviations.
        seed: seed of the room, which determines the directions; all recordings of one room have the same directions.
    """
    out = []
    for surface in surfaces:
        if surface.name in names and state:
            surface = surface.moved(shift(surface.name, state, errors, seed))
        out.append(surface)
    return out


def course(times_s: NDArray[np.float64], errors: DriftErrors, seed: int) -> NDArray[np.float64]:
    """Draw the temperature state (F,) at each frame of one recording, in standard deviations: a stationary process reflected at +-REACH."""
    out = wander(times_s, errors.settling_s, np.random.default_rng(np.random.SeedSequence([seed, *b"drift of a recording"])))
    return REACH - np.abs((out + REACH) % (4 * REACH) - 2 * REACH)  # reflects the process at both ends, without jumps or clipping
