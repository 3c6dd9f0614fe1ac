"""Build the messages of a timeline from Foxglove's own classes (package foxglove-sdk), which encode them in Protobuf.

Foxglove has no message for a row of numbers over a physical axis, so that the range profile is RadarTwin's own message, encoded in JSON.

Conventions. In the picture of a map, the first row is the farthest range. A pixel is an unsigned 16-bit number (mono16): the level in
hundredths of a decibel above a floor, so that level_db = floor_db + pixel/100. The points have the fields and the bytes of
radartwin.radar.point_messages.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
from foxglove import Schema
from foxglove import messages as fox
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from radartwin.radar.detection import point_clouds
from radartwin.radar.point_messages import NAMES, POINT, packed
from radartwin.radar.power_maps import power_maps
from radartwin.radar.processing import decibels
from radartwin.radar.recording import Recording
from radartwin.recordings.camera_pictures import Picture

WORLD, SENSOR, CAMERA = "world", "radar", "camera"  # frame ids
PIXELS_PER_DB = 100.0
_FLOAT32 = fox.PackedElementFieldNumericType.Float32
_NUMBER = {"type": "number"}


@dataclass(frozen=True)
class RangeProfile:
    """Levels in dB at the ranges range_start_m + n range_step_m. The time stamp has whole seconds `sec` and nanoseconds `nsec`."""

    timestamp: dict[str, int]
    frame_id: str
    range_start_m: float
    range_step_m: float
    power_db: list[float]

    @staticmethod
    def get_schema() -> Schema:
        fields = {
            "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
            "frame_id": {"type": "string"}, "range_start_m": _NUMBER, "range_step_m": _NUMBER,
            "power_db": {"type": "array", "items": _NUMBER},
        }  # fmt: skip
        content = {"title": "radartwin.RangeProfile", "type": "object", "properties": fields, "required": list(fields)}
        return Schema(name="radartwin.RangeProfile", encoding="jsonschema", data=json.dumps(content).encode())

    def encode(self) -> bytes:
        return json.dumps(asdict(self), allow_nan=False, separators=(",", ":")).encode()


Message = fox.FrameTransform | fox.PoseInFrame | fox.RawImage | fox.PointCloud | fox.CompressedImage | RangeProfile


def frame_messages(recording: Recording, frame: int, time_ns: int, floor_db: float) -> Iterator[tuple[str, Message]]:
    """Yield topic and message of pose, maps and points of one frame."""
    radar, iq = recording.radar, recording.iq[frame : frame + 1]
    maps, poses = power_maps(iq, radar), recording.sensor_poses
    sec, nsec = divmod(time_ns, 1_000_000_000)
    stamp = fox.Timestamp(sec, nsec)
    if poses is not None:
        position, rotation = _pose(poses[frame if len(poses) > 1 else 0])
        frames = {"parent_frame_id": WORLD, "child_frame_id": SENSOR}
        yield "/tf", fox.FrameTransform(timestamp=stamp, **frames, translation=position, rotation=rotation)
        yield "/radar/pose", fox.PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=fox.Pose(position=position, orientation=rotation))
    step_m = float(maps.range_m[1]) if len(maps.range_m) > 1 else 0.0
    levels_db = np.round(decibels(maps.range_time.mean(axis=0)), 3).tolist()
    yield "/radar/range_profile", RangeProfile({"sec": sec, "nsec": nsec}, SENSOR, float(maps.range_m[0]), step_m, levels_db)
    if radar.num_chirps > 1:
        yield "/radar/range_doppler", _picture_of_map(stamp, maps.range_doppler, floor_db)
    if radar.num_tx * radar.num_rx > 1:
        # The columns run from the left of the radar (positive azimuth) to its right.
        yield "/radar/range_azimuth", _picture_of_map(stamp, maps.range_azimuth[::-1], floor_db)
        (peaks,) = point_clouds(iq, radar)
        position, rotation = _pose(np.eye(4))
        fields = [fox.PackedElementField(name=name, offset=4 * n, type=_FLOAT32) for n, name in enumerate(NAMES)]
        data = {"point_stride": POINT.itemsize, "fields": fields, "data": packed(peaks).tobytes()}
        pose = fox.Pose(position=position, orientation=rotation)
        yield "/radar/points", fox.PointCloud(timestamp=stamp, frame_id=SENSOR, pose=pose, **data)


def picture_message(picture: Picture) -> Message:
    stamp = fox.Timestamp(*divmod(picture.time_ns, 1_000_000_000))
    return fox.CompressedImage(timestamp=stamp, frame_id=CAMERA, data=picture.read(), format=picture.kind)


def _picture_of_map(stamp: fox.Timestamp, power: NDArray[np.float64], floor_db: float) -> fox.RawImage:
    """Return the picture of a power map (columns, range), whose pixels are levels above `floor_db` (see the module's docstring)."""
    pixels = np.clip(np.rint((decibels(power.T[::-1]) - floor_db) * PIXELS_PER_DB), 0, 65535).astype("<u2")
    height, width = pixels.shape
    size = {"width": width, "height": height, "encoding": "mono16", "step": 2 * width}
    return fox.RawImage(timestamp=stamp, frame_id=SENSOR, data=pixels.tobytes(), **size)


def _pose(pose: NDArray[np.float64]) -> tuple[fox.Vector3, fox.Quaternion]:
    (x, y, z), rotation = pose[:3, 3].tolist(), Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    return fox.Vector3(x=x, y=y, z=z), fox.Quaternion(**dict(zip("xyzw", rotation, strict=True)))
