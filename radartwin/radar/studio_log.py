"""Read the LogFile.csv that mmWave Studio and the DCA1000 command-line tool write beside a raw capture.

The log contains lines "key - value" or "key : value": first settings, then one section per data type ("Raw Data :"). This package cannot
read logs with several sections, which exist if the capture card separates data types. The capture card writes zeros for lost packets into
the .bin file. Only the log and the zeros show that packets were lost, because the file size does not change.

References: DCA1000EVM data capture card user's guide (TI SPRUIJ4), raw mode, states a payload of 1456 bytes per packet. A log with 143473
packets for 100 frames of 2088960 bytes (../shared/data/radar/iwr6843_static_room) agrees with this payload.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from radartwin.errors import RecordingError
from radartwin.radar.dca1000 import PACKET_BYTES, capture_prefix
from radartwin.radar.description_files import present

_LINE = re.compile(r"\s*([A-Za-z][A-Za-z ()]*?)\s*[-:]\s*(.*?)[\s,]*")


@dataclass(frozen=True)
class StudioLog:
    """The values of a LogFile.csv of the DCA1000 capture card.

    Attributes:
        lanes: number of LVDS lanes; None if the log does not state it.
        received, lost, out_of_sequence: numbers of packets; the .bin file contains zeros for lost packets.
        lost_bytes: number of bytes in the .bin file that are zero because packets were lost.
        started: local time of the recording computer at the start, ISO 8601 without time zone; None if the log does not state it.
    """

    lanes: int | None
    received: int
    lost: int
    lost_bytes: int
    out_of_sequence: int
    started: str | None

    def frames(self, frame_bytes: int) -> int:
        """Return the number of whole frames in the .bin file.

        If the last packet was padded, the result may be one more than the number of frames that were sent.
        """
        return (self.received + self.lost) * PACKET_BYTES // frame_bytes


def read_log(path: str | Path, lanes: int = 2) -> StudioLog:
    """Read a LogFile.csv of the DCA1000 capture card. The argument `lanes` is the number of LVDS lanes in the description of the capture.

    Raises:
        MissingError: the log file does not exist.
        RecordingError: the file is not a log of the DCA1000, or its capture mode has another sample layout.
    """
    path = Path(path)
    values: dict[str, str] = {}
    for line in present(path).read_text(encoding="utf-8", errors="replace").splitlines():
        if match := _LINE.fullmatch(line):
            values.setdefault(match.group(1).lower(), match.group(2))
    if values.get("log mode", "Raw") != "Raw":
        raise RecordingError(f"{path}: log mode {values['log mode']} separates the data types; record in raw mode")
    logged = _number(path, values, "lvds lane mode")
    if logged not in (None, 2, lanes):
        raise RecordingError(f"{path}: {logged} LVDS lanes do not fit the description, which has {lanes}; give the right radar description")
    received = _number(path, values, "number of received packets")
    if received is None:
        raise RecordingError(f"{path}: the number of received packets is missing; give the LogFile.csv of a finished capture")
    counted = ("number of zero filled packets", "number of zero filled bytes", "out of sequence count")
    packets, filled, late = (_number(path, values, key) or 0 for key in counted)
    started = values.get("capture start time")
    try:  # English day and month names, unless a locale is set
        started = datetime.strptime(started, "%a %b %d %H:%M:%S %Y").isoformat() if started else None
    except ValueError:
        raise RecordingError(f"{path}: {started!r} is not a time such as 'Tue Nov 19 20:02:23 2024'") from None
    return StudioLog(logged, received, packets, filled, late, started)


def find_log(capture: Path) -> Path | None:
    """Find the log file of a .bin capture: PREFIX_Raw_LogFile.csv or PREFIX_LogFile.csv in the same folder.

    If neither file exists and the folder contains one capture and one log, the function returns the path of that log; otherwise None.
    """
    prefix = capture_prefix(capture)
    for name in (f"{prefix}_Raw_LogFile.csv", f"{prefix}_LogFile.csv"):
        if (capture.parent / name).is_file():
            return capture.parent / name
    logs = sorted(capture.parent.glob("*LogFile.csv"))
    captures = {capture_prefix(path) for path in capture.parent.glob("*.bin")}
    return logs[0] if len(logs) == 1 and len(captures) == 1 else None


def _number(path: Path, values: dict[str, str], key: str) -> int | None:
    if key not in values:
        return None
    if not (match := re.match(r"\d+", values[key])):
        raise RecordingError(f"{path}: {key} {values[key]!r} is not a number")
    return int(match.group())
