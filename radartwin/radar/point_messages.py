"""Pack detected echoes as point clouds in the layout of the ROS message sensor_msgs/PointCloud2, without ROS.

Each point has five little-endian float32 fields: x, y, z in metres in the sensor frame (x forward, y left, z up, ROS REP 103), the radial
velocity in m/s (receding positive, NaN if a frame has a single chirp) and the intensity, which is the signal-to-noise ratio in dB. A cloud
is one row (height 1) of N points. Reference: sensor_msgs/msg/PointCloud2 and PointField of ROS 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.radar.detection import Peaks

FLOAT32 = 7  # PointField.FLOAT32
NAMES = ("x", "y", "z", "velocity", "intensity")
POINT = np.dtype([(name, "<f4") for name in NAMES])


@dataclass(frozen=True)
class PointField:
    """Describe one field of a point like sensor_msgs/PointField: name, offset in bytes, code of the data type, number of values."""

    name: str
    offset: int
    datatype: int
    count: int


@dataclass(frozen=True)
class PointCloud2:
    """Hold one cloud with the fields of sensor_msgs/PointCloud2 except the header, which the writer of a message knows.

    Attributes:
        is_dense: whether all values of all points are finite.
    """

    height: int
    width: int
    fields: tuple[PointField, ...]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: bytes
    is_dense: bool


def point_cloud2(peaks: Peaks) -> PointCloud2:
    """Pack the peaks of a frame, for example of `radartwin.radar.detection.point_clouds`.

    >>> one, none = np.ones(1), np.full(1, np.nan)
    >>> cloud = point_cloud2(Peaks(2 * one, 0.5 * one, 0 * one, none, 100 * one, one))
    >>> np.frombuffer(cloud.data, POINT)[0].item()
    (2.0, 0.0, 0.0, 0.5, 20.0)
    >>> cloud.width, cloud.point_step, len(cloud.data)
    (1, 20, 20)
    """
    points = np.empty(len(peaks), dtype=POINT)
    points["x"], points["y"], points["z"] = peaks.xyz_m.T
    points["velocity"], points["intensity"] = peaks.velocity_mps, peaks.snr_db
    described = tuple(PointField(name, int(POINT.fields[name][1]), FLOAT32, 1) for name in NAMES) if POINT.fields else ()
    finite = all(bool(np.isfinite(points[name]).all()) for name in NAMES)
    size = POINT.itemsize
    return PointCloud2(1, len(points), described, False, size, size * len(points), points.tobytes(), finite)


def arrays(clouds: Sequence[Peaks], frame_rate_hz: float) -> dict[str, NDArray]:
    """Return the points of F frames as the arrays of points.npz.

    The arrays are `points` (N, 5) float32 with the columns NAMES, `first` (F + 1,) int64, and `time_s` (F,) float64 with the start of each
    frame. The points of frame f are points[first[f] : first[f + 1]].
    """
    if not clouds:
        raise InputError("point clouds: there is no frame; give at least one")
    packed = [point_cloud2(cloud) for cloud in clouds]
    points = np.frombuffer(b"".join(cloud.data for cloud in packed), dtype="<f4").reshape(-1, len(NAMES))
    first = np.cumsum([0, *(cloud.width for cloud in packed)], dtype=np.int64)
    return {"points": points, "first": first, "time_s": np.arange(len(clouds), dtype=np.float64) / frame_rate_hz}
