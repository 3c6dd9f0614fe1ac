"""Compute poses and motions of sensors and objects. A pose is a (4, 4) float64 transform, sensor-to-world or object-to-world.

The sensor frame has x forward (boresight), y left and z up. An object pose transforms a mesh from the object's own frame, whose origin is
on the axis of rotation, to the world frame: vertices_world = pose @ vertices.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

from radartwin.errors import PoseError


def pose(position: ArrayLike, rotation: np.ndarray | None = None) -> np.ndarray:
    """Build a pose (4, 4) from a position (3,) in metres and a rotation matrix (3, 3). The default rotation is the identity."""
    out = np.eye(4)
    out[:3, 3] = np.asarray(position, dtype=np.float64)
    if rotation is not None:
        out[:3, :3] = rotation
    return out


def look_at(position: ArrayLike, target: ArrayLike) -> np.ndarray:
    """Return the sensor pose (4, 4) at `position` with its boresight towards `target` and its y axis horizontal.

    Raises:
        PoseError: `position` and `target` coincide.

    >>> look_at([0, 0, 1], [0, 2, 1])[:3, 0].tolist()
    [0.0, 1.0, 0.0]
    """
    position, target = np.asarray(position, dtype=np.float64), np.asarray(target, dtype=np.float64)
    forward = target - position
    distance = np.linalg.norm(forward)
    if not distance > 0:
        raise PoseError(f"look_at: position and target are both {position.tolist()}; the sensor needs a direction")
    forward = forward / distance
    left = np.cross([0.0, 0.0, 1.0], forward)
    # if the sensor looks straight up or down, every horizontal y axis is valid; use the y axis of the world
    if np.linalg.norm(left) < 1e-9:
        left = np.array([0.0, 1.0, 0.0])
    left = left / np.linalg.norm(left)
    return pose(position, np.stack([forward, left, np.cross(forward, left)], axis=1))


def static(sensor_pose: ArrayLike, frames: int) -> np.ndarray:
    """Repeat the sensor pose for every frame, and return the poses (F, 4, 4)."""
    return np.repeat(np.asarray(sensor_pose, dtype=np.float64)[None], _count(frames), axis=0)


def turntable(
    position: ArrayLike, frames: int, frame_rate_hz: float, seconds_per_revolution: float = 25.0, start_rad: float = 0.0
) -> np.ndarray:
    """Return the poses (F, 4, 4) of an object on a turntable, which turns counter-clockwise, seen from above.

    The object turns about the vertical axis through `position`.

    Args:
        position: (3,) position of the object's origin in the world, metres.
        start_rad: azimuth of the object's +x axis in the world, in the first frame, radians.
        seconds_per_revolution: time of a full turn in seconds; with a negative value, the object turns clockwise.
    """
    if not (frame_rate_hz > 0 and seconds_per_revolution):
        raise PoseError("turntable: frame_rate_hz must be positive and seconds_per_revolution not zero")
    angle = start_rad + 2 * np.pi * np.arange(_count(frames)) / (frame_rate_hz * seconds_per_revolution)
    out = np.repeat(pose(position)[None], frames, axis=0)
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angle)
    out[:, 1, 0] = np.sin(angle)
    out[:, 0, 1] = -out[:, 1, 0]
    return out


def rail(start: ArrayLike, direction: ArrayLike, length_m: float, frames: int) -> np.ndarray:
    """Return poses (F, 4, 4) with constant orientation at equal steps along a straight line, as on a linear rail.

    The line starts at the pose `start` and has the length `length_m` along `direction`.

    Args:
        start: (4, 4) pose of a sensor or an object in the first frame.
        direction: (3,) direction of the line in the world frame, as a vector of any non-zero length.
    """
    return at_distances(start, direction, np.linspace(0.0, length_m, _count(frames)))


def at_distances(start: ArrayLike, direction: ArrayLike, distances_m: np.ndarray) -> np.ndarray:
    """Return poses (F, 4, 4) with constant orientation at the distances `distances_m` (F,) in metres from the pose `start` along a line.

    Args:
        direction: (3,) direction of the line in the world frame, as a vector of any non-zero length.
    """
    direction = np.asarray(direction, dtype=np.float64)
    if not np.linalg.norm(direction) > 0:
        raise PoseError("rail: the direction is zero; give a vector of the world frame that is not zero")
    out = static(start, len(distances_m))
    out[:, :3, 3] += distances_m[:, None] * direction / np.linalg.norm(direction)
    return out


def depth_sweep(start: np.ndarray, length_m: float = 1.0, speed_mps: float = 0.2, frame_rate_hz: float = 10.0) -> np.ndarray:
    """Return the sensor poses (F, 4, 4) of a drive towards the target: straight along the boresight of the pose `start`.

    With a negative `length_m`, the sensor moves backwards.
    """
    start = np.asarray(start, dtype=np.float64)
    return sweep(start, start[:3, 0], length_m, speed_mps, frame_rate_hz)


def lateral_sweep(middle: np.ndarray, length_m: float = 1.2, speed_mps: float = 0.24, frame_rate_hz: float = 10.0) -> np.ndarray:
    """Return the sensor poses (F, 4, 4) of a drive past the object, at right angles to the line of sight.

    The sensor moves towards its left side. The pose `middle` is in the middle of the path.
    """
    middle = np.asarray(middle, dtype=np.float64)
    out = sweep(middle, middle[:3, 1], length_m, speed_mps, frame_rate_hz)
    out[:, :3, 3] += middle[:3, 3] - out[:, :3, 3].mean(axis=0)
    return out


def sweep(start: ArrayLike, direction: ArrayLike, length_m: float, speed_mps: float, rate_hz: float) -> np.ndarray:
    """Return poses (F, 4, 4) of a straight motion at constant speed: up to frame f, the pose has moved by f * speed_mps / rate_hz.

    The path has the length `length_m` along `direction`, in the world frame. The number of frames is the path length divided by
    the step per frame, rounded down. The last frame is therefore one to two steps before the end of the path.
    """
    if not (speed_mps > 0 and rate_hz > 0 and length_m):
        raise PoseError("sweep: speed_mps and frame_rate_hz must be positive and length_m not zero")
    step = speed_mps / rate_hz
    frames = int(np.floor(abs(length_m) / step + 1e-9))
    return rail(start, np.sign(length_m) * np.asarray(direction, dtype=np.float64), step * max(frames - 1, 0), max(frames, 1))


def _count(frames: int) -> int:
    if int(frames) != frames or frames < 1:
        raise PoseError(f"{frames} frames; give a whole number of at least 1")
    return int(frames)


def check_height(poses: np.ndarray, floor_m: float, ceiling_m: float) -> None:
    """Raise an error if the sensor is below the floor or above the ceiling in any frame.

    Args:
        poses: (F, 4, 4) sensor-to-world poses, metres.
        ceiling_m: height of the ceiling in metres; infinite for a room without a ceiling.
    """
    z = np.asarray(poses, dtype=np.float64).reshape(-1, 4, 4)[:, 2, 3]
    out = (z <= floor_m) | (z >= ceiling_m)
    if out.any():
        frame = int(np.argmax(out))
        where = "under the floor" if z[frame] <= floor_m else "above the ceiling"
        top = f"to {ceiling_m:.3g} m" if np.isfinite(ceiling_m) else "up and has no ceiling"
        raise PoseError(
            f"the sensor at frame {frame} is {where}: z = {z[frame]:.3g} m, and the room reaches from {floor_m:.3g} {top}; "
            "check that z is up and that the axes of the poses are right (sensor or optical)"
        )


def check_speed(poses: np.ndarray, frame_rate_hz: float, limit_mps: float, what: str = "the sensor") -> None:
    """Warn once if the speed in any frame exceeds the largest speed that the radar measures without Doppler ambiguity.

    Args:
        limit_mps: largest unambiguous radial speed of the radar in m/s, `Radar.max_velocity_mps`.
    """
    speed = np.linalg.norm(np.diff(np.asarray(poses, dtype=np.float64).reshape(-1, 4, 4)[:, :3, 3], axis=0), axis=1) * frame_rate_hz
    if speed.size and speed.max() > limit_mps:
        count, frame = int((speed > limit_mps).sum()), int(np.argmax(speed))
        warnings.warn(
            f"{what} moves at up to {speed.max():.3g} m/s (frame {frame}), but its Doppler is unambiguous only up to {limit_mps:.3g} m/s: "
            f"{count} of {len(speed) + 1} frames alias; slow down or shorten the chirp interval",
            stacklevel=2,
        )
