"""The radar's poses at the frames of a recording, from the trajectory file beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from radartwin.errors import MissingError, PoseError, RecordingError

TUM = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")


def course_poses(path: Path, start_s: float, frames: int, rate_hz: float) -> np.ndarray:
    """Sensor poses (F, 4, 4) at the frames: positions on straight lines between the file's, rotations on the shortest way.

    Args:
        start_s: the first frame on the file's clock.
    Raises:
        MissingError, PoseError: no file, or none that can be read.
        RecordingError: it does not cover the frames.
    """
    from scipy.spatial.transform import Rotation, Slerp

    times, poses = read_course(path)
    if gap := _uncovered(times, start_s, frames, rate_hz):
        raise RecordingError(f"{path}: {gap}")
    at = np.clip(start_s + np.arange(frames) / rate_hz, times[0], times[-1])
    out = np.tile(np.eye(4), (frames, 1, 1))
    if len(times) == 1:
        out[:] = poses[0]
        return out
    out[:, :3, 3] = np.stack([np.interp(at, times, poses[:, axis, 3]) for axis in range(3)], axis=-1)
    out[:, :3, :3] = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))(at).as_matrix()
    return out


def uncovered(path: Path, start_s: float, frames: int, rate_hz: float) -> str:
    """What keeps the file from covering the frames, or "". Raises MissingError, PoseError for a file that cannot be read."""
    return _uncovered(read_course(path)[0], start_s, frames, rate_hz)


def _uncovered(times: np.ndarray, start_s: float, frames: int, rate_hz: float) -> str:
    """Half a frame at either end is forgiven."""
    first, last, slack = start_s, start_s + (frames - 1) / rate_hz, 0.5 / rate_hz
    if times[0] <= first + slack and last - slack <= times[-1]:
        return ""
    covered = f"it covers {times[0]:.3f} to {times[-1]:.3f} s, the frames are at {first:.3f} to {last:.3f} s"
    return f"{covered}; give a longer one, or a start_s column"


def read_course(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (N,) in seconds, ascending, and sensor poses (N, 4, 4) of a file.

    TUM: lines of time x y z qx qy qz qw, "#" begins a comment. CSV: the same columns, named t,x,y,z,qx,qy,qz,qw in its first line, in any
    order and among others.

    Raises:
        MissingError: no such file.
        PoseError: it cannot be read, with the line.
    """
    from scipy.spatial.transform import Rotation

    if not path.is_file():
        raise MissingError(f"{path}: no such trajectory file")
    try:
        lines = [line.split("#")[0].strip() for line in path.read_text(encoding="utf-8-sig").splitlines()]
    except UnicodeDecodeError:
        raise PoseError(f"{path}: it is not a text file; give TUM text or CSV") from None
    numbered = [(number, line) for number, line in enumerate(lines, start=1) if line]
    columns = list(range(len(TUM)))
    separator = "," if path.suffix.lower() == ".csv" else None
    if separator and numbered:
        names = [name.strip() for name in numbered.pop(0)[1].split(separator)]
        if missing := [name for name in TUM if name not in names]:
            raise PoseError(f"{path}: line 1: it has no column {', '.join(missing)}; name the columns {','.join(TUM)}")
        columns = [names.index(name) for name in TUM]
    rows = []
    for number, line in numbered:
        words = line.split(separator)
        try:
            rows.append([float(words[column]) for column in columns])
        except (ValueError, IndexError):
            raise PoseError(f"{path}: line {number}: {len(TUM)} numbers are expected: {' '.join(TUM)}") from None
    if not rows:
        raise PoseError(f"{path}: it holds no pose")
    table = np.array(rows)
    norm = np.linalg.norm(table[:, 4:], axis=1)
    for what, bad in (
        ("a value that is not finite", ~np.isfinite(table).all(axis=1)),
        ("a quaternion of length other than one", ~(np.abs(norm - 1) < 1e-2)),
        ("a time that does not come after the one before", np.append(False, ~(np.diff(table[:, 0]) > 0))),
    ):
        if bad.any():
            raise PoseError(f"{path}: line {numbered[int(bad.argmax())][0]}: {what}")
    poses = np.tile(np.eye(4), (len(table), 1, 1))
    poses[:, :3, 3] = table[:, 1:4]
    poses[:, :3, :3] = Rotation.from_quat(table[:, 4:]).as_matrix()
    return table[:, 0], poses
