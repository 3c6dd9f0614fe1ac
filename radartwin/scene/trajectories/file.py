"""Trajectories from files: TUM text, CSV with a header, ROS bags; and their poses at the frames of a radar.

A `Track` holds poses of the sensor (x forward, y left, z up) in the world (z up), metres, at increasing times in seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from radartwin.errors import MissingError, PoseError
from radartwin.scene.checks import MAX_EXTENT_M, unit_hint

Axes = Literal["sensor", "optical"]

MAX_SPEED_MPS = 30.0  # faster is a mistake of units: a car at 100 km/h is below
MAX_STEP_S = 3600.0  # longer between two poses is a clock in other units than seconds
UNIT_TOLERANCE = 1e-2  # of a quaternion's length: four decimals leave 1e-4
TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
# What other tools call the columns of a CSV.
ALIASES = {
    "timestamp": "t", "time": "t", "time_s": "t", "t_s": "t", "timestamp_s": "t", "seconds": "t",
    "tx": "x", "ty": "y", "tz": "z", "x_m": "x", "y_m": "y", "z_m": "z",
}  # fmt: skip
# Columns of the matrix: a camera's z (forward), -x (left) and -y (up) in its own axes. REP 103, suffix _optical.
OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Track:
    """Timed poses.

    Attributes:
        times_s: (N,) increasing seconds.
        poses: (N, 4, 4) sensor-to-world.
        source: what messages call it.
    Raises:
        PoseError: fewer than two poses, times out of order or twice, values that are not finite or not in metres and seconds.
    """

    times_s: np.ndarray
    poses: np.ndarray
    source: str = "trajectory"

    def __post_init__(self) -> None:
        times, poses = np.asarray(self.times_s, dtype=np.float64), np.asarray(self.poses, dtype=np.float64)
        if len(times) < 2 or poses.shape != (len(times), 4, 4):
            raise PoseError(f"{self.source}: {len(times)} poses; a trajectory needs at least two")
        if not (np.isfinite(times).all() and np.isfinite(poses).all()):
            raise PoseError(
                f"{self.source}: pose {_first(~np.isfinite(times) | ~np.isfinite(poses).all(axis=(1, 2)))} holds NaN or infinity"
            )
        steps = np.diff(times)
        if (steps <= 0).any():
            at = _first(steps <= 0)
            what = "the same time as" if steps[at] == 0 else "a time before"
            raise PoseError(f"{self.source}: pose {at + 1} has {what} pose {at} ({times[at + 1]:.9g} s); sort them and drop doubles")
        if steps.max() > MAX_STEP_S:
            raise PoseError(f"{self.source}: {steps.max():.4g} s between two poses; times must be seconds (are they in nanoseconds?)")
        _check_metres(poses[:, :3, 3], steps, self.source)
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "poses", poses)

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1] - self.times_s[0])

    def at(self, times_s: np.ndarray | Sequence[float]) -> np.ndarray:
        """Poses (F, 4, 4) at times: positions on straight lines between neighbours, rotations by the shortest turn.

        Raises:
            PoseError: a time before the first or after the last pose; nothing is extrapolated.
        """
        from scipy.spatial.transform import Rotation, Slerp

        times = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
        slack = 1e-9 * max(1.0, abs(self.times_s[-1]))
        first, last = self.times_s[0], self.times_s[-1]
        if not times.size or times.min() < first - slack or times.max() > last + slack or not np.isfinite(times).all():
            asked = f"{times.min():.9g} to {times.max():.9g} s" if times.size else "no times"
            raise PoseError(f"{self.source} covers {first:.9g} to {last:.9g} s and is asked for {asked}; ask for fewer frames")
        times = times.clip(first, last)
        out = np.repeat(np.eye(4)[None], len(times), axis=0)
        for axis in range(3):
            out[:, axis, 3] = np.interp(times, self.times_s, self.poses[:, axis, 3])
        out[:, :3, :3] = Slerp(self.times_s, Rotation.from_matrix(self.poses[:, :3, :3]))(times).as_matrix()
        return out

    def frames(self, rate_hz: float, frames: int | None = None, start_s: float = 0.0) -> np.ndarray:
        """Poses (F, 4, 4) at the frames of a radar: the first `start_s` after the first pose, then every 1/rate_hz.

        Args:
            frames: how many; as many as the track covers unless given.
        """
        if not (np.isfinite(rate_hz) and rate_hz > 0) or not 0 <= start_s <= self.duration_s:
            raise PoseError(f"{self.source}: frames at {rate_hz} Hz from {start_s} s of {self.duration_s:.4g} s; give a rate above zero")
        held = int(np.floor((self.duration_s - start_s) * rate_hz + 1e-6)) + 1
        if frames is not None and not 1 <= frames <= held:
            raise PoseError(f"{self.source} holds {held} frames at {rate_hz:g} Hz and {frames} are asked for; nothing is extrapolated")
        count = held if frames is None else frames
        return self.at(np.minimum(self.times_s[0] + start_s + np.arange(count) / rate_hz, self.times_s[-1]))

    def mounted(self, mount: np.ndarray) -> Track:
        """The track of a sensor fixed to what moved: `mount` (4, 4) is the sensor's pose in the moving frame."""
        return replace(self, poses=self.poses @ np.asarray(mount, dtype=np.float64))

    def from_axes(self, axes: Axes) -> Track:
        """The same motion with poses in the sensor's axes, given those of a camera ("optical": x right, y down, z forward)."""
        if axes not in ("sensor", "optical"):
            raise PoseError(f"{self.source}: axes {axes!r}; choose sensor (x forward, y left, z up) or optical (z forward, y down)")
        if axes == "sensor":
            return self
        turned = self.poses.copy()
        turned[:, :3, :3] = self.poses[:, :3, :3] @ OPTICAL
        return replace(self, poses=turned)


