"""Read and write the raw data files of the capture card DCA1000.

A file holds little-endian int16 words in the order frame, chirp (in the order of transmission), receiver, sample
(radartwin.radar.word_order). The file has no header of its own. With the option of lvdsStreamCfg, the radar chip writes a header before the
samples of each chirp. The header begins with the magic words DC 0A DA 0C DC 0A DA 0C, and its length depends on the firmware, so that the
reader finds it from the distance of the magic words. Packets of user data have the same header and another length; the reader drops them.

References: DCA1000EVM data capture card user's guide (TI SPRUIJ4), raw mode: packets of 1456 bytes, before each of which a stream in UDP
packets has a sequence number (4 bytes) and a byte count (6 bytes); mmWave SDK user's guide, lvdsStreamCfg.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import MissingError, RecordingError
from radartwin.io import untrusted_json
from radartwin.io.git_lfs import refuse_pointer
from radartwin.radar.chirp import Radar
from radartwin.radar.word_order import WORD, Layout

PACKET_BYTES = 1456  # number of sample bytes in one packet of the DCA1000 capture card
_PCAP = tuple(bytes.fromhex(magic) for magic in ("d4c3b2a1", "a1b2c3d4", "4d3cb2a1", "a1b23c4d", "0a0d0d0a"))  # of pcap and pcapng
_COUNTERS = 10  # bytes of sequence number and byte count before the samples of a UDP packet
_MAGIC = bytes.fromhex("dc0ada0cdc0ada0c")
_LONGEST_HEADER = 4096  # bytes, by judgement
_SEARCHED_BYTES = 64 << 20  # size of the block in which magic words are searched at once
_PART = re.compile(r"(.+)_Raw_(\d+)")


def frame_shape(radar: Radar) -> tuple[int, int, int, int]:
    """Return the shape of one frame, (chirp, tx, rx, sample)."""
    return radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples


def frame_bytes(radar: Radar) -> int:
    """Return the size of the samples of one frame on disk in bytes."""
    return math.prod(frame_shape(radar)) * WORD.itemsize * (1 if radar.real_sampling else 2)


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
    files = {int(match[2]): path for path in paths if (match := _PART.fullmatch(path.stem)) and match[1] == prefix}
    for number in range(max(files) + 1):
        if number not in files:
            raise MissingError(f"{capture.parent}: {prefix}_Raw_{number}.bin is missing, and there are parts up to {max(files)}; copy it")
    return [files[number] for number in sorted(files)]


def with_card_settings(layout: Layout, folder: Path) -> tuple[Layout, bool]:
    """Add the settings of the capture card in a folder to a layout. Return whether the folder has such a file.

    The file cf.json of TI's command-line tool states the settings under DCA1000Config. With reorderEnable 1, the card writes I and Q in
    turn, and with MSBToggle 1, it writes unsigned words.
    """
    for path in sorted(folder.glob("*.json")):
        try:
            card = untrusted_json.read(path)["DCA1000Config"] if path.stat().st_size < 1 << 20 else {}
            order = card["dataFormatConfig"]
            mode, reordered, toggled = card.get("dataLoggingMode", "raw"), order.get("reorderEnable") == 1, order.get("MSBToggle") == 1
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
        if mode != "raw":
            raise RecordingError(f"{path}: dataLoggingMode {mode!r} separates the data types; record in raw mode")
        return replace(layout, alternating=reordered and not layout.interleaved, unsigned=toggled), True
    return layout, False


class SampleFile:
    """The samples of a capture in one or more files, without the headers of its chirps.

    Attributes:
        path: path of the first file.
        layout: order of the words.
        shape: shape of a frame, (chirp, tx, rx, sample).
        frames: number of whole frames.
        rest: number of bytes after the last whole frame.
    """

    def __init__(self, paths: Sequence[Path], radar: Radar, layout: Layout) -> None:
        """Find the chirps in the files.

        Raises:
            RecordingError: the files are empty, are Git LFS pointers, hold packet headers, or have headers that do not fit the radar.
        """
        self._paths, self.path, self.layout, self.shape = paths, paths[0], layout, frame_shape(radar)
        for path in paths:
            refuse_pointer(path)
        self._sizes = [path.stat().st_size for path in paths]
        self.size, self.frame_bytes = sum(self._sizes), frame_bytes(radar)
        if self.size == 0:
            raise RecordingError(f"{self.path}: it is empty, zero frames; record again")
        self._refuse_packets()
        self._chirps = radar.num_chirps * radar.num_tx
        chirp_bytes, self._tail = self.frame_bytes // self._chirps, 0  # the bytes of a chirp that is cut off
        self._starts = self._after_headers(chirp_bytes) if _MAGIC in self.read(0, 2 * chirp_bytes + _LONGEST_HEADER) else None
        self.frames, self.rest = divmod(
            self.size if self._starts is None else self._tail + len(self._starts) * chirp_bytes, self.frame_bytes
        )

    def packets_without_zeros(self) -> int:
        """Return the number of packets by which the file is too short. A recording that only stops early ends with a whole packet."""
        missing = self.frame_bytes - self.rest
        lost = self._starts is None and self.rest and missing % PACKET_BYTES == 0 and self.size % PACKET_BYTES
        return missing // PACKET_BYTES if lost else 0

    def leftover(self, radar: Radar) -> str:
        """Return, as text, that the file is no whole number of frames."""
        return (
            f"{self.path}: {self.size} bytes are not a whole number of frames of {self.frame_bytes} bytes for radar {radar.name}: after "
            f"{self.frames} frames, {self.rest} are left over"
        )

    def read(self, start: int, size: int) -> bytes:
        """Read `size` bytes from the byte `start` of the joined files."""
        data = b""
        for path, length in zip(self._paths, self._sizes, strict=True):
            if start < length and len(data) < size:
                with path.open("rb") as stream:
                    stream.seek(start)
                    data += stream.read(size - len(data))
            start = max(0, start - length)
        return data

    def words(self, first: int, count: int) -> NDArray[np.int16]:
        """Read the words (count, word) of frames."""
        if self._starts is None:
            data = self.read(first * self.frame_bytes, count * self.frame_bytes)
            return np.frombuffer(data, WORD).reshape(count, -1)
        starts, size = self._starts[first * self._chirps : (first + count) * self._chirps], self.frame_bytes // self._chirps
        data = self.read(int(starts[0]), int(starts[-1] - starts[0]) + size)
        chirps = [np.frombuffer(data, WORD, size // WORD.itemsize, int(start - starts[0])) for start in starts]
        return np.concatenate(chirps).reshape(count, -1)

    def samples(self, first: int, count: int) -> NDArray[np.complex64]:
        """Read frames as complex counts (count, chirp, tx, rx, sample)."""
        try:
            return self.layout.samples(self.words(first, count).reshape(-1), (count, *self.shape))
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}") from error

    def _refuse_packets(self) -> None:
        """Raise RecordingError if the files are a packet capture, or hold UDP packets with their sequence numbers and byte counts."""
        if self.read(0, 4) in _PCAP:
            raise RecordingError(
                f"{self.path}: it is a packet capture (pcap); join the samples of its packets, with zeros for lost packets"
            )
        packet = PACKET_BYTES + _COUNTERS
        counters = [self.read(n * packet, _COUNTERS) for n in range(3)]
        numbers = [int.from_bytes(data[:4], "little") for data in counters]
        counts = [int.from_bytes(data[4:], "little") for data in counters]
        # The byte count of a packet follows from its number, also if packets are lost or arrive in another order.
        before = {count - PACKET_BYTES * number for number, count in zip(numbers, counts, strict=True)}
        if self.size > 2 * packet + _COUNTERS and len(set(numbers)) == len(numbers) and len(before) == 1:
            headers = f"the packet headers of the DCA1000 ({_COUNTERS} bytes before each {PACKET_BYTES} bytes of samples)"
            raise RecordingError(f"{self.path}: it holds {headers}; remove them, or record without sequence numbers")

    def _after_headers(self, chirp_bytes: int) -> NDArray[np.int64]:
        """Return the place (N,) of the first sample of each chirp, in bytes, by the magic words of the headers."""
        places: list[int] = []
        for start in range(0, self.size, _SEARCHED_BYTES):
            data = self.read(start, _SEARCHED_BYTES + len(_MAGIC) - 1)  # magic words may lie across two blocks or two files
            place = data.find(_MAGIC)
            while place >= 0:
                places.append(start + place)
                place = data.find(_MAGIC, place + 1)
        distances = np.diff([*places, self.size])
        distance = Counter(distances.tolist()).most_common(1)[0][0]
        if distance <= chirp_bytes:
            reason = f"its headers are {distance} bytes apart, which leaves no space for a chirp of {chirp_bytes} bytes"
            raise RecordingError(f"{self.path}: {reason}; give the radar description of this capture")
        if places[0] > 0:
            reason = f"it begins with {places[0]} bytes without a header, so that the transmitter of its first chirp is unknown"
            raise RecordingError(f"{self.path}: {reason}; record again")
        if np.any((distances[:-1] > distance) & (distances[:-1] % distance != 0)):
            raise RecordingError(f"{self.path}: headers beside user data were lost; record again without user data (lvdsStreamCfg)")
        # A distance of several chirps has headers that were lost. Another distance is that of user data, or of a chirp that is cut off.
        chirps = np.where(distances % distance == 0, distances // distance, 0)
        if distances[-1] not in distances[:-1]:
            chirps[-1], self._tail = divmod(int(distances[-1]), int(distance))
        first = np.repeat(np.cumsum(chirps) - chirps, chirps)
        return np.repeat(places, chirps) + (np.arange(len(first)) - first) * distance + distance - chirp_bytes


def lost_frames(words: NDArray[np.number]) -> NDArray[np.int64]:
    """Return which frames (F, word) contain three quarters of a packet of zeros. The capture card writes zeros for lost packets."""
    run = PACKET_BYTES // WORD.itemsize // 8  # a packet of zeros, even with a header in it, covers six aligned blocks of this length
    flat = words.reshape(-1)
    empty: NDArray[np.bool_] = np.logical_not(np.any(flat[: flat.size // run * run].reshape(-1, run), axis=1))
    if len(empty) < 6:
        return np.zeros(0, np.int64)
    begins = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(empty, 6).all(axis=1))
    return np.unique(begins * run // words[0].size)
