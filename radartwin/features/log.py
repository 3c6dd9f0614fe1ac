"""What experimenter and twin agree on of a recording: the nominal motion, frame by frame. Features read it, never the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError


class Log(Protocol):
    """Nominal motion of F frames.

    Attributes:
        distance_m: (F,) from the radar to the target's axis.
        angle_rad: (F,) of the turntable, or None where nothing turns.
    """

    @property
    def frame_rate_hz(self) -> float: ...
    @property
    def distance_m(self) -> NDArray[np.float64]: ...
    @property
    def angle_rad(self) -> NDArray[np.float64] | None: ...


@dataclass(frozen=True, eq=False)
class Nominal:
    """A log as it stands: of some frames, or of a motion that nobody logged."""

    frame_rate_hz: float
    distance_m: NDArray[np.float64]
    angle_rad: NDArray[np.float64] | None


def distances(log: Log, frames: int) -> NDArray[np.float64]:
    """Nominal distance of each frame, (F,). Raises InputError where the log is of another length, or names no distance."""
    distance_m = np.asarray(log.distance_m, dtype=np.float64)
    if distance_m.shape != (frames,):
        raise InputError(f"the log has distances {distance_m.shape} and the recording has {frames} frames; give one each")
    if not (np.isfinite(distance_m) & (distance_m > 0)).all():
        raise InputError("the log has a distance that is not above zero; give metres from the radar to the target's axis")
    return distance_m


def angles(log: Log, frames: int) -> NDArray[np.float64]:
    """Nominal turntable angle of each frame, (F,). Raises InputError where the log has none, or of another length."""
    if log.angle_rad is None:
        raise InputError("the log has no turntable angle; rotation features are read from turntable recordings")
    angle_rad = np.asarray(log.angle_rad, dtype=np.float64)
    if angle_rad.shape != (frames,) or not np.isfinite(angle_rad).all():
        raise InputError(f"the log has angles {angle_rad.shape} and the recording has {frames} frames; give one finite angle each")
    return angle_rad
