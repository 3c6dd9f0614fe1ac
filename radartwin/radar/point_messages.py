"""Pack detected echoes as the points of the ROS message sensor_msgs/PointCloud2, without ROS.

Each point has five little-endian float32 fields: x, y, z in metres in the sensor frame (x forward, y left, z up, ROS REP 103), the radial
velocity in m/s (receding positive, NaN if a frame has a single chirp) and the intensity, which is the signal-to-noise ratio in dB. Names,
offsets and size of the fields in the dtype POINT are those of the message. Reference: sensor_msgs/msg/PointCloud2 of ROS 2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.radar.detection import Peaks

NAMES = ("x", "y", "z", "velocity", "intensity")
POINT = np.dtype([(name, "<f4") for name in NAMES])


def packed(peaks: Peaks) -> NDArray[np.void]:
    """Return the peaks of a frame as points (N,) of the dtype POINT; their bytes are the data of a PointCloud2.

    >>> one, none = np.ones(1), np.full(1, np.nan)
    >>> packed(Peaks(2 * one, 0.5 * one, 0 * one, none, 100 * one, one))[0].item()
    (2.0, 0.0, 0.0, 0.5, 20.0)
    """
    points = np.empty(len(peaks), dtype=POINT)
    points["x"], points["y"], points["z"] = peaks.xyz_m.T
    points["velocity"], points["intensity"] = peaks.velocity_mps, peaks.snr_db
    return points


def arrays(clouds: Sequence[Peaks], frame_rate_hz: float) -> dict[str, NDArray]:
    """Return the points of F frames as the arrays of points.npz.

    The arrays are `points` (N, 5) float32 with the columns NAMES, `first` (F + 1,) int64, and `time_s` (F,) float64 with the start of each
    frame. The points of frame f are points[first[f] : first[f + 1]].
    """
    if not clouds:
        raise InputError("point clouds: there is no frame; give at least one")
    points = np.concatenate([packed(cloud) for cloud in clouds]).view("<f4").reshape(-1, len(NAMES))
    first = np.cumsum([0, *map(len, clouds)], dtype=np.int64)
    return {"points": points, "first": first, "time_s": np.arange(len(clouds), dtype=np.float64) / frame_rate_hz}
