"""Add motion errors to nominal poses: compute the true poses of a rover, rail, turntable or placed object from the logged poses.

A recording stores the nominal (logged) pose of frame f, for the time f / frame rate. For each kind of motion, a frozen dataclass with a
method `scaled(strength)` holds the sizes of the motion errors. At strength 0 the true poses equal the nominal poses exactly. Equal seeds
give equal errors.

The default sizes of the motion errors and their sources follow. A default is an order-of-magnitude estimate if no value is published for a
comparable rover, rail or turntable:
- Rover slip: 1.5 % of the path. Half of the slip's variance is constant (wheel size, load), and half has a correlation length of 0.3 m. The
  uncalibrated odometry of a differential drive has an error of 2 % of its path, 310 mm in 16 m (J. Borenstein, L. Feng, IEEE Trans.
  Robotics and Automation 12 (1996) 869, cited from memory). After the wheel size in the log is corrected, the remaining slip is smaller.
  Mecanum wheels slip more.
- Rover heading: the error grows by 0.9 degrees per metre, from "1 degree per 45 in" reported for a swerve drive (gwhs/FalconRecharged2021,
  issue 6). The error at the start is 0.5 degrees, for a rover that is aligned with half a metre of tape to within 4 mm.
- Rover start: the position error is 1 cm, for a wheel placed by hand on a marked position on the floor.
- Rover ripple: one period per wheel revolution, for moulded wheels of 80 mm diameter that are 0.5 mm out of round (order of magnitude).
- Rover bob: 0.5 mm of height with a correlation length of 0.1 m, an order-of-magnitude estimate for the effect of the rollers of a mecanum
  wheel and of floor joints.
- Rail: the start position has an error of 2 mm, because a person sets the carriage against its stop by hand.
  The travelled distance has an error of 0.5 % caused by belt and pulley. The ripple is 0.1 mm per revolution of a pulley with a
  circumference of 40 mm. All three values of the rail are order-of-magnitude estimates.
- Turntable start angle: 5 degrees, because recording and motor are started by hand, a third of a second apart (order of magnitude).
- Turntable rotation rate: 1 %, for a motor without an encoder. Half of the variance is constant, and half changes with load and supply
  voltage within a fifth of a revolution (order of magnitude).
- Turntable ripple: 0.5 degrees, twelve times per revolution, caused by the gear (order of magnitude).
- Turntable wobble: 0.2 degrees, which is 0.5 mm at the rim of a disc with 15 cm radius (order of magnitude).
- Placement: 5 mm along x and y, because a tape is read to half a centimetre. The offset from the axis of rotation is 2 mm. The yaw error is
  2 degrees, for an object aligned by eye with a marked direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp


class _Errors:
    """Base class of the sizes of motion errors. `settings` names the lengths and counts that `scaled` does not change."""

    settings: ClassVar[tuple[str, ...]] = ()

    def scaled(self, strength: float) -> Self:
        """Return these motion errors with their sizes multiplied by `strength`; a strength of 0 gives no errors."""
        return replace(self, **{name: strength * value for name, value in self._sizes().items()})  # pyright: ignore[reportArgumentType, reportCallIssue]

    def none(self) -> bool:
        """Return whether the sizes of all motion errors are zero."""
        return not any(self._sizes().values())

    def _sizes(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in self.settings}  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class RoverErrors(_Errors):
    """Sizes of the motion errors of a wheeled platform. Lengths and angles are standard deviations; the ripple is an amplitude.

    Attributes:
        slip: error of the travelled distance relative to the path length. Half of the variance of this error is constant along the path,
            and half has the correlation length slip_length_m.
        slip_length_m: correlation length of the changing part of the slip, in metres.
        start_m: error of the start position along world x and y, in metres.
        heading_deg: error of the heading at the start, in degrees.
        drift_deg_per_m: growth of the heading error along the path, in degrees per metre.
        ripple_m: periodic position error along the path, in metres, with one period per circumference of a wheel with diameter wheel_m.
        wheel_m: wheel diameter in metres.
        bob_m: error of the height in metres, with the correlation length bob_length_m.
        bob_length_m: correlation length of the height error along the path, in metres.
    """

    settings = ("slip_length_m", "wheel_m", "bob_length_m")
    slip: float = 0.015
    slip_length_m: float = 0.3
    start_m: float = 0.01
    heading_deg: float = 0.5
    drift_deg_per_m: float = 0.9
    ripple_m: float = 0.5e-3
    wheel_m: float = 0.08
    bob_m: float = 0.5e-3
    bob_length_m: float = 0.1


@dataclass(frozen=True)
class RailErrors(_Errors):
    """Sizes of the motion errors of a carriage on a rail. Sizes are standard deviations; the ripple is an amplitude.

    Attributes:
        start_m: error of the start position along the rail, in metres.
        stretch: error of the travelled distance relative to the path length.
        ripple_m: periodic position error along the path, in metres, with one period per pulley circumference pulley_m.
        pulley_m: circumference of the drive pulley, in metres.
    """

    settings = ("pulley_m",)
    start_m: float = 2e-3
    stretch: float = 5e-3
    ripple_m: float = 0.1e-3
    pulley_m: float = 0.04


@dataclass(frozen=True)
class TurntableErrors(_Errors):
    """Sizes of the motion errors of a turntable.

    Attributes:
        start_deg: standard deviation of the rotation angle at the start, in degrees.
        rate: relative standard deviation of the rotation rate. Half of the rate's variance is constant, and half changes within rate_turns
            revolutions.
        ripple_deg: amplitude in degrees of a periodic angle error with ripple_cycles periods per revolution.
        wobble_deg: standard deviation of the tilt of the rotation axis about each horizontal direction, in degrees.
        pivot_m: depth of the turntable's bearing below the origin of the object's pose, in metres.
    """

    settings = ("rate_turns", "ripple_cycles", "pivot_m")
    start_deg: float = 5.0
    rate: float = 0.01
    rate_turns: float = 0.2
    ripple_deg: float = 0.5
    ripple_cycles: int = 12
    wobble_deg: float = 0.2
    pivot_m: float = 0.1


@dataclass(frozen=True)
class PlacementErrors(_Errors):
    """Errors of objects placed by hand: standard deviations of x and y, of the offset from the axis of rotation, and of the yaw."""

    offset_m: float = 5e-3
    eccentric_m: float = 2e-3
    yaw_deg: float = 2.0


def at_times(poses: NDArray[np.float64], rate_hz: float, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate nominal poses (F, 4, 4), given at the times f / rate_hz, at other times (T,) in seconds.

    Positions are interpolated linearly between frames, and extrapolated linearly outside the recording. Rotations are interpolated between
    frames, and constant outside the recording.

    >>> step = np.tile(np.eye(4), (2, 1, 1))
    >>> step[1, 0, 3] = 1.0
    >>> at_times(step, 10.0, np.array([0.05, 0.2]))[:, 0, 3].tolist()
    [0.5, 2.0]
    """
    nominal = np.arange(len(poses)) / rate_hz
    if len(poses) == 1 or np.array_equal(nominal, times_s):
        return poses.copy() if len(poses) > 1 else np.repeat(poses, len(times_s), axis=0)
    frame = np.asarray(times_s) * rate_hz
    before = np.clip(np.floor(frame).astype(int), 0, len(poses) - 2)
    share = (frame - before)[:, None]
    out = np.tile(np.eye(4), (len(frame), 1, 1))
    out[:, :3, 3] = (1 - share) * poses[before, :3, 3] + share * poses[before + 1, :3, 3]
    turns = Slerp(np.arange(len(poses)), Rotation.from_matrix(poses[:, :3, :3]))
    out[:, :3, :3] = turns(np.clip(frame, 0, len(poses) - 1)).as_matrix()
    return out


