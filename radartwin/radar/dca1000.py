"""Convert between complex samples and the raw data format of the capture card DCA1000.

The module supports the radar chips xWR16xx, xWR18xx and xWR68xx with two LVDS lanes. The raw data are little-endian int16 values without
headers, in the order frame, chirp (in the order of transmission), receiver, sample. Complex samples come in pairs, first two I values and
then two Q values: I0 I1 Q0 Q1, I2 I3 Q2 Q3, and so on. Firmware with the sample swap option writes Q first: Q0 Q1 I0 I1. Real samples
follow each other without Q values.

Reference: Mmwave Radar Device ADC Raw Data Capture (TI SWRA581B), sections on two-lane devices.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import MissingError, RecordingError
from radartwin.radar.chirp import Radar

FULL_SCALE = 32767
_SAMPLE = np.dtype("<i2")
_PART = re.compile(r"(.+)_Raw_(\d+)")


def frame_shape(radar: Radar) -> tuple[int, int, int, int]:
    """Return the shape of one frame, (chirp, tx, rx, sample)."""
    return radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples


def frame_bytes(radar: Radar) -> int:
    """Return the size of one frame on disk in bytes."""
    samples = radar.num_chirps * radar.num_tx * radar.num_rx * radar.num_samples
    return samples * _SAMPLE.itemsize * (1 if radar.real_sampling else 2)


def capture_prefix(capture: Path) -> str:
    """Return a capture's name without the part number _Raw_0, _Raw_1, ... The capture card starts a new file after at most 1 GB.

    >>> capture_prefix(Path("mug_Raw_0.bin"))
    'mug'
    """
    return match.group(1) if (match := _PART.fullmatch(capture.stem)) else capture.stem


def parts(capture: Path) -> list[Path]:
    """Return the files of one capture in order: PREFIX_Raw_0.bin, PREFIX_Raw_1.bin, ... A capture without part number is one file.

    Raises:
        MissingError: a file of the capture is missing.
    """
    if capture.suffix != ".bin" or not (part := _PART.fullmatch(capture.stem)):
        return [capture]
    prefix, paths = part[1], capture.parent.glob("*.bin")
    found = {int(match[2]): path for path in paths if (match := _PART.fullmatch(path.stem)) and match[1] == prefix}
    for number in range(max(found) + 1):
        if number not in found:
            raise MissingError(
                f"{capture.parent}: {prefix}_Raw_{number}.bin is missing; the capture has parts up to {max(found)}; copy the missing file"
            )
    return [found[number] for number in sorted(found)]


def encode(iq: NDArray[np.complexfloating], scale: float, *, iq_swapped: bool = False, real_sampling: bool = False) -> tuple[bytes, int]:
    """Convert the samples of frames to the bytes of a DCA1000 file.

    Args:
        iq: samples [frame, chirp, tx, rx, sample] in amplitude units.
        scale: amplitude per ADC count, above zero.
        iq_swapped: whether to write Q before I.
        real_sampling: whether to write only the real parts of the samples.
    Returns:
        data: bytes of the frames.
        clipped: number of int16 values that the function clipped to the 16-bit range.
    Raises:
        RecordingError: samples are NaN or infinite, or a chirp has an odd number of samples over all receivers, which cannot form pairs.

    >>> encode(np.array([1 + 2j, 3 + 4j]).reshape(1, 1, 1, 1, 2), 1.0)[0].hex(" ", 2)
    '0100 0300 0200 0400'
    """
    iq = np.asarray(iq)
    if not np.isfinite(iq).all():
        raise RecordingError("the recording holds NaN or infinite samples, which int16 cannot hold; simulate or record it again")
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
    """Convert the bytes of a DCA1000 file to complex ADC counts [frame, chirp, tx, rx, sample].

    The conversion is exact, because float32 represents every int16 value.

    Raises:
        RecordingError: the data are not a whole number of frames, or a chirp has an odd number of samples over all receivers.
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
