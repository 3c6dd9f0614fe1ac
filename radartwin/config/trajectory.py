"""Configuration of the trajectory: how radar and target move, one dataclass for each motion."""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.config.checks import check_fields, check_selector, choice, finite, not_negative, path_name, positive, triple
from radartwin.errors import ConfigError


@dataclass
class TrajectoryConfig:
    """Settings that every trajectory reads."""

    kind: str = ""
    distance_m: float = positive(1.0)  # from the radar to the target's axis at the start
    height_m: float = positive(1.0)  # radar above the floor; used if neither position_m nor a file gives the height
    frames: int | None = positive(None)  # number of frames; null: all frames of the motion

    def __post_init__(self) -> None:
        check_selector("trajectory.kind", self.kind, type(self).kind)
        check_fields(self, "trajectory")


@dataclass
class StartTrajectory(TrajectoryConfig):
    """Base class of the motions that begin at a configured pose of the radar."""

    position_m: list[float] | None = triple("[x,y,z] in metres")  # null: the room's bench, or inside a scan's low-x end
    heading_deg: float = finite(0.0)  # direction of the radar's boresight, counted from +x to the left


@dataclass
class StaticTrajectory(StartTrajectory):
    """Radar and target at rest."""

    kind: str = "static"
    frames: int | None = positive(4)


@dataclass
class TurntableTrajectory(StartTrajectory):
    """Radar at rest, target turning about its vertical axis."""

    kind: str = "turntable"
    period_s: float = positive(25.0)  # duration of one revolution


@dataclass
class LinearTrajectory(StartTrajectory):
    """Base class of the motions along a straight line."""

    length_m: float = positive(1.0)
    speed_mps: float = positive(0.2)


@dataclass
class RailTrajectory(LinearTrajectory):
    """Radar at rest, target carried along a rail."""

    kind: str = "rail"
    length_m: float = positive(0.6)
    speed_mps: float = positive(0.1)
    angle_deg: float = finite(0.0)  # direction of the motion: 0 away from the radar (radial), 90 to the radar's left


@dataclass
class LateralTrajectory(LinearTrajectory):
    """Radar driving past the target."""

    kind: str = "lateral"
    height_m: float = positive(0.4)
    length_m: float = positive(1.2)
    speed_mps: float = positive(0.24)


@dataclass
class DepthTrajectory(LinearTrajectory):
    """Radar driving towards the target."""

    kind: str = "depth"
    distance_m: float = positive(2.0)
    height_m: float = positive(0.4)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length_m >= self.distance_m:
            collision = f"trajectory.length_m={self.length_m:g} runs into the target"
            raise ConfigError(f"{collision} at trajectory.distance_m={self.distance_m:g}; shorten one or lengthen the other")


@dataclass
class FileTrajectory(TrajectoryConfig):
    """Poses of the radar from a file."""

    kind: str = "file"
    path: str = path_name("")  # TUM or CSV text, or a ROS bag
    start_s: float = not_negative(0.0)  # time from the first pose in the file to the first frame
    axes: str = choice("sensor", "optical")  # axes of the poses: sensor (x forward, z up) | optical (z forward, y down)
    topic: str | None = None  # topic of a ROS bag with the poses
    frame: str | None = None  # coordinate frame to follow in the transforms of a ROS bag
    mount_m: list[float] | None = triple("three numbers")  # position of the radar in the coordinate frame of the poses
    mount_deg: list[float] | None = triple("three numbers")  # roll, pitch and yaw of the radar in this frame

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.path:
            raise ConfigError("trajectory=file needs the file: add trajectory.path=FILE")
