"""Compute the gain of the receiver's intermediate-frequency (IF) chain over the beat frequency of an echo.

The IF chain has first-order high-pass stages, which attenuate the leakage between the antennas. The IF chain also has the low-pass filter
of the decimation, which keeps echoes beyond the unambiguous range from folding back. The band of beat frequencies ends at the sample rate,
or at half the sample rate for real samples. Higher beat frequencies fold into this band, so the stop band of the low-pass filter begins at
the upper edge of the band. The gain falls between `pass_share` times the edge frequency and the edge frequency.

Sources: the first high-pass stage has a corner frequency of 175, 235, 350 or 700 kHz, and the second stage 350, 700, 1400 or 2800 kHz.
These values are those of the fields hpfCornerFreq1 and hpfCornerFreq2 of rlProfileCfg_t in TI's mmWaveLink, and comments in public mmWave
Studio scripts repeat them. The AWR2944P data sheet (SWRS330) describes both stages together as a second-order high-pass filter with a
corner at -6 dB. Two equal first-order stages have such a corner. TI states that nine tenths of the band are usable (SWRA553, from memory).
In two public captures, the noise falls over the last tenth of the band, by 8 to 10 dB in the middle of this tenth. The depth of the stop
band and the shape of the transition are assumptions of this module.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.radar.field_checks import is_number, require


@dataclass(frozen=True)
class IfFilter:
    """Describe the IF filter of a radar.

    Attributes:
        high_pass_hz: corner frequencies of the first-order high-pass stages in Hz. The lowest corners of the IWR1843's two stages are
            (175e3, 350e3).
        pass_share: fraction of the band of beat frequencies that the low-pass filter does not attenuate.
        stop_db: attenuation of the low-pass filter at the upper edge of the band and beyond it, in dB.
        zero_phase: True for high-pass stages without phase shift, as in a calibrated radar. With False, each stage advances the phase of an
            echo at the beat frequency f by atan(corner/f).

    >>> bool(abs(IfFilter().gain(5.6e6, 5.21e6)) < 0.0011)
    True
    """

    high_pass_hz: tuple[float, ...] = (175e3,)
    pass_share: float = 0.9
    stop_db: float = 60.0
    zero_phase: bool = True

    def __post_init__(self) -> None:
        for name, accepts, expected in (
            ("high_pass_hz", lambda v: isinstance(v, tuple | list) and all(is_number(c) and c > 0 for c in v), "frequencies above zero"),
            ("pass_share", lambda v: is_number(v) and 0 < v < 1, "between 0 and 1"),
            ("stop_db", lambda v: is_number(v) and v >= 0, "a finite number of at least 0"),
            ("zero_phase", lambda v: isinstance(v, bool), "true or false"),
        ):
            require(self, "if_filter", name, accepts, expected)
        object.__setattr__(self, "high_pass_hz", tuple(float(c) for c in self.high_pass_hz))

    def gain(self, beat_hz: ArrayLike, band_hz: float) -> NDArray[np.complex128]:
        """Compute the complex gain of the IF filter for echoes, from their beat frequency before folding.

        Args:
            beat_hz: beat frequencies (...,) in Hz, which are chirp slope times echo delay.
            band_hz: width of the sampled band in Hz: the sample rate, or half the sample rate for real samples.
        """
        beat_hz = np.asarray(beat_hz, dtype=np.float64)
        high = np.ones(beat_hz.shape, np.complex128)
        for corner in self.high_pass_hz:
            high *= beat_hz / (beat_hz - 1j * corner)
        if self.zero_phase:
            high = np.abs(high).astype(np.complex128)
        transition = np.clip((np.abs(beat_hz) / band_hz - self.pass_share) / (1 - self.pass_share), 0, 1)
        return high * 10 ** (-self.stop_db / 20 * np.sin(np.pi / 2 * transition) ** 2)
