"""Simulate the phase noise of the local oscillator, and the phase error that remains after mixing with a delayed copy.

The receiver mixes an echo of delay tau with the oscillator that transmitted it. The phase error is phi(t) - phi(t - tau), whose spectral
density is S(f) 4 sin^2(pi f tau) with the one-sided S(f) = 2 L(f) (M. Budge, M. Burt, Range correlation effects in radars, IEEE National
Radar Conference 1993). The error grows with range, and all antennas share it.

Level at 1 MHz: -95 dBc/Hz from 76 to 77 GHz and -93 dBc/Hz from 77 to 81 GHz, IWR1843 data sheet (TI SWRS228B, RF specification), from
memory. The successor's data sheet (AWR2944P, TI SWRS330) has -96 and -95 dBc/Hz. The sheets give no other offset, so a plateau up to the
corner of the loop and 1/f^2 beyond it are assumptions.

`processes` is for the synthesis of samples from paths. It separates delay and frequency by exp(-j 2 pi f tau) =
exp(-j w) sum_k (2 - [k=0]) (-j)^k J_k(w) T_k(u), with w = pi f tau_max and tau = tau_max (1 + u)/2 (J_k: Bessel functions, T_k: Chebyshev
polynomials), so that a few random processes cover all echoes. `at_delays` and `interpolation` are for existing samples: they compute the
phase error at a few delays and interpolate between these delays.
"""

from __future__ import annotations

import functools
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.radar.field_checks import is_number

_TAIL = 1e-6  # neglected fraction of the oscillator's noise power, far below the phase error of the nearest echo
_LONGER = 4  # period of the simulated noise in sweep durations; over 1, so that both ends of a sweep are independent


@dataclass(frozen=True)
class PhaseNoise:
    """Describe the phase noise of an oscillator.

    Attributes:
        level_dbc_hz: single-sideband level at 1 MHz from the carrier, dBc/Hz.
        corner_hz: corner frequency of the control loop; the level is constant at lower frequency offsets.

    >>> round(float(10 * np.log10(PhaseNoise(-93.0).density(1e6) / 2)), 6)
    -93.0
    """

    level_dbc_hz: float = -93.0
    corner_hz: float = 300e3

    def __post_init__(self) -> None:
        for name in ("level_dbc_hz", "corner_hz"):
            if not is_number(value := getattr(self, name)):
                raise InputError(f"phase_noise: {name} must be a finite number, not {value!r}")
        if self.corner_hz <= 0:
            raise InputError(f"phase_noise: corner_hz must be above zero, not {self.corner_hz!r}")

    def density(self, offset_hz: Any) -> Any:
        """Compute the one-sided spectral density of the phase in rad^2/Hz, at offsets from the carrier in Hz."""
        shape = (1 + (1e6 / self.corner_hz) ** 2) / (1 + (np.asarray(offset_hz) / self.corner_hz) ** 2)
        return 2 * 10 ** (self.level_dbc_hz / 10) * shape

    def processes(
        self, chirps: int, samples: int, sample_rate_hz: float, longest_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw random processes psi_k. An echo of delay tau has the phase error sum_k psi_k T_k(2 tau/longest_s - 1).

        Args:
            chirps, samples: number of chirps and of samples per chirp. The noise of different chirps is independent. Its frequencies
                range from a quarter of a cycle per sweep to half the sample rate.
        Returns:
            psi, (terms, chirps, samples), radians.
        """
        from scipy.special import jv

        size = _LONGER * samples
        offset = np.arange(1, size // 2 + 1) * sample_rate_hz / size
        spacing = sample_rate_hz / size
        # Each component has the variance S df: x = Re sum_l c_l exp(j 2 pi l n/size), E|c_l|^2 = 2 S df.
        draw = rng.standard_normal((2, chirps, len(offset)))
        component = np.sqrt(self.density(offset) * spacing) * (draw[0] + 1j * draw[1])
        w = np.pi * offset * longest_s
        out = np.empty((chebyshev_terms(np.pi * sample_rate_hz / 2 * longest_s, _TAIL), chirps, samples))
        for k in range(len(out)):
            weight = -np.exp(-1j * w) * (1 if k == 0 else 2) * (-1j) ** k * jv(k, w)
            spectrum = np.zeros((chirps, size), complex)
            spectrum[:, 1 : len(offset) + 1] = component * (weight + 1 if k == 0 else weight)
            out[k] = np.fft.ifft(spectrum, norm="forward").real[:, :samples]
        return out

    def at_delays(
        self, chirps: int, samples: int, sample_rate_hz: float, delays_s: tuple[float, ...], rng: np.random.Generator
    ) -> NDArray[np.float32]:
        """Draw the phase errors of echoes at K delays.

        Args:
            chirps, samples: as in `processes`.
        Returns:
            phase errors, (K, chirps, samples), radians.
        """
        from scipy import fft

        size = _LONGER * samples
        lines = _lines(self, size, sample_rate_hz, delays_s)
        draw = rng.standard_normal((2, chirps, size // 2), np.float32)
        spectrum = np.zeros((len(delays_s), chirps, size // 2 + 1), np.complex64)
        np.multiply(lines[:, None], draw[0] + np.complex64(1j) * draw[1], out=spectrum[:, :, 1:])
        spectrum[:, :, 1:-1] *= 0.5  # irfft adds the conjugate of these lines
        return np.asarray(fft.irfft(spectrum, size, norm="forward", overwrite_x=True))[:, :, :samples]

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def chebyshev_terms(largest: float, tail: float) -> int:
    """Return the number of Chebyshev terms that exp(j w x) needs for |w| up to `largest`, with Bessel functions up to `tail` neglected."""
    from scipy.special import jv

    count = int(largest) + 1
    while abs(jv(count, largest)) > tail:
        count += 1
    return count


def interpolation(delays_s: Any, nodes_s: tuple[float, ...]) -> NDArray[np.float64]:
    """Compute weights (K, ...) that interpolate the phase errors at K delays (`nodes_s`) to other delays (`delays_s`).

    The interpolation is the polynomial through the nodes that is zero at zero delay.

    >>> interpolation([0.5, 1.0, 2.0], (1.0, 2.0)).tolist()
    [[0.75, 1.0, -0.0], [-0.125, 0.0, 1.0]]
    """
    delays = np.asarray(delays_s, np.float64)
    out = [delays / node for node in nodes_s]
    for k, node in enumerate(nodes_s):
        for other in nodes_s:
            if other != node:
                out[k] = out[k] * (delays - other) / (node - other)
    return np.stack(out)


@functools.lru_cache(maxsize=8)
def _lines(noise: PhaseNoise, size: int, sample_rate_hz: float, delays_s: tuple[float, ...]) -> NDArray[np.complex64]:
    """Compute the amplitude of each of L spectral lines of the phase error at each of K delays, (K, L)."""
    offset = np.arange(1, size // 2 + 1) * sample_rate_hz / size
    amplitude = np.sqrt(noise.density(offset) * sample_rate_hz / size)
    return (amplitude * (1 - np.exp(-2j * np.pi * np.outer(delays_s, offset)))).astype(np.complex64)
