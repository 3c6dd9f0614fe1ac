"""Build the messages of a timeline from Foxglove's own classes (package foxglove-sdk), which encode them in Protobuf.

Foxglove has no message for a row of numbers over a physical axis, so that the range profile is RadarTwin's own message, encoded in JSON.

Conventions. In the picture of a map, the first row is the farthest range. A pixel is an unsigned 16-bit number (mono16): the level in
hundredths of a decibel above a floor, so that level_db = floor_db + pixel/100. The points have the fields and the bytes of
radartwin.radar.point_messages.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from foxglove import Schema, messages
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from radartwin.radar import point_messages
from radartwin.radar.detection import Peaks
from radartwin.radar.processing import decibels
from radartwin.recordings.pictures import Picture

PIXELS_PER_DB = 100.0
_POINT_FIELDS = {point_messages.FLOAT32: messages.PackedElementFieldNumericType.Float32}
_NUMBER = {"type": "number"}
_PROFILE = {
    "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
    "frame_id": {"type": "string"}, "range_start_m": _NUMBER, "range_step_m": _NUMBER, "power_db": {"type": "array", "items": _NUMBER},
}  # fmt: skip


class Message(Protocol):
    """A message of Foxglove, or one with the same two methods."""

    @staticmethod
    def get_schema() -> Schema: ...

    def encode(self) -> bytes: ...


@dataclass(frozen=True)
class RangeProfile:
    """The fields of a range profile: levels `power_db` at the ranges range_start_m + n range_step_m."""

    fields: dict[str, Any]

    @staticmethod
    def get_schema() -> Schema:
        content = {"title": "radartwin.RangeProfile", "type": "object", "properties": _PROFILE, "required": list(_PROFILE)}
        return Schema(name="radartwin.RangeProfile", encoding="jsonschema", data=json.dumps(content).encode())

    def encode(self) -> bytes:
        return json.dumps(self.fields, allow_nan=False, separators=(",", ":")).encode()


def range_profile(time_ns: int, frame_id: str, range_m: NDArray[np.float64], power: NDArray[np.float64]) -> RangeProfile:
    sec, nsec = divmod(time_ns, 1_000_000_000)
    step_m = float(range_m[1] - range_m[0]) if len(range_m) > 1 else 0.0
    values = {"sec": sec, "nsec": nsec}, frame_id, float(range_m[0]), step_m, np.round(decibels(power), 3).tolist()
    return RangeProfile(dict(zip(_PROFILE, values, strict=True)))


def map_image(time_ns: int, frame_id: str, power: NDArray[np.float64], floor_db: float) -> messages.RawImage:
    """Return the picture of a power map (columns, range), whose pixels are levels above `floor_db` (see the module's docstring)."""
    pixels = np.clip(np.rint((decibels(power.T[::-1]) - floor_db) * PIXELS_PER_DB), 0, 65535).astype("<u2")
    height, width = pixels.shape
    size = {"width": width, "height": height, "encoding": "mono16", "step": 2 * width}
    return messages.RawImage(timestamp=_time(time_ns), frame_id=frame_id, data=pixels.tobytes(), **size)


def picture(picture: Picture, frame_id: str) -> messages.CompressedImage:
    return messages.CompressedImage(timestamp=_time(picture.time_ns), frame_id=frame_id, data=picture.read(), format=picture.kind)


def point_cloud(time_ns: int, frame_id: str, peaks: Peaks) -> messages.PointCloud:
    cloud = point_messages.point_cloud2(peaks)
    fields = [messages.PackedElementField(name=f.name, offset=f.offset, type=_POINT_FIELDS[f.datatype]) for f in cloud.fields]
    pose = messages.Pose(**_pose(np.eye(4)))
    stamped = {"timestamp": _time(time_ns), "frame_id": frame_id}
    return messages.PointCloud(**stamped, pose=pose, point_stride=cloud.point_step, fields=fields, data=cloud.data)


def frame_transform(time_ns: int, parent: str, child: str, pose: NDArray[np.float64]) -> messages.FrameTransform:
    """Return the transform of the frame `child` to the frame `parent` by a pose (4, 4)."""
    both = _pose(pose)
    names = {"parent_frame_id": parent, "child_frame_id": child}
    return messages.FrameTransform(timestamp=_time(time_ns), **names, translation=both["position"], rotation=both["orientation"])


def pose_in_frame(time_ns: int, frame_id: str, pose: NDArray[np.float64]) -> messages.PoseInFrame:
    return messages.PoseInFrame(timestamp=_time(time_ns), frame_id=frame_id, pose=messages.Pose(**_pose(pose)))


def _pose(pose: NDArray[np.float64]) -> dict[str, Any]:
    rotation = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return {
        "position": messages.Vector3(**dict(zip("xyz", pose[:3, 3].tolist(), strict=True))),
        "orientation": messages.Quaternion(**dict(zip("xyzw", rotation.tolist(), strict=True))),
    }


def _time(time_ns: int) -> messages.Timestamp:
    return messages.Timestamp(*divmod(time_ns, 1_000_000_000))
