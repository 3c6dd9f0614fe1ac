"""Simulate the phase noise of the local oscillator, and the phase error that remains after mixing with a delayed copy.

The receiver mixes an echo of delay tau with the same oscillator that transmitted the signal. The echo therefore has the phase error
phi(t) - phi(t - tau), where phi is the phase noise of the oscillator. The spectral density of this phase error is S(f) 4 sin^2(pi f tau),
with the one-sided phase noise density S(f) = 2 L(f) (M. Budge, M. Burt, Range correlation effects in radars, IEEE National Radar Conference
1993). The phase error grows with the range of the echo, and it is equal at all receive antennas.

The IWR1843 data sheet (TI SWRS228B, RF specification) gives a phase noise level at 1 MHz offset of -95 dBc/Hz from 76 to 77 GHz and
-93 dBc/Hz from 77 to 81 GHz; these levels are quoted from memory. The data sheet of the successor AWR2944P (TI SWRS330) gives -96 and
-95 dBc/Hz. Neither data sheet gives the level at another offset. It is an assumption of this module that the level is constant up to the
corner frequency of the control loop and falls with 1/f^2 beyond it.

The method `processes` serves the synthesis of samples from propagation paths. This method separates delay and frequency by
exp(-j 2 pi f tau) = exp(-j w) sum_k (2 - [k=0]) (-j)^k J_k(w) T_k(u), with w = pi f tau_max, tau = tau_max (1 + u)/2, the Bessel functions
J_k and the Chebyshev polynomials T_k. A few random processes are therefore enough for the echoes of all delays. The method `at_delays`
computes the phase error at a few delays, and the function `interpolation` interpolates between these delays. The method `at_delays` and the
function `interpolation` serve to add phase noise to existing samples.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.radar.field_checks import is_number, require

_TAIL = 1e-6  # Bessel functions below this limit are neglected; the resulting error is far below the phase error of the nearest echo
# Period of the simulated noise divided by the duration of a frequency sweep. A ratio above 1 makes both ends of a sweep independent.
_LONGER = 4


@dataclass(frozen=True)
class PhaseNoise:
    """Describe the phase noise of an oscillator.

    Attributes:
        level_dbc_hz: single-sideband phase noise level at an offset of 1 MHz from the carrier, in dBc/Hz.
        corner_hz: corner frequency of the oscillator's control loop in Hz; the phase noise level is constant at lower frequency offsets.

    >>> round(float(10 * np.log10(PhaseNoise(-93.0).density(1e6) / 2)), 6)
    -93.0
    """

    level_dbc_hz: float = -93.0
    corner_hz: float = 300e3

    def __post_init__(self) -> None:
        require(self, "phase_noise", "level_dbc_hz", is_number, "a finite number")
        require(self, "phase_noise", "corner_hz", lambda value: is_number(value) and value > 0, "a finite number above zero")

    def density(self, offset_hz: Any) -> Any:
        """Compute the one-sided spectral density of the oscillator's phase in rad^2/Hz, at frequency offsets from the carrier in Hz."""
        shape = (1 + (1e6 / self.corner_hz) ** 2) / (1 + (np.asarray(offset_hz) / self.corner_hz) ** 2)
        return 2 * 10 ** (self.level_dbc_hz / 10) * shape

    def processes(
        self, chirps: int, samples: int, sample_rate_hz: float, longest_s: float, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Draw random processes psi_k, from which an echo of delay tau gets the phase error sum_k psi_k T_k(2 tau/longest_s - 1).

        The noise of different chirps is independent. The frequencies of the noise range from a quarter of a cycle per chirp to half the
        sample rate.

        Args:
            longest_s: longest delay of an echo in seconds.
        Returns:
            Random processes psi (terms, chirps, samples) in radians.
        """
        from scipy.special import jv

        size = _LONGER * samples
        offset = np.arange(1, size // 2 + 1) * sample_rate_hz / size
        spacing = sample_rate_hz / size
        # The phase is Re sum_l c_l exp(j 2 pi l n/size) at sample n. Each spectral component contributes the variance S df, so that
        # E|c_l|^2 = 2 S df.
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
            chirps: number of chirps; the noise of different chirps is independent.
        Returns:
            Phase errors (K, chirps, samples) in radians.
        """
        from scipy import fft

        size = _LONGER * samples
        lines = _lines(self, size, sample_rate_hz, delays_s)
        draw = rng.standard_normal((2, chirps, size // 2), np.float32)
        spectrum = np.zeros((len(delays_s), chirps, size // 2 + 1), np.complex64)
        np.multiply(lines[:, None], draw[0] + np.complex64(1j) * draw[1], out=spectrum[:, :, 1:])
        spectrum[:, :, 1:-1] *= 0.5  # irfft adds the complex conjugate of these spectral lines, which doubles their contribution
        return np.asarray(fft.irfft(spectrum, size, norm="forward", overwrite_x=True))[:, :, :samples]


def chebyshev_terms(largest: float, tail: float) -> int:
    """Return the number of Chebyshev terms that represent exp(j w x) for |w| up to `largest`, without Bessel functions below `tail`."""
    from scipy.special import jv

    count = int(largest) + 1
    while abs(jv(count, largest)) > tail:
        count += 1
    return count


def interpolation(delays_s: Any, nodes_s: tuple[float, ...]) -> NDArray[np.float64]:
    """Compute weights (K, ...) that interpolate the phase errors at the K delays `nodes_s` to the delays `delays_s` (...).

    The interpolation uses the polynomial that passes through the phase errors at these K delays and is zero at zero delay.

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
    """Compute the amplitudes (K, L) of the L spectral lines of the phase error at K delays, in radians."""
    offset = np.arange(1, size // 2 + 1) * sample_rate_hz / size
    amplitude = np.sqrt(noise.density(offset) * sample_rate_hz / size)
    return (amplitude * (1 - np.exp(-2j * np.pi * np.outer(delays_s, offset)))).astype(np.complex64)
