"""Configuration of the trajectory."""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.config.checks import finite, one_of, path_field, positive
from radartwin.errors import ConfigError


@dataclass
class TrajectoryConfig:
    """How sensor and target move. Distances are from the radar to the target's axis."""

    kind: str = "turntable"  # static | turntable | rail | depth | lateral | file
    position_m: list[float] | None = None  # of the radar at the start; null: the bench, or inside a scan's low-x end
    heading_deg: float = 0.0  # of its boresight, from +x to the left
    distance_m: float = 1.0  # at the start
    height_m: float = 1.0  # of the radar above the floor, where position_m does not say
    frames: int | None = None  # null: the whole sweep or revolution
    period_s: float = 25.0  # turntable: one revolution
    length_m: float = 1.0  # rail, depth and lateral: travelled
    speed_mps: float = 0.2
    angle_deg: float = 0.0  # rail: where the target goes, from away from the radar (0, radial) to the radar's left (90)
    # file: the radar's poses in the world
    path: str | None = path_field()  # TUM or CSV text, or a ROS bag
    start_s: float = 0.0  # of the first frame, after the first pose
    axes: str = "sensor"  # of the poses: sensor (x forward, z up) | optical (z forward, y down)
    topic: str | None = None  # of a ROS bag
    frame: str | None = None  # of a ROS bag's transforms
    mount_m: list[float] | None = None  # where the radar sits on what the poses are of: x, y, z
    mount_deg: list[float] | None = None  # ... and how it is turned: roll, pitch, yaw

    def __post_init__(self) -> None:
        one_of("trajectory.kind", self.kind, ("static", "turntable", "rail", "depth", "lateral", "file"))
        one_of("trajectory.axes", self.axes, ("sensor", "optical"))
        for name in ("distance_m", "height_m", "frames", "period_s", "length_m", "speed_mps"):
            positive(f"trajectory.{name}", getattr(self, name))
        for name in ("heading_deg", "angle_deg", "start_s"):
            finite(f"trajectory.{name}", getattr(self, name))
        self._check_file()
        finite("trajectory.position_m", *(self.position_m or ()))
        if self.position_m is not None and len(self.position_m) != 3:
            raise ConfigError(f"trajectory.position_m={self.position_m} must be [x,y,z] in metres")
        if self.kind == "depth" and self.length_m >= self.distance_m:
            reach = f"trajectory.length_m={self.length_m:g} runs into the target"
            raise ConfigError(f"{reach} at trajectory.distance_m={self.distance_m:g}; shorten one or lengthen the other")

    def _check_file(self) -> None:
        """The fields that only trajectory=file reads."""
        for name in ("mount_m", "mount_deg"):
            value = getattr(self, name)
            if value is not None and len(value) != 3:
                raise ConfigError(f"trajectory.{name}={value} must be three numbers")
            finite(f"trajectory.{name}", *(value or ()))
        if self.kind == "file":
            if not self.path:
                raise ConfigError("trajectory=file needs the file: add trajectory.path=FILE")
            if self.position_m is not None:
                raise ConfigError(f"trajectory.position_m={self.position_m} is not read by trajectory=file, which has its own")
            if self.start_s < 0:
                raise ConfigError(f"trajectory.start_s={self.start_s:g} must be zero or above")
            return
        for name in ("path", "topic", "frame", "mount_m", "mount_deg"):
            if getattr(self, name):
                raise ConfigError(f"trajectory.{name} is only read by trajectory=file; add trajectory=file")
