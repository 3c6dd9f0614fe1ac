"""Compute the signal of a turning target by interpolation between aspects. An aspect is the signal of the target at rest at one turntable
angle.

The field of a target that extends to a distance R from the turntable axis has angular harmonics up to about 2 k R, where k is the
wavenumber. The aspects are equally spaced over a revolution, so that the Fourier series of 4 k R of them, for example 600 for R = 9 cm at
77 GHz, gives the signal at any angle: it is first evaluated at FINER times as many angles, between which a windowed sinc function
interpolates. The module interpolates each chirp separately, so that fast and uneven rotations use the same aspects. The largest remaining
error occurs at angles where a face becomes visible, because physical optics makes the field jump there. The table gives the error relative
to the root mean square of the signal over a revolution, of objects as made (radartwin/testbed/object_shape.py) on the turntable in the
laboratory, against 640 (bottle), 896 (mug), 256 (can) or 384 (rough can) aspects. Reach is the largest distance of the target's
surface from the axis.

| target | number of aspects: error of the direct echo | of the echo over the room |
|---|---|---|
| mug, 0.079 m reach | 576: 0.011; 448: 0.046; 320: 0.09 | 576: 0.0020; 320: 0.008 |
| bottle, 0.060 m reach | 448: 0.0021; 320: 0.0029; 192: 0.006; 128: 0.6 | 448: 0.0007; 256: 0.0013; 128: 0.036 |
| can (body of revolution with dents and a seam) | 192: 0.0026; 128: 0.007; 64: 0.038 | 128: 0.0011; 64: 0.0023 (worst of four cans) |
| the same with a roughness of 0.1 mm | 192: 0.0035; 128: 0.017; 64: 0.072 | |

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
MIN_ASPECTS = 320
NEARLY_ROUND = 192  # smallest number of aspects of a body of revolution with dents and a seam, or with a rough surface
# Numbers of aspects per revolution for the shadow that a target casts on the paths of the room, for a body of revolution and for any other
# target. The shadow changes slowly, because a wave that passes the edge of the outline is hardly deflected. The error relative to the part
# of the signal that changes with the angle is 0.002 for a can as made at 64 aspects. At 128 aspects, it is 0.004 for a bottle and a corner
# reflector, and 0.013 for a mug.
SHADOW_ROUND, SHADOW_ASPECTS = 64, 128
TAPS = 8  # number of aspects from which one chirp is interpolated
HIGHEST_HZ = 79e9  # frequency in Hz for which `needed` computes the number of aspects
FINER = 2  # number of angles between which the window interpolates, divided by the number of aspects
BATCH = 64  # number of aspects, or of frames of a turning target, that are traced together; limits memory


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
        parts = [chirp(angles[first : first + BATCH]) for first in range(0, count, BATCH)]
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
        """Interpolate the signal at the angle of each chirp of F frames with C chirp loops and T transmitters.

        Args:
            angles: (F, C, T) turntable angle at each chirp of each transmitter, in radians.
        Returns:
            Samples (F, C, T, R, N), complex64.
        """
        traced, _, receivers, samples = self.signals.shape
        out = np.empty((*np.shape(angles), receivers, samples), np.complex64)
        if traced == 1:
            out[:] = self.signals[0]
            return out
        count = FINER * traced
        place = np.asarray(angles, float) * (self.symmetry * count / (2 * np.pi))
        first = np.floor(place).astype(np.int64)
        weights = _window(place - first)
        shared_out(_combine, len(place), self.refined(count).signals, first % count, weights, out)
        return out


def needed(surfaces: Sequence[Surface], beyond_m: float = 0.0, round_about_axis: bool = False, dented: bool = False) -> int:
    """Return the number of aspects that a whole revolution of the surfaces about the z axis needs, a multiple of BATCH.

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
    phase = 4 * np.pi * reach * HIGHEST_HZ / SPEED_OF_LIGHT
    harmonics = phase + 3 * np.cbrt(phase)  # the Bessel function of this order is 0.001 at `phase`
    uneven = dented or any(s.roughness_m > 0 for s in surfaces)
    least = (NEARLY_ROUND if uneven else BATCH) if round_about_axis else MIN_ASPECTS
    return max(least, int(np.ceil(2 * harmonics / BATCH)) * BATCH)


def over_room(count: int) -> int:
    """Return the number of aspects of the echo over the room, whose errors count less, if the direct echo has `count` aspects."""
    return BATCH if count <= NEARLY_ROUND else -(-count // (2 * BATCH)) * BATCH


def _window(fraction: np.ndarray) -> np.ndarray:
    """Return the interpolation weights (..., TAPS) of the TAPS aspects nearest to an angle; the weights sum to 1.

    Args:
        fraction: (...) position of the angle between two neighbouring aspects, from 0 to 1.
    """
    distance = fraction[..., None] - np.arange(1 - TAPS // 2, 1 + TAPS // 2)
    beta = np.pi * TAPS * (1 - 1 / FINER) / 2
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
