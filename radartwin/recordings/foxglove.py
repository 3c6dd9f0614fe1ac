"""Build messages of the Foxglove schemas, encoded in JSON, for the timelines that radartwin.recordings.timeline writes.

The names and fields of the schemas are those that Foxglove publishes (github foxglove/foxglove-sdk, schemas/jsonschema; documented at
docs.foxglove.dev/docs/sdk/schemas). Binary data is base64 text, and a time is a whole number of seconds and nanoseconds. The schema
radartwin.RangeProfile is RadarTwin's own, because Foxglove has no schema for a row of numbers over a physical axis.

Conventions. In the picture of a map, the first row is the farthest range. A pixel is an unsigned 16-bit number (mono16): the level in
hundredths of a decibel above a floor, so that level_db = floor_db + pixel/100. The points have the fields and the bytes of
radartwin.radar.point_messages.
"""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.radar import point_messages
from radartwin.radar.processing import decibels

Message = dict[str, Any]

PIXELS_PER_DB = 100.0
_POINT_FIELDS = {point_messages.FLOAT32: 7}  # code of the ROS message PointField -> number in NUMERIC_TYPES
# Fields of each message in the order of their numbers 1, 2, ...: name and type. A type with a capital letter is another message.
FIELDS: dict[str, tuple[tuple[str, str], ...]] = {
    "foxglove.Vector3": (("x", "double"), ("y", "double"), ("z", "double")),
    "foxglove.Quaternion": (("x", "double"), ("y", "double"), ("z", "double"), ("w", "double")),
    "foxglove.Pose": (("position", "foxglove.Vector3"), ("orientation", "foxglove.Quaternion")),
    "foxglove.PackedElementField": (("name", "string"), ("offset", "fixed32"), ("type", "foxglove.PackedElementField.NumericType")),
    "foxglove.RawImage": (
        ("timestamp", "Timestamp"), ("width", "fixed32"), ("height", "fixed32"), ("encoding", "string"), ("step", "fixed32"),
        ("data", "bytes"), ("frame_id", "string"),
    ),
    "foxglove.CompressedImage": (("timestamp", "Timestamp"), ("data", "bytes"), ("format", "string"), ("frame_id", "string")),
    "foxglove.PointCloud": (
        ("timestamp", "Timestamp"), ("frame_id", "string"), ("pose", "foxglove.Pose"), ("point_stride", "fixed32"),
        ("fields", "repeated foxglove.PackedElementField"), ("data", "bytes"),
    ),
    "foxglove.FrameTransform": (
        ("timestamp", "Timestamp"), ("parent_frame_id", "string"), ("child_frame_id", "string"), ("translation", "foxglove.Vector3"),
        ("rotation", "foxglove.Quaternion"),
    ),
    "foxglove.PoseInFrame": (("timestamp", "Timestamp"), ("frame_id", "string"), ("pose", "foxglove.Pose")),
    "radartwin.RangeProfile": (
        ("timestamp", "Timestamp"), ("frame_id", "string"), ("range_start_m", "double"), ("range_step_m", "double"),
        ("power_db", "repeated double"),
    ),
}  # fmt: skip
NUMERIC_TYPES = ("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64")
_JSON_TYPES: dict[str, Message] = {
    "double": {"type": "number"}, "fixed32": {"type": "integer", "minimum": 0}, "string": {"type": "string"},
    "bytes": {"type": "string", "contentEncoding": "base64"},
    "foxglove.PackedElementField.NumericType": {"type": "integer", "minimum": 0, "maximum": len(NUMERIC_TYPES) - 1},
}  # fmt: skip


def _object(title: str, properties: Message) -> Message:
    return {"title": title, "type": "object", "properties": properties, "required": list(properties)}


_WHOLE = _JSON_TYPES["fixed32"]
_JSON_TYPES["Timestamp"] = _object("time", {"sec": _WHOLE, "nsec": {**_WHOLE, "maximum": 999_999_999}})


def _json_schema(kind: str) -> Message:
    if kind.startswith("repeated "):
        return {"type": "array", "items": _json_schema(kind.removeprefix("repeated "))}
    return _JSON_TYPES.get(kind) or _object(kind, {name: _json_schema(inner) for name, inner in FIELDS[kind]})


def schema(name: str) -> bytes:
    """Return the JSON Schema of the message `name`."""
    return json.dumps(_json_schema(name)).encode()


def encode(name: str, message: Message) -> bytes:
    """Encode a message in JSON."""
    return json.dumps(message, allow_nan=False, separators=(",", ":")).encode()


def stamped(time_ns: int, frame_id: str) -> Message:
    return {"timestamp": _time(time_ns), "frame_id": frame_id}


def map_image(time_ns: int, frame_id: str, power: NDArray[np.float64], floor_db: float) -> Message:
    """Return a foxglove.RawImage of a power map (columns, range), whose pixels are levels above `floor_db` (see the module's docstring)."""
    level = (decibels(power.T[::-1]) - floor_db) * PIXELS_PER_DB
    pixels = np.clip(np.rint(level), 0, 65535).astype("<u2")
    height, width = pixels.shape
    size = {"width": width, "height": height, "encoding": "mono16", "step": 2 * width}
    return {**stamped(time_ns, frame_id), **size, "data": _text(pixels.tobytes())}


def picture(time_ns: int, frame_id: str, data: bytes, kind: str) -> Message:
    """Return a foxglove.CompressedImage of the bytes of a picture file of the kind "jpeg", "png" or "webp"."""
    return {**stamped(time_ns, frame_id), "data": _text(data), "format": kind}


def point_cloud(time_ns: int, frame_id: str, cloud: point_messages.PointCloud2) -> Message:
    """Return a foxglove.PointCloud with the fields and the bytes of a packed point cloud."""
    packed = [{"name": field.name, "offset": field.offset, "type": _POINT_FIELDS[field.datatype]} for field in cloud.fields]
    layout = {"pose": _pose(np.eye(4)), "point_stride": cloud.point_step, "fields": packed}
    return {**stamped(time_ns, frame_id), **layout, "data": _text(cloud.data)}


def frame_transform(time_ns: int, parent: str, child: str, pose: NDArray[np.float64]) -> Message:
    """Return a foxglove.FrameTransform of the pose (4, 4) that transforms the frame `child` to the frame `parent`."""
    both = _pose(pose)
    return {
        "timestamp": _time(time_ns), "parent_frame_id": parent, "child_frame_id": child,
        "translation": both["position"], "rotation": both["orientation"],
    }  # fmt: skip


def pose_in_frame(time_ns: int, frame_id: str, pose: NDArray[np.float64]) -> Message:
    return {**stamped(time_ns, frame_id), "pose": _pose(pose)}


def range_profile(time_ns: int, frame_id: str, range_m: NDArray[np.float64], power: NDArray[np.float64]) -> Message:
    """Return a radartwin.RangeProfile: levels in dB at the ranges range_start_m + n range_step_m."""
    levels = np.round(decibels(power), 3).tolist()
    step_m = float(range_m[1] - range_m[0]) if len(range_m) > 1 else 0.0
    return {**stamped(time_ns, frame_id), "range_start_m": float(range_m[0]), "range_step_m": step_m, "power_db": levels}


def _pose(pose: NDArray[np.float64]) -> Message:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return {"position": _named("xyz", pose[:3, 3]), "orientation": _named("xyzw", turn)}


def _named(names: str, values: NDArray[np.float64]) -> Message:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _time(time_ns: int) -> Message:
    sec, nsec = divmod(time_ns, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
