"""Define the track, a sequence of timed sensor poses, and interpolate the poses at the frame times of a radar."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from radartwin.errors import PoseError
from radartwin.io.one_line import plural
from radartwin.scene.mesh_checks import MAX_EXTENT_M, unit_hint

Axes = Literal["sensor", "optical"]

MAX_SPEED_MPS = 30.0  # a higher speed of a track shows that its units are wrong; a car at 100 km/h is slower
MAX_STEP_S = 3600.0  # a longer time between two poses shows that times are not in seconds
UNIT_TOLERANCE = 1e-2  # largest deviation of a quaternion's length from 1; rounding to four decimals causes about 1e-4
# The columns are the sensor axes x, y and z in camera axes (x right, y down, z forward): z, -x and -y. REP 103, suffix _optical.
OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Track:
    """Hold timed poses of the sensor (axes x forward, y left, z up) in the world frame (z up), in metres and seconds.

    Attributes:
        times_s: (N,) increasing times of the poses, seconds.
        poses: (N, 4, 4) sensor-to-world poses, metres.
        source: name of the track in error messages.
    Raises:
        PoseError: there are fewer than two poses, times do not increase, values are not finite, or units are not metres and seconds.
    """

    times_s: np.ndarray
    poses: np.ndarray
    source: str = "trajectory"

    def __post_init__(self) -> None:
        times, poses = np.asarray(self.times_s, dtype=np.float64), np.asarray(self.poses, dtype=np.float64)
        if len(times) < 2 or poses.shape != (len(times), 4, 4):
            raise PoseError(f"{self.source}: {plural(len(times), 'pose')}; a trajectory needs at least two")
        check_samples(times, poses.reshape(len(times), 16), lambda k: f"{self.source}: pose {k}")
        steps = np.diff(times)
        if steps.max() > MAX_STEP_S:
            raise PoseError(f"{self.source}: {steps.max():.4g} s between two poses; times must be seconds (are they in nanoseconds?)")
        extent = float(np.ptp(poses[:, :3, 3], axis=0).max())
        if extent > MAX_EXTENT_M:
            hint = unit_hint(extent).partition(" (")[0]
            raise PoseError(f"{self.source} spans {extent:.4g} m, over the limit of {MAX_EXTENT_M:.0f} m; {hint}")
        speed = float((np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) / steps).max())
        if speed > MAX_SPEED_MPS:
            raise PoseError(f"{self.source} moves at {speed:.4g} m/s; are units millimetres or milliseconds? Convert to metres and seconds")
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "poses", poses)

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1] - self.times_s[0])

    def at(self, times_s: np.ndarray | Sequence[float]) -> np.ndarray:
        """Return the poses (F, 4, 4) at the times `times_s` (F,). Positions are interpolated linearly, rotations along the shortest arc.

        Raises:
            PoseError: a requested time is before the first or after the last pose of the track.
        """
        times = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
        slack = 1e-9 * max(1.0, abs(self.times_s[-1]))
        first, last = self.times_s[0], self.times_s[-1]
        if not times.size or times.min() < first - slack or times.max() > last + slack or not np.isfinite(times).all():
            wanted = f"{times.min():.9g} to {times.max():.9g} s" if times.size else "no times"
            raise PoseError(f"{self.source} covers {first:.9g} to {last:.9g} s, not {wanted}; request fewer frames")
        times = times.clip(first, last)
        positions = np.stack([np.interp(times, self.times_s, self.poses[:, axis, 3]) for axis in range(3)], axis=1)
        rotations = Slerp(self.times_s, Rotation.from_matrix(self.poses[:, :3, :3]))(times).as_matrix()
        return pose_matrices(positions, rotations)

    def frames(self, rate_hz: float, frames: int | None = None, start_s: float = 0.0) -> np.ndarray:
        """Interpolate the poses (F, 4, 4) at the frames of a radar, which has the frame rate `rate_hz`.

        Args:
            frames: number of radar frames; by default as many as the track covers.
            start_s: time in seconds from the first pose of the track to the first radar frame.
        Raises:
            PoseError: the frame rate is not positive, the start is outside the track, or the track covers fewer than `frames` frames.
        """
        if not (np.isfinite(rate_hz) and rate_hz > 0) or not 0 <= start_s <= self.duration_s:
            raise PoseError(f"{self.source}: frames at {rate_hz} Hz from {start_s} s of {self.duration_s:.4g} s; correct rate or start")
        covered = int(np.floor((self.duration_s - start_s) * rate_hz + 1e-6)) + 1
        if frames is not None and not 1 <= frames <= covered:
            raise PoseError(f"{self.source} holds {plural(covered, 'frame')} at {rate_hz:g} Hz, not {frames}; request fewer frames")
        count = covered if frames is None else frames
        return self.at(np.minimum(self.times_s[0] + start_s + np.arange(count) / rate_hz, self.times_s[-1]))

    def mounted(self, mount: np.ndarray) -> Track:
        """Return the track of a sensor that is mounted on the body whose poses this track holds.

        `mount` (4, 4) is the sensor-to-body pose.
        """
        return replace(self, poses=self.poses @ np.asarray(mount, dtype=np.float64))

    def from_axes(self, axes: Axes) -> Track:
        """Return the track with its poses converted from `axes` to the sensor's axes.

        The value "optical" means camera axes (x right, y down, z forward).
        """
        if axes not in ("sensor", "optical"):
            raise PoseError(f"{self.source}: axes {axes!r}; choose sensor (x forward, y left, z up) or optical (z forward, y down)")
        if axes == "sensor":
            return self
        poses = self.poses.copy()
        poses[:, :3, :3] = self.poses[:, :3, :3] @ OPTICAL
        return replace(self, poses=poses)


def pose_matrices(positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Build poses (N, 4, 4) from positions (N, 3) and rotation matrices (N, 3, 3)."""
    out = np.repeat(np.eye(4)[None], len(positions), axis=0)
    out[:, :3, :3], out[:, :3, 3] = rotations, positions
    return out


def from_quaternions(quaternions: np.ndarray, place: Callable[[int], str]) -> np.ndarray:
    """Convert quaternions (N, 4), in the order x y z w, to rotation matrices (N, 3, 3).

    Args:
        place: function that returns, for an index k, the text that names pose k in error messages, such as a file name and a line.
    Raises:
        PoseError: the length of a quaternion differs from 1 by more than UNIT_TOLERANCE.
    """
    length = np.asarray(np.linalg.norm(quaternions, axis=1))
    if (wrong := ~(np.abs(length - 1) < UNIT_TOLERANCE)).any():
        at = int(wrong.argmax())
        raise PoseError(f"{place(at)}: the quaternion has length {length[at]:.4g}, not 1; check the order qx qy qz qw")
    return Rotation.from_quat(quaternions).as_matrix()


def check_samples(times_s: np.ndarray, values: np.ndarray, place: Callable[[int], str]) -> None:
    """Raise an error for values (N, M) or times (N,) that are not finite, and for times that do not increase.

    `place(k)` is the text that names pose k in error messages.
    """
    bad = ~np.isfinite(times_s) | ~np.isfinite(values).all(axis=1)
    if bad.any():
        raise PoseError(f"{place(int(bad.argmax()))}: NaN or infinity; repair or drop the pose")
    steps = np.diff(times_s)
    if (steps <= 0).any():
        at = int((steps <= 0).argmax())
        problem = "equals" if steps[at] == 0 else "is earlier than"
        raise PoseError(
            f"{place(at + 1)}: its time {times_s[at + 1]:.9g} s {problem} that of the pose before; sort the poses and drop duplicates"
        )
