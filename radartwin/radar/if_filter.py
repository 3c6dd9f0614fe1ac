"""Compute the gain of the receiver's intermediate-frequency (IF) chain over the beat frequency of an echo.

The chain has first-order high-pass stages, which attenuate the leakage between the antennas, and the low-pass of the decimation, which
keeps echoes beyond the unambiguous range from folding back. The band ends at the sample rate (at half of it for real samples). Higher beat
frequencies fold into the band, so the stop band begins at the band edge. The gain falls from `pass_share` times the edge to the edge.

Sources: The stages have corner frequencies of 175, 235, 350 or 700 kHz and 350, 700, 1400 or 2800 kHz, as numbered in rlProfileCfg_t
(hpfCornerFreq1 and hpfCornerFreq2) of TI's mmWaveLink; comments of public mmWave Studio scripts repeat these values. The AWR2944P data
sheet (SWRS330) calls both stages together a second-order high-pass filter and names -6 dB corners, which two equal first-order stages
have. TI states that nine tenths of the band are usable (SWRA553, from memory); in two public captures the noise falls over the last tenth
of the band, by 8 to 10 dB at its middle. The depth of the stop band and the shape of the transition are assumptions.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.radar.field_checks import is_number


@dataclass(frozen=True)
class IfFilter:
    """Describe the IF filter of a radar.

    Attributes:
        high_pass_hz: corner frequency of each first-order high-pass stage; (175e3, 350e3) are the lowest corners of the chip's two stages.
        pass_share: fraction of the band that the low-pass does not attenuate.
        stop_db: attenuation at and beyond the edge of the band.
        zero_phase: whether the high-pass has no phase, as in a calibrated radar. Otherwise each stage advances the phase of an echo at the
            beat frequency f by atan(corner/f).

    >>> bool(abs(IfFilter().gain(5.6e6, 5.21e6)) < 0.0011)
    True
    """

    high_pass_hz: tuple[float, ...] = (175e3,)
    pass_share: float = 0.9
    stop_db: float = 60.0
    zero_phase: bool = True

    def __post_init__(self) -> None:
        corners = self.high_pass_hz
        if not isinstance(corners, tuple | list) or not all(is_number(c) and c > 0 for c in corners):
            raise InputError(f"if_filter: high_pass_hz must be frequencies above zero, not {corners!r}")
        object.__setattr__(self, "high_pass_hz", tuple(float(c) for c in corners))
        if not (is_number(self.pass_share) and 0 < self.pass_share < 1):
            raise InputError(f"if_filter: pass_share must be between 0 and 1, not {self.pass_share!r}")
        if not (is_number(self.stop_db) and self.stop_db >= 0):
            raise InputError(f"if_filter: stop_db must be a finite number of at least 0, not {self.stop_db!r}")
        if not isinstance(self.zero_phase, bool):
            raise InputError(f"if_filter: zero_phase must be true or false, not {self.zero_phase!r}")

    def gain(self, beat_hz: ArrayLike, band_hz: float) -> NDArray[np.complex128]:
        """Compute the complex gain of echoes at their beat frequency before folding.

        Args:
            beat_hz: slope times delay, shape (...,).
            band_hz: width of the sampled band: the sample rate, or half of it for real samples.
        """
        beat_hz = np.asarray(beat_hz, dtype=np.float64)
        high = np.ones(beat_hz.shape, np.complex128)
        for corner in self.high_pass_hz:
            high *= beat_hz / (beat_hz - 1j * corner)
        if self.zero_phase:
            high = np.abs(high).astype(np.complex128)
        transition = np.clip((np.abs(beat_hz) / band_hz - self.pass_share) / (1 - self.pass_share), 0, 1)
        return high * 10 ** (-self.stop_db / 20 * np.sin(np.pi / 2 * transition) ** 2)

    def to_dict(self) -> dict[str, Any]:
        return asdict(self) | {"high_pass_hz": list(self.high_pass_hz)}
