"""The cases of a measurement campaign (object, room, motion, distance, repetition), and the nominal motion (log) of each recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from radartwin.errors import ConfigError
from radartwin.scene import rooms
from radartwin.scene.objects.assortment import every_object
from radartwin.scene.objects.catalogue import catalogue
from radartwin.scene.trajectories import trajectory

if TYPE_CHECKING:
    from radartwin.config.study import CampaignConfig

MEASURED, TWIN, VOID = "measured", "twin", "void"
DOMAINS = (MEASURED, TWIN, VOID)
COMPARED = (MEASURED, TWIN)
LABELS = {MEASURED: "measured", TWIN: "simulated"}  # names of measurement and simulation in tables and figures

Motion = Literal["turntable", "radial", "diagonal", "depth", "lateral"]
RAIL: tuple[Motion, ...] = ("radial", "diagonal")  # the target moves along a rail
ROVER: tuple[Motion, ...] = ("depth", "lateral")  # the radar moves on a rover
REFLECTOR = "corner_reflector"
BENCH_ROOM = "lab"  # room of the turntable and the rail
RATE_HZ = 10.0
TURN_S = 25.0  # time of one turntable revolution in seconds
BENCH_HEIGHT_M = 1.0  # height of the radar in front of the lab's bench
SPEED_MPS = 0.2
RAIL_M, RAIL_START_M = 0.6, 1.0
# Length of a depth drive in one direction: 24 steps of 2 cm at 10 frames per second. If only every second, third or fourth frame is kept,
# the recording still contains the frames at the smallest distance and at the end. The drives towards the target and back have together
# about the length (1 m) and the number of frames (about 50) of the paper's sweep.
DEPTH_M = 0.48
LATERAL_M, LATERAL_MPS = 1.2, 0.24
_TRAVEL = {  # length in metres, speed in metres per second
    **dict.fromkeys(RAIL, (RAIL_M, SPEED_MPS)), "depth": (2 * DEPTH_M, SPEED_MPS), "lateral": (LATERAL_M, LATERAL_MPS),
}  # fmt: skip
FACING = np.diag([-1.0, -1.0, 1.0])  # turns an object so that its own +x axis points to the radar


@dataclass(frozen=True, order=True)
class Case:
    """One recording of the measurement campaign, identified by object, room, motion, distance, repetition and draw.

    A draw of a virtual campaign is one sample of everything that the testbed chooses at random: the objects as made, the true room, the
    radar board, the courses and the noise. Repetitions of one draw differ in placement, course and noise only.
    """

    object: str
    room: str
    motion: Motion
    distance_m: float  # from the radar to the target's axis: at the start, or for a drive of the rover the smallest distance
    repetition: int = 0
    draw: int = 0

    @property
    def name(self) -> str:
        return f"{self.room}-{self.motion}-{self.object}-{self.distance_m:g}m-{self.repetition}" + (f"-{self.draw}" if self.draw else "")

    @property
    def condition(self) -> Case:
        """The case without repetition and draw. All recordings of one condition are compared with the same simulation."""
        return replace(self, repetition=0, draw=0)


@dataclass(frozen=True, eq=False)
class Log:
    """The nominal (logged) motion of a recording, which the simulation follows exactly and the measurement does not."""

    frame_rate_hz: float
    sensor_poses: np.ndarray  # (F, 4, 4) or (1, 4, 4), radar to world
    target_poses: np.ndarray  # (F, 4, 4) or (1, 4, 4), object to world
    angle_rad: np.ndarray | None = None  # (F,) angle of the turntable, or None without a turntable

    @property
    def frames(self) -> int:
        return max(len(self.sensor_poses), len(self.target_poses))

    @property
    def distance_m(self) -> np.ndarray:
        """Horizontal distance (F,) in metres from the radar to the target's axis in each frame."""
        away = np.linalg.norm(self.target_poses[:, :2, 3] - self.sensor_poses[:, :2, 3], axis=1)
        return np.repeat(away, self.frames) if len(away) == 1 else away


def planned(config: CampaignConfig, measured: bool) -> list[Case]:
    """List all recordings of a virtual campaign; only the measured ones have repetitions and draws. Raises ConfigError for an object."""
    known, usual = every_object(), catalogue()
    for kind in ("turntable_objects", "rail_objects", "rover_objects"):
        for name in getattr(config, kind):
            if name not in known:
                raise ConfigError(f"{config.KEY}.{kind}: unknown object {name!r}; choose {', '.join(known)}")
    cases = []
    for name in config.turntable_objects or list(usual):
        distances = config.reflector_distances_m if name == REFLECTOR else config.turntable_distances_m
        cases += [Case(name, config.turntable_room, "turntable", d) for d in distances]
    for name in config.rail_objects:
        cases += [Case(name, BENCH_ROOM, motion, RAIL_START_M) for motion in RAIL]
    for room in config.rover_rooms:
        for motion in ROVER:
            for distance in config.rover_distances_m:
                for name in config.rover_objects or [entry.name for entry in usual.values() if entry.rover]:
                    cases.append(Case(name, room, motion, distance))
    if not measured:
        return cases

    def repeats(case: Case) -> int:
        if case.motion == "turntable":
            return config.reflector_repeats if case.object == REFLECTOR else 1
        return config.rail_repeats if case.motion in RAIL else config.rover_repeats

    return [
        replace(case, repetition=number, draw=draw)
        for case in cases for draw in draws(config, case.motion in ROVER) for number in range(repeats(case))
    ]  # fmt: skip


