"""From where the log says things are to where they are: errors of rover, rail, turntable and placement.

The log holds nominal poses at frame f over the frame rate. Each kind of error is a frozen description with `scaled(strength)`; strength 0
is the identity, to the bit. One generator, one course of errors: the same seed moves the same.

Defaults, chosen before anything was scored. Where no figure of such a rig is published they are orders of magnitude, said as such:
- slip: 1.5 % of the way, one half the same all along (wheel size, load), the other changing over 0.3 m. Uncalibrated odometry of a
  differential drive is off by 2 % of its path, 310 mm in 16 m (J. Borenstein, L. Feng, IEEE Trans. Robotics and Automation 12 (1996) 869,
  from memory); a log that corrects its wheel size keeps the rest. Mecanum wheels slip rather more than less.
- heading: 0.9 degrees a metre, a swerve drive's "1 degree per 45 in" (gwhs/FalconRecharged2021, issue 6), and 0.5 degrees at the start, a
  rover lined up with tape of half a metre to 4 mm.
- start: 1 cm, a wheel put on a mark on the floor by hand.
- ripple: a wheel of 80 mm that is 0.5 mm out of round, one period a turn: order of magnitude for moulded wheels.
- bob: 0.5 mm of height over 0.1 m, rollers of a mecanum wheel and joints of a floor: order of magnitude.
- rail: 2 mm at the start, a carriage set against its stop by hand; 0.5 % of the way, a belt and its pulley; 0.1 mm once a turn of a pulley
  of 40 mm round, which runs out by that much. Orders of magnitude.
- turntable start: 5 degrees, a third of a second between recording and motor, started by hand; rate 1 %, a motor without an encoder, half
  of its variance one for a recording and half changing within a fifth of a turn, as its load and supply do; ripple 0.5 degrees twelve times
  a turn, its gear; wobble 0.2 degrees, 0.5 mm at the rim of a disc of 15 cm radius. Orders of magnitude.
- placement: 5 mm across and along (a tape is read to half a centimetre), 2 mm off the axis of what turns, 2 degrees of yaw (an object
  turned by eye against a mark).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Errors = TypeVar("Errors", bound="RoverErrors | RailErrors | TurntableErrors | PlacementErrors")
_SETTINGS = frozenset(
    {"slip_length_m", "wheel_m", "bob_length_m", "pulley_m", "ripple_cycles", "rate_turns", "pivot_m"}
)  # lengths and counts, not sizes of an error


@dataclass(frozen=True)
class RoverErrors:
    """Of a wheeled platform. Lengths and angles are standard deviations, ripple an amplitude.

    Attributes:
        slip: relative, of the way; it changes over slip_length_m.
        start_m: along x and y of the world; heading_deg: at the start; drift_deg_per_m: of the heading, one for a course.
        ripple_m: along the way, once per circumference of a wheel of diameter wheel_m.
        bob_m: of the height; it changes over bob_length_m.
    """

    slip: float = 0.015
    slip_length_m: float = 0.3
    start_m: float = 0.01
    heading_deg: float = 0.5
    drift_deg_per_m: float = 0.9
    ripple_m: float = 0.5e-3
    wheel_m: float = 0.08
    bob_m: float = 0.5e-3
    bob_length_m: float = 0.1

    def scaled(self, strength: float) -> RoverErrors:
        return _scaled(self, strength)


@dataclass(frozen=True)
class RailErrors:
    """Of a carriage on a rail: standard deviations of its start and, relative, of its way; ripple an amplitude.

    Attributes:
        ripple_m: along the way, once per circumference pulley_m.
    """

    start_m: float = 2e-3
    way: float = 5e-3
    ripple_m: float = 0.1e-3
    pulley_m: float = 0.04

    def scaled(self, strength: float) -> RailErrors:
        return _scaled(self, strength)


@dataclass(frozen=True)
class TurntableErrors:
    """Of a turntable.

    Attributes:
        start_deg, rate: standard deviations of the angle at the start and, relative, of the speed, which changes over rate_turns.
        ripple_deg: amplitude of what is periodic, ripple_cycles times a turn.
        wobble_deg: standard deviation of the tilt of the axis, about each level direction; pivot_m: of the bearing below the pose's origin.
    """

    start_deg: float = 5.0
    rate: float = 0.01
    rate_turns: float = 0.2
    ripple_deg: float = 0.5
    ripple_cycles: int = 12
    wobble_deg: float = 0.2
    pivot_m: float = 0.1

    def scaled(self, strength: float) -> TurntableErrors:
        return _scaled(self, strength)


@dataclass(frozen=True)
class PlacementErrors:
    """Of what was put somewhere by hand: standard deviations along x and y, off its axis of rotation, and of its yaw."""

    offset_m: float = 5e-3
    eccentric_m: float = 2e-3
    yaw_deg: float = 2.0

    def scaled(self, strength: float) -> PlacementErrors:
        return _scaled(self, strength)


def at_times(poses: NDArray[np.float64], rate_hz: float, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nominal poses (F, 4, 4) of frames f/rate at other times: straight on between frames and beyond the ends, turning between frames.

    >>> step = np.tile(np.eye(4), (2, 1, 1))
    >>> step[1, 0, 3] = 1.0
    >>> at_times(step, 10.0, np.array([0.05, 0.2]))[:, 0, 3].tolist()
    [0.5, 2.0]
    """
    from scipy.spatial.transform import Rotation, Slerp

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
    """Where a platform that should be at `poses` (F, 4, 4) is; it drives on a level floor."""
    steps = np.diff(poses[:, :3, 3], axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    slow = (rng.standard_normal() + _wander(way[:-1], errors.slip_length_m, rng)) / np.sqrt(2)
    turn = 2 * np.pi * way / (np.pi * errors.wheel_m) + rng.uniform(0, 2 * np.pi)
    heading = np.radians(errors.heading_deg * rng.standard_normal() + errors.drift_deg_per_m * rng.standard_normal() * way)
    start = errors.start_m * rng.standard_normal(2)
    bob = errors.bob_m * _wander(way, errors.bob_length_m, rng)
    if _none(errors):
        return poses.copy()
    long = np.linalg.norm(steps, axis=1)
    ripple = np.divide(errors.ripple_m * np.diff(np.sin(turn)), long, out=np.zeros_like(long), where=long > 0)
    moved = _about_z(heading[:-1]) @ (steps * (1 + errors.slip * slow + ripple)[:, None])[..., None]
    out = poses.copy()
    out[:, :3, :3] = _about_z(heading) @ poses[:, :3, :3]
    out[1:, :3, 3] = poses[0, :3, 3] + np.cumsum(moved[..., 0], axis=0)
    out[:, :2, 3] += start
    out[:, 2, 3] += bob
    return out


def rail(poses: NDArray[np.float64], errors: RailErrors, rng: np.random.Generator) -> NDArray[np.float64]:
    """Where a carriage that should be at `poses` (F, 4, 4), on a straight line, is."""
    start, way = errors.start_m * rng.standard_normal(), errors.way * rng.standard_normal()
    phase = rng.uniform(0, 2 * np.pi)
    if _none(errors):
        return poses.copy()
    gone = np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3], axis=1)
    along = (poses[-1, :3, 3] - poses[0, :3, 3]) / max(float(gone[-1]), np.finfo(float).tiny)
    more = start + way * gone + errors.ripple_m * (np.sin(2 * np.pi * gone / errors.pulley_m + phase) - np.sin(phase))
    out = poses.copy()
    out[:, :3, 3] += more[:, None] * along
    return out


