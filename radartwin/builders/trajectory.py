"""Build the configured trajectory (the poses of sensor and target), and check it against the room and the radar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from radartwin.config.trajectory import (
    FileTrajectory,
    LateralTrajectory,
    LinearTrajectory,
    RailTrajectory,
    StartTrajectory,
    TrajectoryConfig,
    TurntableTrajectory,
)
from radartwin.errors import ConfigError
from radartwin.radar.chirp import Radar
from radartwin.scene import rooms
from radartwin.scene.collision import check_path
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories import trajectory
from radartwin.scene.trajectories.file import read_track
from radartwin.scene.trajectories.track import Track

MAX_FRAMES = 10_000  # 1000 s at 10 Hz; more frames do not fit into memory


@dataclass(frozen=True, eq=False)
class Course:
    """Hold sensor-to-world and target-to-world poses, each of shape (F, 4, 4), or (1, 4, 4) for a body at rest."""

    sensor_poses: np.ndarray
    target_poses: np.ndarray
    motion: str = ""  # as in radartwin/builders/simulator.py; "" if the repeatability of features is unknown for this motion
    angle_rad: np.ndarray | None = None  # (F,) angle of the turntable over exactly one revolution


def build_start(config: StartTrajectory, room: Scene) -> np.ndarray:
    """Return the sensor pose (4, 4) of the first frame: at the configured position, or at the room's measurement bench.

    In a scan, the default position is inside the room, near the end with the smallest x.
    """
    if config.position_m is not None:
        position = np.array(config.position_m)
    elif len(room) and room.provenance.get("room") not in rooms.ROOMS:
        low, high = room.bounds
        position = np.array([low[0] + 0.1 * (high - low)[0], (low + high)[1] / 2, low[2] + config.height_m])
    else:
        position = rooms.bench(room.provenance.get("room", "empty"), config.height_m).sensor_pose[:3, 3]
    heading = np.radians(config.heading_deg)
    pose = trajectory.look_at(position, position + np.array([np.cos(heading), np.sin(heading), 0.0]))
    return pose if config.position_m is None else room.placed(pose, "trajectory.position_m")


def build_course(config: TrajectoryConfig, radar: Radar, room: Scene, place: np.ndarray | None = None) -> Course:
    """Compute the poses of sensor and target at each frame of the radar. Raises UserError, also for more than MAX_FRAMES frames.

    place: (3,) position of the target in the first frame; None puts it on the boresight at the configured distance.
    """
    rate = radar.frame_rate_hz
    if isinstance(config, FileTrajectory):
        track = read_poses(config)
        _check_frames(config.frames or (track.duration_s - config.start_s) * rate)
        sensor = room.placed(track.frames(rate, config.frames, config.start_s), config.path)
        return Course(sensor, _place_target(sensor[0], config.distance_m, place))
    assert isinstance(config, StartTrajectory)
    start = build_start(config, room)
    target = _place_target(start, config.distance_m, place)
    if isinstance(config, TurntableTrajectory):
        return _turntable(config, start, target, rate)
    if isinstance(config, LinearTrajectory):
        return _linear(config, start, target, rate)
    frames = config.frames or 1
    _check_frames(frames)
    return Course(trajectory.static(start, frames), target)


def read_poses(config: FileTrajectory) -> Track:
    """Read the radar's poses from a trajectory file and apply its mounting. Raises MissingError or PoseError."""
    rotation = Rotation.from_euler("xyz", config.mount_deg or (0, 0, 0), degrees=True).as_matrix()
    mount = trajectory.pose(config.mount_m or (0, 0, 0), rotation)
    return read_track(config.path, config.axes, config.topic).mounted(mount)  # type: ignore[arg-type]


def check_course(scene: Scene, radar: Radar, course: Course) -> None:
    """Raise PoseError or SceneError for the first frame in which the sensor leaves the scene's room or enters a surface.

    Warn of speeds beyond the unambiguous Doppler range.
    """
    room = scene.only("room")
    if len(room):
        trajectory.check_height(course.sensor_poses, room.bounds[0, 2], _ceiling_m(room))
    check_path(scene, course.sensor_poses)
    for name, poses in (("the sensor", course.sensor_poses), ("the target", course.target_poses)):
        trajectory.check_speed(poses, radar.frame_rate_hz, radar.max_velocity_mps, name)


def _place_target(sensor_pose: np.ndarray, distance_m: float, place: np.ndarray | None) -> np.ndarray:
    """Return the target pose (1, 4, 4) at `place`, or on the boresight if `place` is None."""
    target = trajectory.static(sensor_pose, 1)
    target[0, :3, 3] = sensor_pose[:3, 3] + distance_m * sensor_pose[:3, 0] if place is None else place
    return target


def _turntable(config: TurntableTrajectory, start: np.ndarray, target: np.ndarray, rate_hz: float) -> Course:
    whole_turn = round(config.period_s * rate_hz)
    frames = config.frames or whole_turn
    _check_frames(frames)
    turning = trajectory.turntable(target[0, :3, 3], frames, rate_hz, config.period_s, np.radians(config.heading_deg))
    if len(turning) < whole_turn:
        return Course(start[None], turning)
    angle = np.arange(frames, dtype=np.float64) * (2 * np.pi / (rate_hz * config.period_s))
    return Course(start[None], turning, "turntable", angle)


def _linear(config: LinearTrajectory, start: np.ndarray, target: np.ndarray, rate_hz: float) -> Course:
    _check_frames(config.length_m / config.speed_mps * rate_hz)
    length, speed, frames = config.length_m, config.speed_mps, slice(config.frames)
    if isinstance(config, RailTrajectory):
        angle = np.radians(config.angle_deg)
        away = np.cos(angle) * start[:3, 0] + np.sin(angle) * start[:3, 1]
        motion = "radial" if abs(config.angle_deg) < 22.5 else "diagonal"
        return Course(start[None], trajectory.sweep(target[0], away, length, speed, rate_hz)[frames], motion)
    sweep = trajectory.lateral_sweep if isinstance(config, LateralTrajectory) else trajectory.depth_sweep
    return Course(sweep(start, length, speed, rate_hz)[frames], target, config.kind)


def _check_frames(frames: float) -> None:
    if frames > MAX_FRAMES:
        raise ConfigError(
            f"the trajectory has more than {MAX_FRAMES} frames; set trajectory.frames; for a rail or a drive, lower trajectory.length_m"
        )


def _ceiling_m(room: Scene) -> float:
    """Return the height of the room's ceiling in metres, or infinity for a scan without a ceiling."""
    top = room.bounds[1, 2]
    footprint = np.prod(np.ptp(room.bounds[:, :2], axis=0))
    meshes = [surface.mesh for surface in room]
    level = [(abs(m.face_normals[:, 2]) > 0.9) & (m.triangles_center[:, 2] > top - 0.5) for m in meshes]
    covered = sum(m.area_faces[at].sum() for m, at in zip(meshes, level, strict=True))
    return float(top) if covered > 0.2 * footprint else np.inf