def rover(poses: NDArray[np.float64], errors: RoverErrors, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw the true poses (F, 4, 4) of a wheeled platform on a level floor from its nominal poses (F, 4, 4).

    If the drive returns to its start, the wheels turn backwards on the way back, so that the ripple repeats at the same positions. Slip and
    heading error continue to change along the path.
    """
    steps, gone = np.diff(poses[:, :3, 3], axis=0), poses[:, :3, 3] - poses[0, :3, 3]
    long = np.linalg.norm(steps, axis=1)
    path = np.concatenate([[0.0], np.cumsum(long)])
    sign = np.where(steps @ gone[np.linalg.norm(gone, axis=1).argmax()] < 0, -1.0, 1.0)  # forwards or backwards
    slow = (rng.standard_normal() + wander(path[:-1], errors.slip_length_m, rng)) / np.sqrt(2)
    wheel = np.concatenate([[0.0], np.cumsum(sign * long)])
    wheel_angle = 2 * np.pi * wheel / (np.pi * errors.wheel_m) + rng.uniform(0, 2 * np.pi)
    heading = np.radians(errors.heading_deg * rng.standard_normal() + errors.drift_deg_per_m * rng.standard_normal() * path)
    start = errors.start_m * rng.standard_normal(2)
    bob = errors.bob_m * wander(path, errors.bob_length_m, rng)
    if errors.none():
        return poses.copy()
    ripple = np.divide(sign * errors.ripple_m * np.diff(np.sin(wheel_angle)), long, out=np.zeros_like(long), where=long > 0)
    moved = about_z(heading[:-1]) @ (steps * (1 + errors.slip * slow + ripple)[:, None])[..., None]
    out = poses.copy()
    out[:, :3, :3] = about_z(heading) @ poses[:, :3, :3]
    out[1:, :3, 3] = poses[0, :3, 3] + np.cumsum(moved[..., 0], axis=0)
    out[:, :2, 3] += start
    out[:, 2, 3] += bob
    return out


def rail(poses: NDArray[np.float64], errors: RailErrors, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw the true poses (F, 4, 4) of a carriage on a straight rail from its nominal poses (F, 4, 4)."""
    start, stretch = errors.start_m * rng.standard_normal(), errors.stretch * rng.standard_normal()
    phase = rng.uniform(0, 2 * np.pi)
    if errors.none():
        return poses.copy()
    gone = np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3], axis=1)
    along = (poses[-1, :3, 3] - poses[0, :3, 3]) / max(float(gone[-1]), np.finfo(float).tiny)
    error = start + stretch * gone + errors.ripple_m * (np.sin(2 * np.pi * gone / errors.pulley_m + phase) - np.sin(phase))
    out = poses.copy()
    out[:, :3, 3] += error[:, None] * along
    return out


