"""Read and write raw captures of the cascade of four AWR2243 (board MMWCAS-RF-EVM with the capture board MMWCAS-DSP-EVM).

The capture board writes one file per chip: master_0000_data.bin, slave1_0000_data.bin, slave2_0000_data.bin and slave3_0000_data.bin. In
this order, the files hold RX1 to RX4, RX5 to RX8, RX9 to RX12 and RX13 to RX16. A file has no header, and holds little-endian int16 values,
I before Q, in the order frame, loop, chirp (transmitter in firing order), sample, receiver of the chip. The layout is that of TI's reader
for this board (function read_ADC_bin_TDA2_separateFiles) and of TI E2E 997761. The layout differs from the DCA1000 layout of
radartwin.radar.dca1000, in which all samples of a receiver follow each other.

The capture board splits long captures into parts 0000, 0001, ..., each of which holds whole frames, and writes an index file ..._idx.bin
beside each part. This module reads all parts, but neither reads nor writes index files. TI's own programs count frames by the index files,
so these programs need index files from another source.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import MissingError, OutputError, RecordingError
from radartwin.io import files
from radartwin.io.git_lfs import refuse_pointer
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import frame_bytes, frame_shape
from radartwin.radar.layouts import WORD, Layout
from radartwin.radar.recording import Recording

CHIPS = ("master", "slave1", "slave2", "slave3")
_RECEIVERS = 4  # number of receivers of a chip
_LAYOUT = Layout(q_first=False, interleaved=True, alternating=True)  # of the files of one chip
_PART = re.compile(r"(master|slave[123])_(\d{4})_data\.bin")


def is_cascade_capture(path: Path) -> bool:
    """Return whether a path is a folder with a data file of the cascade's capture board."""
    return path.is_dir() and any(_PART.fullmatch(file.name) for file in path.iterdir())


def write_capture(recording: Recording, folder: str | Path) -> int:
    """Write a recording of a cascade as the four data files of the capture board, each file atomically.

    The amplitude per count is the recording's scale, or 1 if it has none. Raw captures do not hold the scale. The function refuses a folder
    with data files of another capture, because a reader would append the old parts to the new recording.

    Returns:
        Number of int16 values that were clipped.
    Raises:
        RecordingError: the radar is no cascade with 16 receivers, or samples are NaN or infinite.
        OutputError: the folder cannot be written, or it already holds a data file of a capture.
    """
    _check(recording.radar)
    folder = files.make_folder(Path(folder))
    if old := sorted(file.name for file in folder.iterdir() if _PART.fullmatch(file.name)):
        raise OutputError(f"{folder}: the folder already holds {old[0]} of another capture; choose an empty folder")
    saturated = 0
    with files.replacing_together([folder / _name(chip, 0) for chip in CHIPS]) as temporary:
        for block in recording.frame_blocks(8 << 20):
            chips = np.split(recording.iq[block], len(CHIPS), axis=3)
            for path, chip in zip(temporary.values(), chips, strict=True):
                words, clipped = _LAYOUT.words(chip, recording.scale or 1.0)
                saturated += clipped
                with path.open("ab") as stream:
                    stream.write(words.tobytes())
    return saturated


def frame_reader(folder: Path, radar: Radar) -> tuple[int, Callable[[int, int], NDArray[np.complex64]]]:
    """Return the number of frames of a capture, and a function that reads frames as complex counts (count, chirp, tx, rx, sample) from the
    number of the first frame and the number of frames.

    Raises:
        MissingError: a chip lacks a part. Each of the four chips needs all parts from 0000 to the last part in the folder.
        RecordingError: the files do not fit the radar, or hold different numbers of frames.
    """
    _check(radar)
    frame = frame_bytes(radar) // len(CHIPS)
    last = max((int(match[2]) for file in folder.iterdir() if (match := _PART.fullmatch(file.name))), default=0)
    frames: list[tuple[int, int]] = []  # part and place in the part of each frame
    for number in range(last + 1):
        paths = [folder / _name(chip, number) for chip in CHIPS]
        for path in paths:
            if not path.is_file():
                raise MissingError(
                    f"{path}: no such file; each of the {len(CHIPS)} chips needs the parts 0000 to {last:04d}; copy the missing file"
                )
            refuse_pointer(path)
        sizes = [path.stat().st_size for path in paths]
        if len(set(sizes)) > 1 or sizes[0] % frame or not sizes[0]:
            raise RecordingError(
                f"{folder}, part {number:04d}: the files hold {', '.join(map(str, sizes))} bytes; each needs the same whole number of "
                f"frames of {frame} bytes for radar {radar.name}; they are truncated or belong to another radar description"
            )
        frames += [(number, place) for place in range(sizes[0] // frame)]
    loops, transmitters, _, samples = frame_shape(radar)

    def chip_counts(chip: str, number: int, place: int) -> NDArray[np.complex64]:
        words = np.fromfile(folder / _name(chip, number), WORD, frame // WORD.itemsize, offset=place * frame)
        return _LAYOUT.samples(words, (loops, transmitters, _RECEIVERS, samples))

    def read(first: int, count: int) -> NDArray[np.complex64]:
        return np.stack([np.concatenate([chip_counts(chip, *at) for chip in CHIPS], axis=2) for at in frames[first : first + count]])

    return len(frames), read


def _check(radar: Radar) -> None:
    if radar.num_rx != _RECEIVERS * len(CHIPS) or radar.real_sampling:
        sampling = "real" if radar.real_sampling else "complex"
        raise RecordingError(
            f"radar {radar.name} has {radar.num_rx} receivers and {sampling} samples, but a capture of the cascade has "
            f"{_RECEIVERS * len(CHIPS)} receivers and complex samples; give the radar of the cascade, such as awr2243_cascade"
        )


def _name(chip: str, part: int) -> str:
    return f"{chip}_{part:04d}_data.bin"
