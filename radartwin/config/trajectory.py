"""Configuration of the trajectory: how radar and target move, one dataclass for each motion."""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.config.checked_fields import Checked, choice, finite, not_negative, path_name, positive, triple
from radartwin.errors import ConfigError


@dataclass
class TrajectoryConfig(Checked):
    """Settings that every kind of motion reads."""

    KEY, SELECTOR = "trajectory", "kind"
    kind: str = ""
    distance_m: float = positive(1.0)  # distance from the radar to the target's vertical axis at the start, in metres
    height_m: float = positive(1.0)  # height of the radar above the floor, used if neither position_m nor a pose file gives it
    frames: int | None = positive(None)  # number of simulated frames; null simulates all frames of the motion


@dataclass
class StartTrajectory(TrajectoryConfig):
    """Base class of the motions in which the radar starts at a configured pose."""

    # radar position; null: the room's measurement bench, or in a scan a position inside the room, near the end with the smallest x
    position_m: list[float] | None = triple("[x,y,z] in metres")
    heading_deg: float = finite(0.0)  # direction of the radar's boresight, degrees counted from +x to the left


@dataclass
class StaticTrajectory(StartTrajectory):
    """The motion option in which radar and target are at rest."""

    kind: str = "static"
    frames: int | None = positive(4)


@dataclass
class TurntableTrajectory(StartTrajectory):
    """The motion option in which the radar is at rest and the target rotates about its vertical axis."""

    kind: str = "turntable"
    period_s: float = positive(25.0)  # duration of one turntable revolution, in seconds


@dataclass
class LinearTrajectory(StartTrajectory):
    """Base class of the motions along a straight line, of the radar or of the target."""

    length_m: float = positive(1.0)
    speed_mps: float = positive(0.2)


@dataclass
class RailTrajectory(LinearTrajectory):
    """The motion option in which the radar is at rest and a rail carries the target."""

    kind: str = "rail"
    length_m: float = positive(0.6)
    speed_mps: float = positive(0.1)
    angle_deg: float = finite(0.0)  # direction of the target's motion: 0 away from the radar (radial), 90 to the radar's left


@dataclass
class LateralTrajectory(LinearTrajectory):
    """The motion option in which the radar drives past the target, at right angles to the line of sight."""

    kind: str = "lateral"
    height_m: float = positive(0.4)
    length_m: float = positive(1.2)
    speed_mps: float = positive(0.24)


@dataclass
class DepthTrajectory(LinearTrajectory):
    """The motion option in which the radar drives towards the target."""

    kind: str = "depth"
    distance_m: float = positive(2.0)
    height_m: float = positive(0.4)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length_m >= self.distance_m:
            collision = f"trajectory.length_m={self.length_m:g} runs into the target"
            raise ConfigError(f"{collision} at trajectory.distance_m={self.distance_m:g}; lower length_m or raise distance_m")


@dataclass
class FileTrajectory(TrajectoryConfig):
    """The motion option in which a file gives the poses of the radar."""

    kind: str = "file"
    path: str = path_name("trajectory=file needs the file: add trajectory.path=FILE")  # TUM text, CSV text, or a ROS bag
    start_s: float = not_negative(0.0)  # time from the first pose in the file to the first simulated frame, in seconds
    axes: str = choice("sensor", "optical")  # axes of the poses in the file: sensor (x forward, z up) | optical (z forward, y down)
    topic: str | None = None  # ROS topic that contains the poses in a ROS bag
    mount_m: list[float] | None = triple("three numbers")  # radar position [x,y,z] in the coordinate frame of the file's poses, metres
    mount_deg: list[float] | None = triple("three numbers")  # roll, pitch and yaw of the radar in the frame of the file's poses