def turns(poses: NDArray[np.float64]) -> bool:
    """Return whether an object with poses (F, 4, 4) rotates. A moving object that does not rotate is assumed to be on a rail."""
    return bool(np.abs(poses[:, :3, :3] - poses[:1, :3, :3]).max() > 1e-9)


def turntable_angles(nominal_rad: NDArray[np.float64], errors: TurntableErrors, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw the angle errors (F,) in radians of a turntable at its nominal angles (F,) in radians."""
    start, rate = np.radians(errors.start_deg) * rng.standard_normal(), rng.standard_normal()
    phase = rng.uniform(0, 2 * np.pi)
    since = nominal_rad - nominal_rad[:1]
    rate_rng = np.random.default_rng(rng.integers(2**63))  # own generator, so that later draws from `rng` do not depend on the frame count
    excess_rate = wander(np.abs(since), 2 * np.pi * errors.rate_turns, rate_rng)
    steps = np.diff(since, prepend=since[:1])
    excess = errors.rate / np.sqrt(2) * (rate * since + np.cumsum(excess_rate * steps))
    ripple = np.radians(errors.ripple_deg) * (np.sin(errors.ripple_cycles * since + phase) - np.sin(phase))
    return start + excess + ripple


def turntable(poses: NDArray[np.float64], errors: TurntableErrors, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw the true poses (F, 4, 4) of an object on a turntable with a vertical axis from its nominal poses (F, 4, 4)."""
    angle = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    error = turntable_angles(angle, errors, rng)
    tilts = np.radians(errors.wobble_deg) * rng.standard_normal((2, 2))
    if errors.none():
        return poses.copy()
    # The tilt of the stand stays constant, and the tilt of the disc rotates with the disc.
    fixed, turning = (Rotation.from_rotvec([x, y, 0.0]).as_matrix() for x, y in tilts)
    out = poses.copy()
    spun = about_z(error) @ poses[:, :3, :3]
    out[:, :3, :3] = fixed @ spun @ turning
    pivot = np.array([0.0, 0.0, errors.pivot_m])
    out[:, :3, 3] += out[:, :3, :3] @ pivot - pivot
    return out


def placed(motion: Mapping[str, NDArray[np.float64]], errors: PlacementErrors, rng: np.random.Generator) -> dict[str, NDArray[np.float64]]:
    """Draw the true poses (F, 4, 4), by object name, of objects that are placed together by hand.

    All objects get the same offset along x and y. All objects also get the same yaw error, each about its own vertical axis. Rotating
    objects also get an offset from their axis of rotation.
    """
    offset = errors.offset_m * rng.standard_normal(2)
    eccentric = errors.eccentric_m * rng.standard_normal(2)
    yaw = np.radians(errors.yaw_deg) * rng.standard_normal()
    if errors.none():
        return {name: poses.copy() for name, poses in motion.items()}
    out = {}
    for name, poses in motion.items():
        on_it = np.eye(4)
        on_it[:3, :3] = about_z(yaw)
        if turns(poses):
            on_it[:2, 3] = eccentric
        out[name] = poses @ on_it
        out[name][:, :2, 3] += offset
    return out


def wander(path: NDArray[np.float64], length: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw a stationary Ornstein-Uhlenbeck process of unit variance along a path (F,), with the correlation length `length` in the
    unit of the path (metres, seconds or radians). The process keeps its value where the path runs back, as times with jitter may.
    """
    draws = rng.standard_normal(len(path))
    memory = np.exp(-np.maximum(np.diff(path, prepend=path[:1]), 0.0) / length)
    out = draws.copy()
    for i in range(1, len(path)):
        out[i] = memory[i] * out[i - 1] + np.sqrt(1 - memory[i] ** 2) * draws[i]
    return out


def about_z(angle: ArrayLike) -> NDArray[np.float64]:
    """Return the matrices (..., 3, 3) that rotate about the vertical axis by `angle` (...,) in radians."""
    out = np.zeros((*np.shape(angle), 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(angle)
    out[..., 1, 0] = np.sin(angle)
    out[..., 0, 1] = -out[..., 1, 0]
    out[..., 2, 2] = 1.0
    return out