def turns(poses: NDArray[np.float64]) -> bool:
    """Whether what takes these poses (F, 4, 4) turns; what does not, and moves, is carried along a rail."""
    return bool(np.abs(poses[:, :3, :3] - poses[:1, :3, :3]).max() > 1e-9)


def turntable_angles(nominal_rad: NDArray[np.float64], errors: TurntableErrors, rng: np.random.Generator) -> NDArray[np.float64]:
    """What a table that should stand at these angles has turned too far, radians, shape (F,)."""
    start, rate = np.radians(errors.start_deg) * rng.standard_normal(), rng.standard_normal()
    phase = rng.uniform(0, 2 * np.pi)
    since = nominal_rad - nominal_rad[:1]
    own = np.random.default_rng(rng.integers(2**63))  # however long the course, what is drawn next is the same
    wander = _wander(np.abs(since), 2 * np.pi * errors.rate_turns, own)
    steps = np.diff(since, prepend=since[:1])
    too_far = errors.rate / np.sqrt(2) * (rate * since + np.cumsum(wander * steps))
    ripple = np.radians(errors.ripple_deg) * (np.sin(errors.ripple_cycles * since + phase) - np.sin(phase))
    return start + too_far + ripple


def turntable(poses: NDArray[np.float64], errors: TurntableErrors, rng: np.random.Generator) -> NDArray[np.float64]:
    """Where what turns with a table about the vertical, and should be at `poses` (F, 4, 4), is."""
    angle = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    more = turntable_angles(angle, errors, rng)
    tilts = np.radians(errors.wobble_deg) * rng.standard_normal((2, 2))
    if _none(errors):
        return poses.copy()
    fixed, turning = (_tilt(x, y) for x, y in tilts)  # of the stand, and of the disc on its bearing
    out = poses.copy()
    spun = _about_z(more) @ poses[:, :3, :3]
    out[:, :3, :3] = fixed @ spun @ turning
    pivot = np.array([0.0, 0.0, errors.pivot_m])
    out[:, :3, 3] += out[:, :3, :3] @ pivot - pivot
    return out