def read_track(path: str | Path, axes: Axes = "sensor", topic: str | None = None, frame: str | None = None) -> Track:
    """A trajectory of a file.

    TUM: lines `t x y z qx qy qz qw`, "#" begins a comment. CSV: these columns by name in the first line, in any order (timestamp, tx
    and the like are understood; yaw_deg, to the left from +x, instead of the quaternion). A ROS bag: .bag, .mcap or a folder.

    Args:
        axes: of the poses: of a sensor, or "optical" for those of a camera.
        topic, frame: of a ROS bag, see `trajectory_ros.read_bag`.
    Raises:
        MissingError: no such file.
        PoseError: unreadable, or poses that are none; the message names the line.
    """
    path = Path(path)
    if not path.exists():
        raise MissingError(f"trajectory {path} is not there; give a TUM or CSV text file, or a ROS bag")
    if path.is_dir() or path.suffix.lower() in (".bag", ".mcap", ".db3"):
        from radartwin.scene.trajectories.ros import read_bag

        return read_bag(path, topic, frame).from_axes(axes)
    if topic or frame:
        raise PoseError(f"{path} is a text file, which has no topic or frame; leave them out")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (UnicodeDecodeError, OSError) as error:
        raise PoseError(f"{path} cannot be read as text; give TUM or CSV text, or a ROS bag (.bag, .mcap or a folder)") from error
    return parse_track(text, str(path), csv=path.suffix.lower() == ".csv").from_axes(axes)


