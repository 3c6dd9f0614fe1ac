"""Describe how the antennas of a real board deviate from the nominal pattern of radartwin.radar.antenna.

Envelope. The nominal pattern is zero behind the board and falls to zero in the plane of the board. The real power pattern has a floor,
which in front of the board is `side_lobe_db` relative to the peak. Behind the board, the floor in dB falls linearly with the cosine of the
angle from the board's normal, from `side_lobe_db` in the plane of the board to `back_lobe_db` straight behind it. The gain of an antenna is
the larger of the nominal pattern and the floor.

Ripple. Other antennas of the board and the edges of the board scatter a part of the field of an antenna. The antenna k therefore radiates
COPIES weaker copies of its wave from other points d_kj of the board. The pattern of antenna k is the envelope times

    F_k(u) = c_k (1 + sum_j a_kj exp(-j k0 d_kj . u)),   |a_kj|^2 = 10^(ripple_db/10)/COPIES,

with the direction u, the wavenumber k0 at the middle of the sweep, and the sign of a phase that grows with the length of a path. The number
of the board is the seed of the random points d_kj and of the random phases of a_kj. The points are NEAREST_M to FARTHEST_M from the
antenna, in any direction in the plane of the board. The constant c_k makes the mean power over all directions equal to that of the
envelope, and makes the mean phase of F_k zero. Both means are weighted with the power of the envelope. Constant gains and phases of the
channels are part of radartwin.radar.hardware. The factor F_k neglects the change of k0 d_kj over the sweep, which is at most 1.1 radians on
either side of the middle frequency. If radartwin.simulation.merging joins several paths, the joined path gets the factor of the mean
direction. The error is 0.008 of the signal for a bottle at 1.3 m, and 0.004 for a can.

Sources of the default values, all of which were chosen before the simulation was compared with any measurement:
- side_lobe_db: 77 GHz arrays of tapered patches have side lobes of -15 and -20 dB (W. Wang, X. Wang, Progress In Electromagnetics Research
  Letters 72 (2018) 23). The floor of -18 dB is between both. There is no measurement of these boards beyond 30 degrees of elevation and 60
  degrees of azimuth (TI E2E 821216, IWR6843ISK). The level in the plane of the board is an order-of-magnitude estimate. This level
  determines the echo of a floor straight below the radar. For comparison, the field at the shadow boundary of a half plane is half of the
  field in front of the half plane. Half of the nominal field is -18.6 dB relative to the peak at 85 degrees of azimuth, and -23.7 dB at 80
  degrees of elevation.
- back_lobe_db: -25 dB is an order-of-magnitude estimate. Patch arrays on printed boards have front-to-back ratios of 20 to 30 dB. For
  comparison, consider a source on a half plane, whose edge diffracts the wave straight backwards. The diffracted field is 26 dB below the
  field along the surface for a source 2 cm from the edge, and 20 dB below the field along the surface for a source 5 mm from the edge
  (Keller's coefficient at grazing incidence).
- ripple_db: -20 dB is an order-of-magnitude estimate from the same diffraction coefficients. This level gives ripples with a standard
  deviation of 0.6 dB and 4 degrees. For comparison, a TI E2E thread (1525632) suggests 0.5 dB and 5 degrees as errors of the channels of a
  calibrated AWR2243, and reports that angles measured with calibrated boards have errors of 2 to 3 degrees.
- NEAREST_M, FARTHEST_M: NEAREST_M is about one wavelength, and FARTHEST_M is the distance to the edges of a board's antenna area. Both are
  order-of-magnitude estimates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.compiled import compiled, fixed, shared_out
from radartwin.radar.antenna import element_gain
from radartwin.radar.field_checks import is_number, is_whole, require

COPIES = 3  # number of displaced copies of the wave of an antenna
NEAREST_M, FARTHEST_M = 0.005, 0.03  # smallest and largest displacement of a copy
_DIRECTIONS = 50_000  # number of directions for the mean power; between neighbours, the phase of a copy changes by at most 0.8 rad


@dataclass(frozen=True)
class AntennaErrors:
    """Describe the deviations of the antennas of a board from their nominal pattern.

    Attributes:
        side_lobe_db: lowest power gain in front of the board relative to the peak, in dB.
        back_lobe_db: power gain straight behind the board relative to the peak, in dB.
        ripple_db: power of all displaced copies of the wave of an antenna relative to the wave itself, in dB.
        board: number of the board, which is the seed of the copies.

    >>> float(np.round(20 * np.log10(AntennaErrors().gain("iwr1843", [-1.0, 0.0, 0.0])), 2))
    -14.5
    """

    side_lobe_db: float = -18.0
    back_lobe_db: float = -25.0
    ripple_db: float = -20.0
    board: int = 0

    def __post_init__(self) -> None:
        for name in ("side_lobe_db", "back_lobe_db", "ripple_db"):
            require(self, "antenna_errors", name, lambda value: is_number(value) and value <= 0, "a finite number of at most 0")
        require(self, "antenna_errors", "board", lambda value: is_whole(value) and value >= 0, "a whole number of at least 0")

    def scaled(self, strength: float) -> AntennaErrors | None:
        """Multiply the amplitudes of floor and copies by `strength`. The strength 0 gives None, which stands for nominal antennas."""
        if strength <= 0:
            return None
        decibels = float(20 * np.log10(strength))
        levels = ("side_lobe_db", "back_lobe_db", "ripple_db")
        return replace(self, **{name: min(getattr(self, name) + decibels, 0.0) for name in levels})

    def gain(self, element: str, directions: ArrayLike) -> NDArray[np.float64]:
        """Compute the amplitude gain (...,) of the envelope; arguments as in `radartwin.radar.antenna.element_gain`."""
        out = element_gain(element, directions)
        flat = fixed(np.asarray(directions, dtype=np.float64).reshape(-1, 3))
        peak = float(element_gain(element, [1.0, 0.0, 0.0]))
        gains = out.reshape(-1)
        shared_out(_raise, len(flat), flat, peak, self.side_lobe_db / 20, self.back_lobe_db / 20, gains, grain=10_000)
        return gains.reshape(out.shape)

    def ripples(self, element: str, antennas: int, wavelength_m: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return the points d_kj (K, COPIES, 3) in metres, and the weights c_k and c_k a_kj (K, 1 + COPIES), of K antennas."""
        return _ripples(self, element, antennas, wavelength_m)


