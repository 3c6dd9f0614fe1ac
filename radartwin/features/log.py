"""Define the motion log of a recording: the nominal distance of the target and the nominal turntable angle in each frame.

A measurement and its simulation have the same motion log. Features use the motion log and never the true motion, because the true motion is
unknown in a real experiment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError


class Log(Protocol):
    """Give the nominal motion of F frames: distances (F,) in metres from radar to target axis, and turntable angles (F,) or None."""

    @property
    def frame_rate_hz(self) -> float: ...
    @property
    def distance_m(self) -> NDArray[np.float64]: ...
    @property
    def angle_rad(self) -> NDArray[np.float64] | None: ...


@dataclass(frozen=True, eq=False)
class Nominal:
    frame_rate_hz: float
    distance_m: NDArray[np.float64]
    angle_rad: NDArray[np.float64] | None


def distances(log: Log, frames: int) -> NDArray[np.float64]:
    """Return the nominal distance of each frame in metres, (F,).

    Raises:
        InputError: the number of frames in the motion log is not `frames`, or a distance is not above zero.
    """
    distance_m = np.asarray(log.distance_m, dtype=np.float64)
    if distance_m.shape != (frames,):
        raise InputError(f"the log has distances {distance_m.shape} and the recording has {frames} frames; give one distance per frame")
    if not (np.isfinite(distance_m) & (distance_m > 0)).all():
        raise InputError("the log has a distance that is not above zero; give metres from the radar to the axis of the target")
    return distance_m


def angles(log: Log, frames: int) -> NDArray[np.float64]:
    """Return the nominal turntable angle of each frame in radians, (F,).

    Raises:
        InputError: the motion log has no angles, its number of frames is not `frames`, or an angle is not finite.
    """
    if log.angle_rad is None:
        raise InputError("the log has no turntable angle; use turntable recordings for rotation features")
    angle_rad = np.asarray(log.angle_rad, dtype=np.float64)
    if angle_rad.shape != (frames,) or not np.isfinite(angle_rad).all():
        raise InputError(f"the log has angles {angle_rad.shape} and the recording has {frames} frames; give one finite angle per frame")
    return angle_rad
