"""What the receiver's intermediate-frequency chain does to an echo of a given beat frequency.

A chain of first-order high-pass stages, which hold back the leakage between the antennas, and the low-pass of the decimation, which
keeps echoes beyond the unambiguous range from folding back. A beat frequency at or above the sample rate (half of it for real samples)
folds into the band, so the stop band begins there; what lies between `pass_share` of that edge and the edge is the transition.

Corner frequencies of the two stages, 175, 235, 350, 700 kHz and 350, 700, 1400, 2800 kHz, as numbered in rlProfileCfg_t (hpfCornerFreq1
and hpfCornerFreq2) of TI's mmWaveLink, as the comments of public mmWave Studio scripts repeat them. Both stages together are the "second
order high pass filter" of the AWR2944P's data sheet (SWRS330), which names -6 dB corners as two equal first-order stages have. That nine
tenths of the band are usable is how TI describes the family (SWRA553), from memory; the noise of two public captures falls off over the
last tenth, by 8 to 10 dB at its middle. The depth of the stop band and the shape of the transition are assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError


@dataclass(frozen=True)
class IfFilter:
    """Attributes:
    high_pass_hz: corner of each first-order stage; (175e3, 350e3) are both stages of the chip at their lowest.
    pass_share: of the band that is passed unchanged.
    stop_db: attenuation at and beyond the band's edge.
    zero_phase: leave the phase of the high-pass out, as a calibrated radar does; otherwise an echo at the beat frequency f leads by
        atan(corner/f) per stage.

    >>> bool(abs(IfFilter().gain(5.6e6, 5.21e6)) < 0.0011)
    True
    """

    high_pass_hz: tuple[float, ...] = (175e3,)
    pass_share: float = 0.9
    stop_db: float = 60.0
    zero_phase: bool = True

    def __post_init__(self) -> None:
        corners = self.high_pass_hz
        if not isinstance(corners, tuple | list) or not all(_number(c) and c > 0 for c in corners):
            raise InputError(f"if_filter: high_pass_hz must be frequencies above zero, not {corners!r}")
        object.__setattr__(self, "high_pass_hz", tuple(float(c) for c in corners))
        if not (_number(self.pass_share) and 0 < self.pass_share < 1):
            raise InputError(f"if_filter: pass_share must be between 0 and 1, not {self.pass_share!r}")
        if not (_number(self.stop_db) and self.stop_db >= 0):
            raise InputError(f"if_filter: stop_db must be a finite number of at least 0, not {self.stop_db!r}")
        if not isinstance(self.zero_phase, bool):
            raise InputError(f"if_filter: zero_phase must be true or false, not {self.zero_phase!r}")

    def gain(self, beat_hz: ArrayLike, band_hz: float) -> NDArray[np.complex128]:
        """Complex gain of echoes by their beat frequency before any folding.

        Args:
            beat_hz: slope times delay, shape (...,).
            band_hz: width of the sampled band: the sample rate, half of it for real samples.
        """
        beat_hz = np.asarray(beat_hz, dtype=np.float64)
        high = np.ones(beat_hz.shape, np.complex128)
        for corner in self.high_pass_hz:
            high *= beat_hz / (beat_hz - 1j * corner)
        if self.zero_phase:
            high = np.abs(high).astype(np.complex128)
        into = np.clip((np.abs(beat_hz) / band_hz - self.pass_share) / (1 - self.pass_share), 0, 1)
        return high * 10 ** (-self.stop_db / 20 * np.sin(np.pi / 2 * into) ** 2)

    def to_dict(self) -> dict[str, Any]:
        return asdict(self) | {"high_pass_hz": list(self.high_pass_hz)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> IfFilter:
        """The inverse of to_dict. Raises InputError for an unknown or mistyped field."""
        return build(cls, "if_filter", values)


def build(kind: Any, name: str, values: Any) -> Any:
    """A dataclass of the radar's description from its mapping."""
    if not isinstance(values, Mapping):
        raise InputError(f"{name}: a mapping is expected, not {values!r}")
    known = {f.name for f in fields(kind)}
    if unknown := sorted(set(values) - known, key=str):
        raise InputError(f"{name}: unknown field {unknown[0]!r}; known are {', '.join(sorted(known))}")
    return kind(**values)


def _number(value: Any) -> bool:
    return not isinstance(value, bool) and isinstance(value, int | float | np.integer | np.floating) and math.isfinite(value)