def draws(config: CampaignConfig, rover: bool) -> range:
    """Return the numbers of the draws of a virtual campaign's drives (`rover`), or of its turntable and rail recordings."""
    return range(config.first_draw, config.first_draw + (config.rover_draws if rover else config.draws))


def log(case: Case, config: CampaignConfig, measured: bool) -> Log:
    """Return the log of a planned recording. If `measured` is false, the turntable makes exactly one revolution."""
    if case.motion == "turntable":
        return course(case, config.frames_per_turn / TURN_S, config.frames_per_turn * (config.turns if measured else 1))
    every = config.rover_every if case.motion in ROVER else config.rail_every
    length, speed = _TRAVEL[case.motion]
    whole = int(np.floor(length * RATE_HZ / speed + 1e-9))  # number of frames as in trajectory.sweep
    whole += case.motion == "depth"  # a depth drive ends at its start
    return course(case, RATE_HZ / every, len(range(0, whole, every)))


def course(case: Case, rate_hz: float, frames: int, turn_s: float = TURN_S, driven: np.ndarray | None = None) -> Log:
    """Return the log of a recording of `frames` frames, with `turn_s` seconds per turntable revolution. All is at rest after the nominal
    travel.

    `driven` are (F, 4, 4) recorded poses of the rover's radar in any world frame; None stands for a straight drive at the nominal speed. A
    recorded lateral drive is moved to the nominal start. A recorded depth drive is moved along the line of sight until its smallest
    distance is that of the case, so that the drive may start at either end.
    """
    known = every_object().get(case.object)
    aim = np.array([0.0, 0.0, known.aim_m if known else 0.0])
    if case.motion in ROVER:
        bench = rooms.bench(case.room)
        start, direction = _rover_start(case.motion, bench.sensor_pose)
        poses = _straight(start, direction, case.motion, rate_hz, frames)
        if driven is not None:
            moved = np.linalg.inv(driven[0]) @ driven
            if case.motion == "depth":
                start = trajectory.at_distances(bench.sensor_pose, -direction, moved[:, 0, 3].max(keepdims=True))[0]
            poses = start @ moved
        return Log(rate_hz, poses, trajectory.pose(bench.target_position(case.distance_m) - aim, FACING)[None])
    bench = rooms.lab_bench(BENCH_HEIGHT_M)
    at, sensor = bench.target_position(case.distance_m) - aim, bench.sensor_pose[None]
    if case.motion == "turntable":
        angle = 2 * np.pi * np.arange(frames) / (rate_hz * turn_s)
        return Log(rate_hz, sensor, trajectory.turntable(at, frames, rate_hz, turn_s, np.pi), angle)
    angle = np.radians(45.0 if case.motion == "diagonal" else 0.0)
    direction = sensor[0, :3, 0] * np.cos(angle) + sensor[0, :3, 1] * np.sin(angle)
    return Log(rate_hz, sensor, _straight(trajectory.pose(at, FACING), direction, case.motion, rate_hz, frames))


def _rover_start(motion: Motion, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (start pose, unit direction) of a drive. A "depth" drive goes towards the target to the pose `middle`, and back again."""
    if motion == "lateral":
        return trajectory.lateral_sweep(middle, LATERAL_M, LATERAL_MPS, RATE_HZ)[0], middle[:3, 1]
    return trajectory.at_distances(middle, middle[:3, 0], np.array([-DEPTH_M]))[0], middle[:3, 0]


def _straight(start: np.ndarray, direction: np.ndarray, motion: Motion, rate_hz: float, frames: int) -> np.ndarray:
    """Return the poses (F, 4, 4) of a drive or a rail's carriage, at rest after the end of its travel. A "depth" drive reverses halfway."""
    length, speed = _TRAVEL[motion]
    step = speed / rate_hz
    travelled = step * np.minimum(np.arange(frames), np.floor(length / step + 1e-9))
    return trajectory.at_distances(start, direction, np.minimum(travelled, length - travelled) if motion == "depth" else travelled)


def stand_top(nominal: Log) -> np.ndarray:
    """Return the centre (3,) in metres of the top of the target's stand at the start of a recording, just below the object."""
    return nominal.target_poses[0, :3, 3] - [0, 0, rooms.GAP]