@compiled
def _raise(first, last, directions, peak, side, back, gains):
    """Raise the gains (N,) of the directions `first` to `last` - 1 of `directions` (N, 3) to the floor."""
    front = peak * 10**side
    for i in range(first, last):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        floor = front if x >= 0 else peak * 10 ** (side - (back - side) * x / np.sqrt(x * x + y * y + z * z))
        gains[i] = max(gains[i], floor)


@lru_cache(maxsize=8)
def _ripples(errors: AntennaErrors, element: str, antennas: int, wavelength_m: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Compute the result of `AntennaErrors.ripples`. Antennas with the same number have the same copies in any array."""
    points, weights = np.zeros((antennas, COPIES, 3)), np.ones((antennas, 1 + COPIES), np.complex128)
    for k in range(antennas):
        rng = np.random.default_rng(np.random.SeedSequence([errors.board, *b"antenna", k]))
        distance, angle, phase = rng.uniform(NEAREST_M, FARTHEST_M, COPIES), *rng.uniform(0, 2 * np.pi, (2, COPIES))
        points[k, :, 1:] = (distance * np.stack([np.cos(angle), np.sin(angle)])).T
        weights[k, 1:] = 10 ** (errors.ripple_db / 20) / np.sqrt(COPIES) * np.exp(1j * phase)
    height = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS * 2 - 1
    azimuth = np.arange(_DIRECTIONS) * np.pi * (3 - np.sqrt(5))  # the golden angle spreads the directions evenly over the sphere
    across = np.sqrt(1 - height**2)
    directions = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], axis=1)
    power = errors.gain(element, directions) ** 2
    power /= power.sum()
    for k in range(antennas):
        factor = weights[k, 0] + np.exp(-2j * np.pi / wavelength_m * directions @ points[k].T) @ weights[k, 1:]
        mean = power @ factor
        weights[k] *= np.conj(mean) / np.abs(mean) / np.sqrt(power @ np.abs(factor) ** 2)
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights
