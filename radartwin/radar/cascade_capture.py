"""Read raw captures of the cascade of four AWR2243 (board MMWCAS-RF-EVM with the capture board MMWCAS-DSP-EVM).

The capture board writes one file per chip: master_0000_data.bin, slave1_0000_data.bin, slave2_0000_data.bin and slave3_0000_data.bin. In
this order, the files hold RX1 to RX4, RX5 to RX8, RX9 to RX12 and RX13 to RX16. A file has no header, and holds little-endian int16 values,
I before Q, in the order frame, loop, chirp (transmitter in firing order), sample, receiver of the chip. The layout is that of TI's reader
for this board (function read_ADC_bin_TDA2_separateFiles) and of TI E2E 997761. The layout differs from the DCA1000 layout of
radartwin.radar.dca1000, in which all samples of a receiver follow each other.

The capture board splits long captures into parts 0000, 0001, ..., each of which holds whole frames, and writes an index file ..._idx.bin
beside each part. This module reads all parts and no index files.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import RecordingError
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import SampleFile, frame_bytes
from radartwin.radar.description_files import present
from radartwin.radar.word_order import Layout

CHIPS = ("master", "slave1", "slave2", "slave3")
_RECEIVERS = 4  # number of receivers of a chip
_LAYOUT = Layout(q_first=False, interleaved=True, alternating=True)  # of the files of one chip
_PART = re.compile(r"(master|slave[123])_(\d{4})_data\.bin")


def is_cascade_capture(path: Path) -> bool:
    """Return whether a path is a folder with a data file of the cascade's capture board."""
    return path.is_dir() and any(_PART.fullmatch(file.name) for file in path.iterdir())


def frame_reader(folder: Path, radar: Radar) -> tuple[int, Callable[[int, int], NDArray[np.complex64]]]:
    """Return the number of frames of a capture, and a function that reads frames as complex counts (count, chirp, tx, rx, sample) from the
    number of the first frame and the number of frames.

    Raises:
        MissingError: a chip lacks a part. Each of the four chips needs all parts from 0000 to the last part in the folder.
        RecordingError: the files do not fit the radar, or hold different numbers of frames.
    """
    if radar.num_rx != _RECEIVERS * len(CHIPS) or radar.real_sampling:
        given = f"{radar.num_rx} receivers and {'real' if radar.real_sampling else 'complex'} samples"
        needed = f"a capture of the cascade has {_RECEIVERS * len(CHIPS)} receivers and complex samples"
        raise RecordingError(f"radar {radar.name} has {given}, but {needed}; give the radar of the cascade, such as awr2243_cascade")
    frame = frame_bytes(radar) // len(CHIPS)
    last = max((int(match[2]) for file in folder.iterdir() if (match := _PART.fullmatch(file.name))), default=0)
    parts: list[list[Path]] = []
    for number in range(last + 1):
        paths = [folder / f"{chip}_{number:04d}_data.bin" for chip in CHIPS]
        for path in paths:
            present(path, f"each of the {len(CHIPS)} chips needs the parts 0000 to {last:04d}; copy the missing file")
        sizes = [path.stat().st_size for path in paths]
        if len(set(sizes)) > 1 or sizes[0] % frame or not sizes[0]:
            held = f"the files hold {', '.join(map(str, sizes))} bytes, but need the same whole number of frames of {frame} bytes"
            remedy = f"give the radar description of this capture instead of {radar.name}, or copy truncated files again"
            raise RecordingError(f"{folder}, part {number:04d}: {held}; {remedy}")
        parts.append(paths)
    of_chip = replace(radar, rx_positions_m=radar.rx_positions_m[:_RECEIVERS], rx_gains_db=None)
    chips = [SampleFile(paths, of_chip, _LAYOUT) for paths in zip(*parts, strict=True)]
    return chips[0].frames, lambda first, count: np.concatenate([chip.samples(first, count) for chip in chips], axis=3)
