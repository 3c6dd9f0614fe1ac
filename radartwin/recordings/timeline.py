"""Write a recording as a timeline: an MCAP file that Foxglove plays, with maps, detections, poses and pictures of each frame.

docs/timelines.md lists topics and messages. Frame f is stamped with the start of its first chirp, start + f/frame_rate. The maps of a frame
are those of radartwin.radar.power_maps for this frame alone. The file is written frame by frame, so that the memory does not grow with the
length of the file. The file has a temporary name until it is complete. Format: mcap.dev/spec. Messages of Foxglove are in Protobuf, which
Foxglove and rerun decode; range profiles are in JSON.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

from radartwin.constants import __version__
from radartwin.errors import BackendError, OutputError
from radartwin.io import files
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.power_maps import doppler_bins, range_bins
from radartwin.radar.processing import range_axis, velocity_axis
from radartwin.radar.recording import Recording
from radartwin.recordings.camera_pictures import Picture

if TYPE_CHECKING:
    from radartwin.recordings.foxglove import Message

# Level of a black pixel. Foxglove shows the pixels 0 to 10,000 of a mono16 picture by default, which are the 100 dB above the floor.
FLOOR_DB, FLOOR_COUNTS_DB = -200.0, -20.0  # for amplitudes (relative to the transmitted power) and for ADC counts


def write_timeline(
    recording: Recording, path: str | Path, *, start_ns: int = 0, pictures: list[Picture] | None = None, progress: Progress | None = None
) -> dict[str, int]:
    """Write the MCAP file of a recording.

    Args:
        recording: recording to write; a memory-mapped recording is read frame by frame.
        path: the MCAP file; an existing file is replaced.
        start_ns: time of the start of the first frame, in nanoseconds since 1970.
        pictures: pictures of the camera, in ascending order of their times; None for none.
    Returns:
        Number of messages by topic. A radar with one channel has no range-azimuth map and no points, a frame with one chirp has no
        range-Doppler map, and a recording without poses has no transform.
    Raises:
        BackendError: the package foxglove-sdk is missing.
        InputError: a picture cannot be read or is not of the kind of its suffix.
        OutputError: the file cannot be written. No temporary file remains, and an existing file keeps its content.
    """
    path = Path(path)
    check_target(path)
    from foxglove import Channel, Context, open_mcap

    files.sweep(files.make_folder(path.parent))
    context, floor_db = Context(), FLOOR_COUNTS_DB if recording.in_counts else FLOOR_DB
    channels: dict[str, Channel] = {}
    counts: Counter[str] = Counter()
    with files.replacing(path) as stream, open_mcap(cast("BinaryIO", stream), context=context) as writer:
        writer.write_metadata("radartwin", _metadata(recording, start_ns, floor_db))
        for time_ns, topic, message in _messages(recording, start_ns, floor_db, pictures or [], progress):
            if topic not in channels:
                schema = message.get_schema()
                encoding = "json" if schema.encoding == "jsonschema" else schema.encoding
                channels[topic] = Channel(topic, schema=schema, message_encoding=encoding, context=context)
            channels[topic].log(message.encode(), log_time=time_ns)
            counts[topic] += 1
    return dict(counts)


def check_target(path: Path) -> None:
    """Check that an MCAP file can be written, before the recording is read.

    Raises:
        BackendError: the package mcap or foxglove-sdk is missing.
        OutputError: the path is a folder or has another suffix than .mcap, or its folder cannot be written.
    """
    if path.is_dir():
        raise OutputError(f"{path} is a folder; give the name of the MCAP file to write")
    if path.suffix != ".mcap":
        raise OutputError(f"{path} does not end with .mcap; give the MCAP file a name such as {path.with_suffix('.mcap').name}")
    files.check_folder(path.parent)
    try:
        import foxglove  # noqa: F401
    except ImportError as error:
        raise BackendError("--mcap needs the package foxglove-sdk; install it with pip install 'radartwin[mcap]'") from error


def frame_time_ns(radar: Radar, frame: int, start_ns: int) -> int:
    """Return the time of the start of a frame in nanoseconds since 1970. The start is a whole number, so that no digit is lost."""
    return start_ns + round(frame * 1e9 / radar.frame_rate_hz)


def _messages(
    recording: Recording, start_ns: int, floor_db: float, pictures: list[Picture], progress: Progress | None
) -> Iterator[tuple[int, str, Message]]:
    """Yield time, topic and message of the whole timeline in the order of time."""
    from radartwin.recordings.foxglove import frame_messages, picture_message

    waiting = list(reversed(pictures))
    for frame in (progress or Progress(quiet=True)).over(range(recording.num_frames), "frames"):
        time_ns = frame_time_ns(recording.radar, frame, start_ns)
        while waiting and waiting[-1].time_ns < time_ns:
            yield waiting[-1].time_ns, "/camera/image", picture_message(waiting.pop())
        for topic, message in frame_messages(recording, frame, time_ns, floor_db):
            yield time_ns, topic, message
    for picture in reversed(waiting):
        yield picture.time_ns, "/camera/image", picture_message(picture)


def _metadata(recording: Recording, start_ns: int, floor_db: float) -> dict[str, str]:
    """Return the metadata record of the file: texts, of which radar, axes and provenance are JSON."""
    from radartwin.recordings.foxglove import PIXELS_PER_DB

    radar = recording.radar
    velocity_mps = velocity_axis(radar, doppler_bins(radar))
    axes = {
        "range_m": [float(range_axis(radar, range_bins(radar))[-1]), 0.0],
        "velocity_mps": [float(velocity_mps[0]), float(velocity_mps[-1])],
        "azimuth_deg": [90.0, -90.0],
    }
    return {
        "version": __version__,
        "radar": json.dumps(radar.to_dict()),
        "frames": str(recording.num_frames),
        "start_ns": str(start_ns),
        "unit": "dB of one squared ADC count" if recording.in_counts else "dB of transmitted power",
        "floor_db": str(floor_db),
        "pixels_per_db": str(PIXELS_PER_DB),
        "axes": json.dumps(axes),  # values at the first and at the last row or column of the pictures
        "provenance": json.dumps(recording.provenance),
    }
