"""Compute the signal of a turning target by interpolation between aspects. An aspect is the signal of the target at rest at one turntable
angle.

The field of a target that extends to a distance R from the turntable axis has angular harmonics up to 2 k R, where k is the wavenumber. A
whole revolution therefore needs 4 k R aspects, for example 600 aspects for R = 9 cm at 77 GHz. A windowed sinc function interpolates
between aspects. For a point target at R = 9 cm, the interpolation error is 0.01 of the signal. The module interpolates each chirp
separately, so that fast and uneven rotations use the same aspects. The largest remaining error occurs at angles where a face becomes
visible, because physical optics makes the field jump there. The table gives measured errors of the interpolated signal, relative to the
root mean square of the signal over a revolution. Reach is the largest distance of the target's surface from the axis.

| target | number of aspects per revolution | error |
|---|---|---|
| 0.09 m reach, free space | 1024 | 0.02 to 0.07 (0.1 to 0.14 of the signal at weak aspects) |
| bottle, 0.04 m reach, lab | 512 | 0.01 |
| bottle, 0.05 m reach, lab | 512 | 0.005 |
| mug, 0.075 m reach, lab | 512 | 0.07 |
| body of revolution 6 mm off the turntable's axis | 64 | 0.005 |
| body of revolution 8 mm off the turntable's axis | 64 | 0.09 |
| can as made (radartwin/testbed/object_shape.py), free space, at most 3 mm off the axis | 192 | 0.013 |
| the same | 256 | 0.006 |
| can as drawn with a roughness of 0.1 mm, lab | 64 | 0.14 |
| the same | 256 | 0.002 |

The signal of a smooth body of revolution on the turntable varies only because its axis is offset from the axis of the turntable. The
diffuse echo of a rough surface turns with the body.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene.scene import Surface

ASPECTS = 1024  # default number of aspects per revolution
# Smallest number of aspects per revolution of a target that is no body of revolution, because mesh facets cause up to 128 ripples of the
# signal per revolution.
MIN_ASPECTS = 512
NEARLY_ROUND = 256  # smallest number of aspects of a body of revolution with dents and a seam, or with a rough surface
# Numbers of aspects per revolution for the shadow that a target casts on the paths of the room, for a body of revolution and for any other
# target. The shadow changes slowly, because a wave that passes the edge of the outline is hardly deflected. The error relative to the part
# of the signal that changes with the angle is 0.002 for a can as made at 64 aspects. At 128 aspects, it is 0.004 for a bottle and a corner
# reflector, and 0.013 for a mug.
SHADOW_ROUND, SHADOW_ASPECTS = 64, 128
TAPS = 8  # number of aspects from which one chirp is interpolated
HIGHEST_HZ = 79e9  # frequency in Hz for which `needed` computes the number of aspects
_OVERSAMPLING = 1.6  # number of aspects divided by the number that the sampling theorem requires; sets the interpolation window
_BATCH = 64  # number of aspects that the simulator traces together


@dataclass(frozen=True, eq=False)
class Aspects:
    """Store one simulated chirp for each of A aspects of a turning target. Aspect a is the turntable angle 2 pi a/(A symmetry)."""

    signals: np.ndarray  # (A, T, R, N) complex64 samples in amplitude units: A aspects, T transmitters, R receivers, N samples per chirp
    symmetry: int = 1  # order of the target's rotational symmetry about the turntable axis; 1 for a target without symmetry

    @staticmethod
    def traced(chirp: Callable[[np.ndarray], np.ndarray], count: int = ASPECTS, symmetry: int = 1) -> "Aspects":
        """Trace the aspects of a target.

        Args:
            chirp: function that returns the samples (F, T, R, N) of one chirp at each of the turntable angles (F,) in radians.
            count: number of aspects; 1 for a body of revolution on the axis.
            symmetry: order of the target's rotational symmetry about the turntable axis.
        """
        angles = 2 * np.pi / symmetry * np.arange(count) / count
        parts = [chirp(angles[first : first + _BATCH]) for first in range(0, count, _BATCH)]
        return Aspects(np.concatenate(parts).astype(np.complex64), symmetry)

    def refined(self, count: int) -> "Aspects":
        """Return the band-limited interpolation to `count` aspects, which are at least as many as the traced ones."""
        traced = len(self.signals)
        spectrum = np.fft.fft(self.signals, axis=0)
        more = np.zeros((count, *spectrum.shape[1:]), np.complex64)
        positive = (traced + 1) // 2
        more[:positive], more[count - traced // 2 :] = spectrum[:positive], spectrum[positive:]
        return Aspects((np.fft.ifft(more, axis=0) * (count / traced)).astype(np.complex64), self.symmetry)

    def at(self, angles: np.ndarray) -> np.ndarray:
        """Interpolate the signal between the aspects, at the angle of each chirp of F frames with C chirp loops and T transmitters.

        Args:
            angles: (F, C, T) turntable angle at each chirp of each transmitter, in radians.
        Returns:
            Samples (F, C, T, R, N), complex64.
        """
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


def needed(surfaces: Sequence[Surface], beyond_m: float = 0.0, round_about_axis: bool = False, dented: bool = False) -> int:
    """Return the number of aspects that a whole revolution of the surfaces about the z axis needs, a multiple of _BATCH.

    Args:
        surfaces: surfaces of the target in the turntable's frame.
        beyond_m: largest offset of the target from the turntable axis in metres, in addition to the position of its surfaces.
        round_about_axis: whether the target is a body of revolution. If it is smooth, its signal varies only because of its offset from
            the axis.
        dented: whether a body of revolution has small deviations of its shape.
    """
    reach = beyond_m
    if not round_about_axis:
        reach += max(float(np.hypot(*s.mesh.vertices[:, :2].T).max(initial=0.0)) for s in surfaces)
    batches = int(np.ceil(_OVERSAMPLING * 8 * np.pi * reach * HIGHEST_HZ / SPEED_OF_LIGHT / _BATCH))
    uneven = dented or any(s.roughness_m > 0 for s in surfaces)
    least = (NEARLY_ROUND if uneven else _BATCH) if round_about_axis else MIN_ASPECTS
    return max(least, batches * _BATCH)


def _window(fraction: np.ndarray) -> np.ndarray:
    """Return the interpolation weights (..., TAPS) of the TAPS aspects nearest to an angle; the weights sum to 1.

    Args:
        fraction: (...) position of the angle between two neighbouring aspects, from 0 to 1.
    """
    distance = fraction[..., None] - np.arange(1 - TAPS // 2, 1 + TAPS // 2)
    beta = np.pi * TAPS * (1 - 1 / _OVERSAMPLING) / 2
    inside = np.sqrt(np.clip(1 - (2 * distance / TAPS) ** 2, 0, None))
    weights = np.sinc(distance) * np.i0(beta * inside)
    return (weights / weights.sum(axis=-1, keepdims=True)).astype(np.float32)


@compiled
def _combine(low, high, signals, first, weights, out):
    """Write the weighted sums of aspects for the frames `low` to `high` - 1 to `out`."""
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
