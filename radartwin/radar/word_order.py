"""Convert between complex samples and the int16 words of a capture, in each order in which TI's capture hardware writes them.

| layout | words of the complex samples of one chirp | written by |
|---|---|---|
| pairs | I0 I1 Q0 Q1, I2 I3 Q2 Q3, ... of one receiver after the other | DCA1000 with two LVDS lanes |
| alternating | I0 Q0 I1 Q1 ... of one receiver after the other | DCA1000 with reorderEnable 1 |
| interleaved | I0 of all receivers, Q0 of all receivers, I1 of all receivers, ... | DCA1000 with four LVDS lanes |
| both | I0 Q0 of the first receiver, I0 Q0 of the second receiver, ..., I1 Q1 of the first receiver, ... | MMWCAS-DSP-EVM |

Real samples are the same without Q. Firmware with the sample swap option writes Q before I.

References: Mmwave Radar Device ADC Raw Data Capture (TI SWRA581B) for two and four lanes; DCA1000EVM CLI Software Developer Guide (TI) for
reorderEnable and MSBToggle; radartwin.radar.cascade_capture for the cascade.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import RecordingError

FULL_SCALE = 32767
WORD = np.dtype("<i2")


@dataclass(frozen=True)
class Layout:
    """Describe how the words of a capture hold its samples.

    Attributes:
        real: whether the file holds only the real part of each sample.
        q_first: whether Q comes before I; None if no description states the order.
        interleaved: whether the samples of the receivers alternate.
        alternating: whether I and Q alternate.
        bits: number of valid low bits of a word, whose highest bit is the sign.
        unsigned: whether words count from 0 to 65535 with zero in the middle (offset binary).
        image_filtered: whether the receiver filters the image band (complex 1x), so that the noise shows the order of I and Q.
    """

    real: bool = False
    q_first: bool | None = None
    interleaved: bool = False
    alternating: bool = False
    bits: int = 16
    unsigned: bool = False
    image_filtered: bool = True

    def samples(self, words: NDArray[np.int16], shape: tuple[int, ...]) -> NDArray[np.complex64]:
        """Convert words to complex counts of the shape (..., rx, sample). The conversion is exact."""
        *outer, receivers, samples = shape
        if self.unsigned:
            words = words ^ np.int16(-FULL_SCALE - 1)
        if self.bits < 16:
            words = words << (16 - self.bits) >> (16 - self.bits)  # the second shift repeats the sign bit
        if self.real:
            iq = words.astype(np.float32).astype(np.complex64)
        else:
            first, second = words.reshape(-1, 2, self._run(receivers, samples)).swapaxes(0, 1)
            iq = np.empty(words.size // 2, np.complex64)
            iq.real, iq.imag = (part.reshape(-1) for part in ((second, first) if self.q_first else (first, second)))
        if self.interleaved:
            iq = iq.reshape(*outer, samples, receivers).swapaxes(-1, -2)
        return iq.reshape(shape)

    def words(self, iq: NDArray[np.complexfloating], scale: float) -> tuple[NDArray[np.int16], int]:
        """Convert samples (..., rx, sample) to words of 16 bits. Return them with the number of words that were clipped.

        Args:
            iq: samples in amplitude units.
            scale: amplitude per ADC count, above zero.
        Raises:
            RecordingError: samples are NaN or infinite, or a chirp has an odd number of samples over all receivers, which form no pairs.

        >>> Layout().words(np.array([[1 + 2j, 3 + 4j]]), 1.0)[0].reshape(-1).tolist()
        [1, 3, 2, 4]
        """
        iq = np.asarray(iq)
        if not np.isfinite(iq).all():
            raise RecordingError("the recording holds NaN or infinite samples, which int16 cannot hold; simulate or record it again")
        receivers, samples = iq.shape[-2:]
        ordered = iq.swapaxes(-1, -2) if self.interleaved else iq
        parts = [np.rint(part.astype(np.float64) / scale) for part in (ordered.real, ordered.imag)[: 1 if self.real else 2]]
        run = 1 if self.real else self._run(receivers, samples)
        counts = np.stack([part.reshape(-1, run) for part in (parts[::-1] if self.q_first else parts)], axis=1)
        clipped = np.clip(counts, -FULL_SCALE - 1, FULL_SCALE)
        return clipped.astype(WORD), int(np.count_nonzero(clipped != counts))

    def _run(self, receivers: int, samples: int) -> int:
        """Return the number of successive words that are all I or all Q."""
        if not self.alternating and not self.interleaved and receivers * samples % 2:
            raise RecordingError(f"{receivers * samples} samples of all receivers form no pairs for two lanes; use an even num_samples")
        return 1 if self.alternating else receivers if self.interleaved else 2