def placed(motion: Mapping[str, NDArray[np.float64]], errors: PlacementErrors, rng: np.random.Generator) -> dict[str, NDArray[np.float64]]:
    """Everything that stands together, off by the same: poses (F, 4, 4) by name, each by the yaw on its own axis. What turns is also
    off the axis it turns about."""
    offset = errors.offset_m * rng.standard_normal(2)
    eccentric = errors.eccentric_m * rng.standard_normal(2)
    yaw = np.radians(errors.yaw_deg) * rng.standard_normal()
    if _none(errors):
        return {name: poses.copy() for name, poses in motion.items()}
    out = {}
    for name, poses in motion.items():
        on_it = np.eye(4)
        on_it[:3, :3] = _about_z(np.array(yaw))
        if turns(poses):
            on_it[:2, 3] = eccentric
        out[name] = poses @ on_it
        out[name][:, :2, 3] += offset
    return out


def _scaled(errors: Errors, strength: float) -> Errors:
    """The same errors at another strength."""
    return replace(errors, **{name: strength * value for name, value in _sizes(errors).items()})


def _none(errors: Any) -> bool:
    return not any(_sizes(errors).values())


def _sizes(errors: Any) -> dict[str, float]:
    return {f.name: getattr(errors, f.name) for f in fields(errors) if f.name not in _SETTINGS}


def _wander(way: NDArray[np.float64], length_m: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """A stationary random course of unit variance along the way (an Ornstein-Uhlenbeck process of that correlation length)."""
    draws = rng.standard_normal(len(way))
    kept = np.exp(-np.diff(way, prepend=way[:1]) / length_m)
    out = draws.copy()
    for i in range(1, len(way)):
        out[i] = kept[i] * out[i - 1] + np.sqrt(1 - kept[i] ** 2) * draws[i]
    return out


def _about_z(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations (..., 3, 3) about the vertical."""
    out = np.zeros((*np.shape(angle), 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(angle)
    out[..., 1, 0] = np.sin(angle)
    out[..., 0, 1] = -out[..., 1, 0]
    out[..., 2, 2] = 1.0
    return out


def _tilt(about_x: float, about_y: float) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec([about_x, about_y, 0.0]).as_matrix()
