"""The DCA1000 raw layout of the xWR16xx, xWR18xx and xWR68xx with two LVDS lanes, as complex samples and back.

Little-endian int16, no headers: frames, in each the chirps in TDM order, in each chirp the receivers, in each its
samples. Complex samples travel in pairs, two of I and two of Q: I0 I1 Q0 Q1, I2 I3 Q2 Q3, ... Firmware with the sample
swap set puts Q first: Q0 Q1 I0 I1. Real sampling drops Q and the pairing.

Reference: Mmwave Radar Device ADC Raw Data Capture (TI SWRA581B), sections on two-lane devices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import RecordingError
from radartwin.radar.chirp import Radar

FULL_SCALE = 32767
_SAMPLE = np.dtype("<i2")


def frame_shape(radar: Radar) -> tuple[int, int, int, int]:
    """Shape of one frame: (chirp, tx, rx, sample)."""
    return radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples


def frame_bytes(radar: Radar) -> int:
    """Bytes of one frame on disk."""
    samples = radar.num_chirps * radar.num_tx * radar.num_rx * radar.num_samples
    return samples * _SAMPLE.itemsize * (1 if radar.real_sampling else 2)


def encode(iq: NDArray[np.complexfloating], scale: float, *, iq_swapped: bool = False, real_sampling: bool = False) -> tuple[bytes, int]:
    """The bytes of some frames, and how many int16 values were clipped to fit.

    Args:
        iq: [frame, chirp, tx, rx, sample], amplitude.
        scale: amplitude per count, above zero.
    Raises:
        RecordingError: NaN or infinite samples, or an odd number of samples per chirp, which two lanes cannot pair.

    >>> encode(np.array([1 + 2j, 3 + 4j]).reshape(1, 1, 1, 1, 2), 1.0)[0].hex(" ", 2)
    '0100 0300 0200 0400'
    """
    iq = np.asarray(iq)
    if not np.isfinite(iq).all():
        raise RecordingError("recording holds NaN or infinite samples; it cannot be written as int16")
    i = np.rint(iq.real.astype(np.float64) / scale)
    if real_sampling:
        ordered = i
    else:
        _check_pairs(iq.shape[-2] * iq.shape[-1])
        q = np.rint(iq.imag.astype(np.float64) / scale)
        first, second = (q, i) if iq_swapped else (i, q)
        ordered = np.stack([first.reshape(-1, 2), second.reshape(-1, 2)], axis=1)
    clipped = np.clip(ordered, -FULL_SCALE - 1, FULL_SCALE)
    return clipped.astype(_SAMPLE).tobytes(), int(np.count_nonzero(clipped != ordered))


def decode(data: bytes | memoryview, radar: Radar, *, iq_swapped: bool = False) -> NDArray[np.complex64]:
    """Counts as complex numbers, shape [frame, chirp, tx, rx, sample]; exact, since int16 fits float32.

    Raises:
        RecordingError: not a whole number of frames, or an odd number of samples per chirp.
    """
    size = len(data)
    if size % frame_bytes(radar):
        raise RecordingError(f"{size} bytes are not a whole number of frames of {frame_bytes(radar)} bytes")
    counts = np.frombuffer(data, dtype=_SAMPLE)
    shape = (-1, *frame_shape(radar))
    if radar.real_sampling:
        return counts.astype(np.float32).astype(np.complex64).reshape(shape)
    _check_pairs(radar.num_rx * radar.num_samples)
    pairs = counts.reshape(-1, 2, 2)
    iq = np.empty(pairs.shape[0] * 2, dtype=np.complex64)
    first, second = pairs[:, 0].reshape(-1), pairs[:, 1].reshape(-1)
    iq.real, iq.imag = (second, first) if iq_swapped else (first, second)
    return iq.reshape(shape)


def _check_pairs(samples_per_chirp: int) -> None:
    if samples_per_chirp % 2:
        raise RecordingError(
            f"{samples_per_chirp} samples per chirp over all receivers cannot be paired on two lanes; use an even num_samples"
        )