def parse_track(text: str, source: str, csv: bool) -> Track:
    """The track of TUM or CSV text; see `read_track`."""
    lines = [(k, line.strip()) for k, line in enumerate(text.splitlines(), 1)]
    lines = [(k, line) for k, line in lines if line and not line.startswith("#")]
    names: Sequence[str] = TUM
    if csv:
        if not lines:
            raise PoseError(f"{source} is empty; its first line must name the columns: {','.join(TUM)}")
        names = [ALIASES.get(name, name) for name in (n.strip().strip('"').lower() for n in lines.pop(0)[1].split(","))]
    wanted = _columns(names, source)
    rows = []
    for number, line in lines:
        words = line.split(",") if csv else line.split()
        try:
            if len(words) != len(names):
                raise ValueError
            rows.append([float(words[names.index(name)]) for name in wanted])
        except ValueError:
            raise PoseError(f"{source}, line {number}: {len(names)} numbers are expected ({' '.join(names)}), not {line[:80]!r}") from None
    if len(rows) < 2:
        raise PoseError(f"{source} holds {len(rows)} poses; a trajectory needs at least two")
    table, numbers = np.array(rows), [number for number, _ in lines]
    if not np.isfinite(table).all():
        raise PoseError(f"{source}, line {numbers[_first(~np.isfinite(table).all(axis=1))]}: NaN or infinity; repair or drop the pose")
    steps = np.diff(table[:, 0])
    if (steps <= 0).any():
        at = _first(steps <= 0)
        what = "repeats the time of" if steps[at] == 0 else "goes back behind"
        raise PoseError(f"{source}, line {numbers[at + 1]}: its time {what} the line before; sort the poses and drop doubles")
    rotations = _from_yaw(table[:, 4]) if wanted[-1] == "yaw_deg" else from_quaternions(table[:, 4:8], source, numbers)
    return Track(table[:, 0], _poses(table[:, 1:4], rotations), source)


def from_quaternions(quaternions: np.ndarray, source: str, numbers: Sequence[int] | None = None) -> np.ndarray:
    """Rotations (N, 3, 3) of quaternions (N, 4), x y z w.

    Args:
        numbers: lines of the file, for messages.
    Raises:
        PoseError: a length that is not one.
    """
    from scipy.spatial.transform import Rotation

    length = np.asarray(np.linalg.norm(quaternions, axis=1))
    if (off := ~(np.abs(length - 1) < UNIT_TOLERANCE)).any():
        at = _first(off)
        where = f"line {numbers[at]}" if numbers else f"pose {at}"
        raise PoseError(f"{source}, {where}: a quaternion of length {length[at]:.4g}; it must be one, in the order qx qy qz qw")
    return Rotation.from_quat(quaternions).as_matrix()


def _columns(names: Sequence[str], source: str) -> list[str]:
    """The columns to read: the eight of TUM, or yaw_deg instead of the quaternion."""
    orientation = ["yaw_deg"] if "yaw_deg" in names else ["qx", "qy", "qz", "qw"]
    wanted = ["t", "x", "y", "z", *orientation]
    if missing := [name for name in wanted if name not in names]:
        raise PoseError(
            f"{source}: its first line names no column {', '.join(missing)}; name {','.join(TUM)} (or yaw_deg for the last four)"
        )
    return wanted


def _from_yaw(yaw_deg: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("z", yaw_deg[:, None], degrees=True).as_matrix()


def _poses(positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    out = np.repeat(np.eye(4)[None], len(positions), axis=0)
    out[:, :3, :3], out[:, :3, 3] = rotations, positions
    return out


def _check_metres(positions: np.ndarray, steps_s: np.ndarray, source: str) -> None:
    extent = float(np.ptp(positions, axis=0).max())
    if extent > MAX_EXTENT_M:
        raise PoseError(f"{source} spans {extent:.4g} m, over the limit of {MAX_EXTENT_M:.0f} m; {unit_hint(extent).partition(' (')[0]}")
    speed = float((np.linalg.norm(np.diff(positions, axis=0), axis=1) / steps_s).max())
    if speed > MAX_SPEED_MPS:
        raise PoseError(
            f"{source} moves at {speed:.4g} m/s; are positions in millimetres, or times not in seconds? Convert to metres and seconds"
        )


def _first(mask: ArrayLike) -> int:
    return int(np.argmax(mask))
