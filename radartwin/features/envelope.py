"""Compute the energy of the target's echo during a motion, and features of its mean level and of its modulation.

The energy E(f) of frame f is the linear power in the target gate (the range bins around the target) minus the noise power there. The
envelope of a turntable recording is an array (N,) with one value per angle. It is the mean of E over the whole revolutions at each angle.
The envelope of a sideways drive, in which the radar drives past the target at right angles to the line of sight, is E over the frames of
the drive, (F,). P_m = sum_n E_n exp(-j 2 pi m n / N), m >= 0, is the discrete Fourier transform of the envelope.

- The harmonics of the envelope are |P_m| / |P_0| for m = 1..6. The angular harmonic ratio is sum_{m=1..6} |P_m|^2 / |P_0|^2. The RadarTwin
  paper defines this ratio as the band of 1-6 cycles per rotation, normalised by DC, but does not state whether amplitudes or powers are
  summed. The ratio is 0 for a body of revolution and 6 for a target with a single short glint. The ratio does not depend on the signal
  level and the start angle. In the far field, the ratio does not depend on the distance either.
- The harmonics and the harmonic ratio of a sideways drive have the same formulas; m then counts cycles per drive.
- The crest factor is max(E) / rms(E), and the entropy is -sum p ln p / ln N with p = E / sum E. For a constant envelope, crest factor and
  entropy are 1. Crest factor and entropy depend on the number of frames in the envelope, so compare only envelopes of equal length.
- The brightness is 10 log10(mean_f E(f) R(f)^4), with the nominal distance R(f) in metres. A point target of radar cross-section s has
  E = G^2 lambda^2 s / ((4 pi)^3 R^4) with the antenna gain G, so its brightness depends only on s and on the radar. Brightness is an
  absolute level, so receiver gain and calibration change it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.features.profile import gate_energies

HARMONICS = 6  # number of harmonics in the RadarTwin paper; higher harmonics contain ripple from the facets of the mesh
Real = NDArray[np.floating]


def target_energy(processed: Processed, target_m: ArrayLike) -> Real:
    """Compute the target's energy E(f), (F,), which is the power in the target gate minus the noise power in the target gate.

    If the gate contains only noise, the mean of E is 0.

    Args:
        processed: processed recording of F frames.
        target_m: range of the centre of the target gate in metres, one value for all frames or one value per frame (F,).
    """
    target_m = np.asarray(target_m, dtype=np.float64)
    inside, _ = gate_energies(processed.power, processed.range_m, target_m)
    floor = np.broadcast_to(processed.noise_floor, (*target_m.shape, len(processed.range_m)))
    return inside - gate_energies(floor, processed.range_m, target_m)[0]


def without_range_law(energy: Real, distance_m: Real) -> Real:
    """Multiply the energy E(f) of each frame by the fourth power of the target's distance R(f) in metres, and return E(f) R(f)^4, (F,)."""
    return np.asarray(energy, dtype=np.float64) * np.asarray(distance_m, dtype=np.float64) ** 4


def brightness_db(energy: Real, distance_m: Real) -> float:
    """Compute the brightness of a target: its received over transmitted power in decibels if it were at one metre.

    Args:
        energy: (F,) energies from `target_energy`.
        distance_m: (F,) nominal distances of the target in metres.
    Raises:
        InputError: the mean energy above the noise is zero or negative.

    >>> round(brightness_db(np.full(4, 1e-8), np.full(4, 10.0)), 6)
    -40.0
    """
    mean = float(np.mean(without_range_law(energy, distance_m)))
    if not mean > 0:
        raise InputError("brightness: the target's mean energy is not above the noise; check the target's distance")
    return 10 * float(np.log10(mean))


def frames_per_revolution(angle_rad: Real) -> int:
    """Compute the number of frames per revolution from the nominal turntable angles (F,), which must advance at constant speed.

    Raises:
        InputError: a revolution has fewer than three frames, or the recording is shorter than one revolution.
    """
    period = _period(angle_rad)
    if not 3 <= period <= len(angle_rad):
        turned = np.rad2deg(np.abs(np.diff(angle_rad)).sum())
        raise InputError(f"{len(angle_rad)} frames over {turned:.0f} degrees are not a revolution; record a whole one")
    return period


def resolved(angle_rad: Real) -> bool:
    """Return whether turntable angles (F,) are at least one revolution, with enough frames for HARMONICS cycles."""
    return 2 * HARMONICS < _period(angle_rad) <= len(angle_rad)


def _period(angle_rad: Real) -> int:
    """Return the number of frames per revolution, or 0 if the turntable rests."""
    step = np.abs(np.diff(angle_rad))
    return round(2 * np.pi / float(np.median(step))) if len(step) and np.median(step) > 0 else 0


def revolution(energy: Real, angle_rad: Real) -> Real:
    """Average the energy over whole revolutions, and return the envelope (N,) at N equally spaced angles, interpolated between frames."""
    period = frames_per_revolution(angle_rad)
    turned = np.abs(angle_rad - angle_rad[0])
    if (np.diff(turned) <= 0).any():
        raise InputError("the turntable must turn in one direction; give the nominal angle without wrapping it at 360 degrees")
    # A revolution includes the step from its last frame to the first frame of the next revolution, hence + 1.
    count = int(np.floor((turned[-1] / (2 * np.pi) * period + 1) / period + 1e-6))
    angles = 2 * np.pi * np.arange(max(count, 1) * period) / period
    return np.interp(angles, turned, energy).reshape(-1, period).mean(axis=0)


def harmonics(envelope: Real, count: int = HARMONICS) -> Real:
    """Compute the harmonics |P_m| / |P_0| of an envelope for m = 1..count, (count,).

    Raises:
        InputError: the envelope is too short for `count` cycles, or its mean is not above zero.

    >>> np.round(harmonics(1 + np.cos(2 * np.pi * 3 * np.arange(64) / 64)), 6).tolist()
    [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]
    """
    if len(envelope) <= 2 * count:
        raise InputError(f"{len(envelope)} frames do not resolve {count} cycles; give more than {2 * count} frames")
    spectrum = np.fft.rfft(_checked(envelope))
    return np.abs(spectrum[1 : count + 1]) / np.abs(spectrum[0])


def harmonic_ratio(envelope: Real, low: int = 1, high: int = HARMONICS) -> float:
    """Compute the angular harmonic ratio of an envelope: the sum over m = low..high of |P_m|^2 / |P_0|^2."""
    return float(np.sum(harmonics(envelope, high)[low - 1 :] ** 2))


def crest_factor(envelope: Real) -> float:
    """Compute the crest factor max(E) / rms(E) of an envelope.

    >>> crest_factor(np.ones(10))
    1.0
    """
    envelope = _checked(envelope)
    return float(envelope.max() / np.sqrt(np.mean(envelope**2)))


def entropy(envelope: Real) -> float:
    """Compute the entropy -sum p ln p / ln N of an envelope, with p = E / sum E; negative energies count as zero.

    >>> round(entropy(np.ones(10)), 9), entropy(np.eye(1, 10)[0])
    (1.0, 0.0)
    """
    share = np.maximum(_checked(envelope), 0.0)
    share = share[share > 0] / share.sum()
    return float(abs(np.sum(share * np.log(share))) / np.log(len(envelope)))


def _checked(envelope: Real) -> Real:
    envelope = np.asarray(envelope, dtype=np.float64)
    if envelope.ndim != 1 or len(envelope) < 2 or not np.isfinite(envelope).all() or not envelope.sum() > 0:
        raise InputError("the envelope must be finite energies with a mean above the noise; check the target's distance")
    return envelope / envelope.mean()
