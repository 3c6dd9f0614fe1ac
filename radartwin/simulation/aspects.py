"""A turning target from aspects traced once, with the target at rest in each.

A target that reaches R from its axis varies with the angle like harmonics up to 2 k R, so a whole turn is known from 4 k R aspects: 600
of a target that reaches 9 cm at 77 GHz. Between them a windowed sinc interpolates (0.01 of a point at that reach), each chirp by itself,
so that any turn, however fast or uneven, comes from the same aspects. What is left is physical optics' own step where a face comes into
view: measured in free space with 1024 aspects, 0.02 to 0.07 of the turn's root mean square, a tenth to a seventh of a single weak aspect.
Bottles that reach 4 and 5 cm are off by 0.01 and 0.005 with 512, a mug of 7.5 cm by 0.07 (in the lab, against aspects between them).
A target that is round about its own axis varies as far as it stands off the table's: 64 aspects hold 6 mm of that to 0.005, 8 mm to 0.09.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene.scene import Surface

ASPECTS = 1024  # of a whole turn
LEAST = 512  # of what is not round: faceted things ripple up to 128 times in a turn
TAPS = 8
_OVERSAMPLING = 1.6  # that the window's width is made for
_TOGETHER = 64  # traced in one go


@dataclass(frozen=True, eq=False)
class Aspects:
    """Attributes:
    signals: (A, T, R, N) complex64, one chirp at angles 2 pi a/(A symmetry), amplitude units.
    symmetry: of the target about its axis: it looks the same after 1/symmetry of a turn.
    """

    signals: np.ndarray
    symmetry: int = 1

    @staticmethod
    def traced(chirp: Callable[[np.ndarray], np.ndarray], count: int = ASPECTS, symmetry: int = 1) -> "Aspects":
        """Trace aspects; `chirp` gives (F, T, R, N) of angles (F,) in radians. A body of revolution has count 1."""
        angles = 2 * np.pi / symmetry * np.arange(count) / count
        parts = [chirp(angles[first : first + _TOGETHER]) for first in range(0, count, _TOGETHER)]
        return Aspects(np.concatenate(parts).astype(np.complex64), symmetry)

    def at(self, angles: np.ndarray) -> np.ndarray:
        """complex64 (F, C, T, R, N) at angles (F, C, T) of every chirp, radians."""
        count, _, receivers, samples = self.signals.shape
        place = np.asarray(angles, float) * (self.symmetry * count / (2 * np.pi))
        out = np.empty((*place.shape, receivers, samples), np.complex64)
        if count == 1:
            out[:] = self.signals[0]
            return out
        first = np.floor(place).astype(np.int64)
        weights = _window(place - first)
        shared_out(_combine, len(place), self.signals, first % count, weights, out)
        return out


def needed(surfaces: Sequence[Surface], beyond_m: float = 0.0, round_about_axis: bool = False, frequency_hz: float = 79e9) -> int:
    """Aspects of a whole turn about z, as the window wants them, in whole batches.

    Args:
        surfaces: in the frame of the turntable.
        beyond_m: by which they may stand off the axis.
        round_about_axis: what is round about its own axis varies only by standing off the table's.
        frequency_hz: the highest.
    """
    reach = beyond_m
    if not round_about_axis:
        reach += max(float(np.hypot(*s.mesh.vertices[:, :2].T).max(initial=0.0)) for s in surfaces)
    batches = int(np.ceil(_OVERSAMPLING * 8 * np.pi * reach * frequency_hz / SPEED_OF_LIGHT / _TOGETHER))
    return max(_TOGETHER if round_about_axis else LEAST, batches * _TOGETHER)


def _window(fraction: np.ndarray) -> np.ndarray:
    """(..., TAPS) weights of the aspects from TAPS/2 - 1 before a place to TAPS/2 after; their sum is one: what does not turn rests."""
    distance = fraction[..., None] - np.arange(1 - TAPS // 2, 1 + TAPS // 2)
    beta = np.pi * TAPS * (1 - 1 / _OVERSAMPLING) / 2
    inside = np.sqrt(np.clip(1 - (2 * distance / TAPS) ** 2, 0, None))
    weights = np.sinc(distance) * np.i0(beta * inside)
    return (weights / weights.sum(axis=-1, keepdims=True)).astype(np.float32)


@compiled
def _combine(low, high, signals, first, weights, out):
    """Weighted sums of aspects for frames low..high."""
    count = len(signals)
    for f in range(low, high):
        for c in range(out.shape[1]):
            for t in range(out.shape[2]):
                out[f, c, t] = 0
                for k in range(weights.shape[3]):
                    aspect = (first[f, c, t] + k + 1 - weights.shape[3] // 2) % count
                    w = weights[f, c, t, k]
                    for r in range(out.shape[3]):
                        for n in range(out.shape[4]):
                            out[f, c, t, r, n] += w * signals[aspect, t, r, n]
