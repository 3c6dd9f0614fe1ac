"""Signal of a turning target, interpolated between aspects. Each aspect is one angle, traced once with the target at rest.

The field of a target that extends to a distance R from the axis has angular harmonics up to 2 k R, where k is the wavenumber. A whole
revolution therefore needs 4 k R aspects, for example 600 for R = 9 cm at 77 GHz. A windowed sinc interpolates between aspects (error: 0.01
of the signal of a point target at this R). Each chirp is interpolated separately, so that fast and uneven rotations use the same aspects.
The largest remaining error occurs where a face becomes visible, because physical optics makes the field jump there. The table gives
measured errors of the signal, relative to its root mean square over a revolution. Reach is the largest distance from the axis.

| target | aspects | error |
|---|---|---|
| 0.09 m reach, free space | 1024 | 0.02 to 0.07 (0.1 to 0.14 of the signal at weak aspects) |
| bottle, 0.04 m reach, lab | 512 | 0.01 |
| bottle, 0.05 m reach, lab | 512 | 0.005 |
| mug, 0.075 m reach, lab | 512 | 0.07 |
| body of revolution 6 mm off the turntable's axis | 64 | 0.005 |
| body of revolution 8 mm off the turntable's axis | 64 | 0.09 |

The signal of a body of revolution varies only because its axis is offset from the axis of the turntable.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene.scene import Surface

ASPECTS = 1024  # default number of aspects per revolution
MIN_ASPECTS = 512  # per revolution of a target that is no body of revolution, because facets cause up to 128 ripples per revolution
TAPS = 8
HIGHEST_HZ = 79e9
_OVERSAMPLING = 1.6  # of the aspects; it sets the width of the interpolation window
_BATCH = 64  # number of aspects traced together


@dataclass(frozen=True, eq=False)
class Aspects:
    """Store one chirp per aspect of a target. Aspect a is the angle 2 pi a/(A symmetry)."""

    signals: np.ndarray  # (A, T, R, N) complex64 in amplitude units: A aspects, T transmitters, R receivers, N samples
    symmetry: int = 1  # order of the rotational symmetry about the axis, 1 for none

    @staticmethod
    def traced(chirp: Callable[[np.ndarray], np.ndarray], count: int = ASPECTS, symmetry: int = 1) -> "Aspects":
        """Trace `count` aspects (1 for a body of revolution). `chirp` returns signals (F, T, R, N) at angles (F,) in radians."""
        angles = 2 * np.pi / symmetry * np.arange(count) / count
        parts = [chirp(angles[first : first + _BATCH]) for first in range(0, count, _BATCH)]
        return Aspects(np.concatenate(parts).astype(np.complex64), symmetry)

    def at(self, angles: np.ndarray) -> np.ndarray:
        """Return the chirps (F, C, T, R, N) complex64, interpolated at the angles (F, C, T) in radians of F frames with C chirps."""
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


def needed(surfaces: Sequence[Surface], beyond_m: float = 0.0, round_about_axis: bool = False) -> int:
    """Return the number of aspects that a whole revolution of the surfaces about z needs, a multiple of the batch size.

    Args:
        beyond_m: largest additional offset of the target from the axis.
        round_about_axis: whether the target is a body of revolution, whose signal varies only because of its offset.
    """
    reach = beyond_m
    if not round_about_axis:
        reach += max(float(np.hypot(*s.mesh.vertices[:, :2].T).max(initial=0.0)) for s in surfaces)
    batches = int(np.ceil(_OVERSAMPLING * 8 * np.pi * reach * HIGHEST_HZ / SPEED_OF_LIGHT / _BATCH))
    return max(_BATCH if round_about_axis else MIN_ASPECTS, batches * _BATCH)


def _window(fraction: np.ndarray) -> np.ndarray:
    """Return weights (..., TAPS) with sum 1 of the aspects around an angle, from TAPS/2 - 1 aspects before it to TAPS/2 after it."""
    distance = fraction[..., None] - np.arange(1 - TAPS // 2, 1 + TAPS // 2)
    beta = np.pi * TAPS * (1 - 1 / _OVERSAMPLING) / 2
    inside = np.sqrt(np.clip(1 - (2 * distance / TAPS) ** 2, 0, None))
    weights = np.sinc(distance) * np.i0(beta * inside)
    return (weights / weights.sum(axis=-1, keepdims=True)).astype(np.float32)


@compiled
def _combine(low, high, signals, first, weights, out):
    """Write the weighted sums of aspects for frames `low` to `high` to `out`."""
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
