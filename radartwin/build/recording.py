"""From a configuration to the things it describes: radar, scene, trajectory; and, with all three, a recording.

The only place that knows both the configuration and the library behind it. World frame as in radartwin/scene/rooms;
unless it is placed, the target stands on the radar's boresight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.build.course import check_course, furnished, read_course
from radartwin.build.radar import build_radar
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.config.materials import MATERIALS_FIELDS, MaterialsConfig
from radartwin.config.scene import ROOMS, SceneConfig
from radartwin.config.simulator import SIMULATOR_FIELDS, SimulatorConfig
from radartwin.config.trajectory import TrajectoryConfig
from radartwin.errors import ConfigError
from radartwin.radar.chirp import Radar

if TYPE_CHECKING:
    from radartwin.adaptive.probe import Probe
    from radartwin.label.labelling import Wishes
    from radartwin.radar.recording import Recording
    from radartwin.scene.scene import Scene, Surface
    from radartwin.store.products import Store

TARGET = "target"  # the name of the surface under test
MAX_FRAMES = 10_000  # a thousand seconds at 10 Hz; beyond it the recording outgrows memory


@dataclass(frozen=True)
class Course:
    """Where sensor and target are: sensor poses (F, 4, 4) or (1, 4, 4), target poses (F, 4, 4) or (1, 4, 4)."""

    sensor_poses: np.ndarray
    target_poses: np.ndarray


def named_radar(name: str) -> Radar:
    """The radar of a file, or of an option of the radar group such as "openradar_77ghz"."""
    if Path(name).suffix or Path(name).exists():
        return Radar.from_file(name)
    return build_radar(compose([f"radar={name}"]).radar)


def build_target(config: SceneConfig) -> tuple[Surface, ...]:
    """The target's surfaces, all named TARGET, about the point the radar aims at, facing -x, towards the radar; none for no target."""
    from radartwin.scene import objects
    from radartwin.scene.scene import Surface

    size = config.target_size_m
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    if config.target == "none":
        return ()
    if config.target == "corner_reflector":
        mesh = objects.trihedral(size)
    elif config.target == "plate":
        mesh = objects.plate(size, size)
    elif config.target == "sphere":
        mesh = objects.sphere(size / 2)
    else:
        entry = objects.entry(config.target)
        turned[2, 3] = -entry.aim_m
        return entry.surfaces(turned, name=TARGET)
    return (Surface(mesh.apply_transform(turned), "metal", TARGET, role="object"),)


def stands_at(target: Sequence[Surface]) -> float:
    """Height of the target's lowest point over the point the radar aims at, metres: negative."""
    return min((float(surface.mesh.bounds[0, 2]) for surface in target), default=0.0)


def build_room(scene: SceneConfig, materials: MaterialsConfig, seed: int = 0) -> Scene:
    """What surrounds the target, its materials by the configured source; the target is not in it."""
    from radartwin.label.sources import material_source
    from radartwin.scene import rooms

    if scene.name in ROOMS:
        room = rooms.room(scene.name, **scene.room_options())
    elif scene.name == "scan":
        assert scene.path is not None
        room = load_scan(Path(scene.path), materials)
    else:
        return rooms.void() if scene.name == "void" else rooms.empty()
    return material_source(materials.source, **materials.options(seed))(room)


def load_scan(path: Path, materials: MaterialsConfig) -> Scene:
    """A scene folder with its labels; or a mesh, which has none, with what the configured source puts on it.

    Raises:
        ConfigError: a mesh whose labels are asked for; MissingError, MeshError, SceneError: see `Scene.load`.
    """
    from radartwin.scene.scene import Scene
    from radartwin.scene.storage import scene_folder

    if not path.exists() or scene_folder(path) is not None:
        return Scene.load(path)
    if materials.source == "scene":
        raise ConfigError(
            f"{path} carries no material labels; make it a scene with radartwin reconstruct {path} --out FOLDER, "
            "or add materials=uniform materials.material=NAME for one material"
        )
    return Scene.load(path, material=materials.material or "plasterboard")


def label_wishes(options: Mapping[str, Any]) -> Wishes:
    """What `radartwin label` is asked for: given options, else what conf/materials/vlm.yaml says, else the defaults.

    Raises:
        ConfigError: a value out of range.
    """
    from radartwin.label.labelling import Wishes

    given = {name: value for name, value in options.items() if value is not None}
    config = replace(
        compose(["materials=vlm"]).materials, **{n: v for n, v in given.items() if n in MATERIALS_FIELDS["vlm"] and n != "missing"}
    )
    asking = {name: config.value(name) for name in ("provider", "model", "url", "timeout_s", "concurrency", "views")}
    return Wishes(**asking, **{name: given[name] for name in ("export", "answers", "missing") if name in given})


def build_start(config: TrajectoryConfig, room: Scene) -> np.ndarray:
    """Sensor pose (4, 4) of the first frame: as configured, else the room's bench, or just inside a scan's low-x end."""
    from radartwin.scene import rooms
    from radartwin.scene.trajectories import trajectory

    if config.position_m is not None:
        position = np.array(config.position_m)
    elif len(room) and room.provenance.get("room") not in rooms.ROOMS:
        low, high = room.bounds
        position = np.array([low[0] + 0.1 * (high - low)[0], (low + high)[1] / 2, low[2] + config.height_m])
    else:
        position = rooms.bench(room.provenance.get("room", "empty"), config.height_m).sensor_pose[:3, 3]
    heading = np.radians(config.heading_deg)
    return trajectory.look_at(position, position + np.array([np.cos(heading), np.sin(heading), 0.0]))


def build_course(config: TrajectoryConfig, radar: Radar, start: np.ndarray, place: np.ndarray | None = None) -> Course:
    """Poses of sensor and target over the frames of the trajectory that begins at `start`, or where its file does.

    Args:
        place: (3,) where the target is; None: on the boresight of `start`.
    """
    from radartwin.scene.trajectories import trajectory

    rate = radar.frame_rate_hz
    sensor = start[None]
    if config.kind == "file":
        track = read_course(config)
        check_frames(config.frames or (track.duration_s - config.start_s) * rate)
        sensor = track.frames(rate, config.frames, config.start_s)
    target = trajectory.static(sensor[0], 1)
    target[0, :3, 3] = sensor[0, :3, 3] + config.distance_m * sensor[0, :3, 0] if place is None else place
    if config.kind == "file":
        return Course(sensor, target)
    if config.kind == "turntable":
        frames = config.frames or round(config.period_s * rate)
        check_frames(frames)
        turning = trajectory.turntable(target[0, :3, 3], frames, rate, config.period_s, np.radians(config.heading_deg))
        return Course(start[None], turning)
    if config.kind == "static":
        frames = config.frames or 1
        check_frames(frames)
        return Course(trajectory.static(start, frames), target)
    check_frames(config.length_m / config.speed_mps * rate)
    if config.kind == "rail":
        angle = np.radians(config.angle_deg)
        away = np.cos(angle) * start[:3, 0] + np.sin(angle) * start[:3, 1]
        carried = trajectory.sweep(target[0], away, config.length_m, config.speed_mps, rate)
        return Course(start[None], carried[: config.frames])
    sweep = trajectory.depth_sweep if config.kind == "depth" else trajectory.lateral_sweep
    return Course(sweep(start, config.length_m, config.speed_mps, rate)[: config.frames], target)


def check_frames(frames: float) -> None:
    if frames > MAX_FRAMES:
        raise ConfigError(f"the trajectory has more than {MAX_FRAMES} frames; set trajectory.frames")


def simulator_options(config: SimulatorConfig) -> dict[str, Any]:
    """The configured simulator, and how its paths become signal, as options of `radartwin.simulate`.

    Raises:
        InputError: settings that exclude one another.
    """
    from radartwin.simulation.backends.backend import backend, settings_of

    chosen = {name: getattr(config, name) for name in SIMULATOR_FIELDS[config.backend] if name != "parts"}  # which are the scene's
    if "variant" in settings_of(config.backend):
        chosen["variant"] = config.variant
    return {"simulator": backend(config.backend, **chosen), "elements": config.elements}


def simulate_scene(
    config: Config, noise: bool = False, store: Store | None = None, say: Callable[[str], None] = lambda line: None
) -> Recording:
    """The recording of a composed configuration: its scene seen by its radar along its trajectory.

    Its provenance says which scene that was, and what its room was made of.

    Args:
        store, say: where simulator=auto keeps its choices, and what receives them; without, it chooses anew and silently.
    """
    from radartwin.simulation.simulate import simulate

    at = staged(config)
    simulator = config.simulator
    if simulator.backend == "auto":
        from radartwin.adaptive.limits import Limits
        from radartwin.build.auto import chosen

        probe = probe_of(config, at)
        simulator = chosen(simulator, probe, Limits.shipped(*measured_as(config, at)), store, say)
    recording = simulate(
        parts_of(simulator, at.room) + at.kept, at.radar, at.course.sensor_poses, motion=at.motion or None, noise=noise, seed=config.seed,
        **simulator_options(simulator),
    )  # fmt: skip
    recording.provenance |= at.told
    return recording


@dataclass(frozen=True, eq=False)
class Staged:
    """Everything in its place: the room with what was put into it, and `kept`, the thing under test and its stand.

    Attributes:
        motion: poses by surface name, of what moves. told: which scene it is, and what its room is made of.
    """

    room: Scene
    kept: Scene
    radar: Radar
    course: Course
    motion: dict[str, np.ndarray]
    told: dict[str, Any]


def staged(config: Config) -> Staged:
    """What a composed configuration describes."""
    from radartwin.build.room_materials import made_of
    from radartwin.scene import rooms
    from radartwin.scene.scene import Scene

    radar = build_radar(config.radar)
    scene = build_room(config.scene, config.materials, config.seed)
    told = made_of(scene, config.scene, config.materials)
    target = build_target(config.scene)
    foot = np.array([0.0, 0.0, stands_at(target)])
    stands = config.scene.target_position_m
    place = None if stands is None else np.array(stands) - foot
    course = build_course(config.trajectory, radar, build_start(config.trajectory, scene), place)
    scene = furnished(config.scene, scene, course.sensor_poses[0])
    check_course(scene, radar, course.sensor_poses, course.target_poses)
    kept = Scene(target)
    if config.scene.stand:
        kept = rooms.support(course.target_poses[0, :3, 3] + foot - [0, 0, rooms.GAP]) + kept
    return Staged(scene, kept, radar, course, {TARGET: course.target_poses} if target else {}, told)


def measured_as(config: Config, at: Staged) -> tuple[str, str]:
    """(motion, thing) that a configured recording is measured as; "" where nothing moves in a way that is measured."""
    kind = config.trajectory.kind
    if kind == "turntable" and len(at.course.target_poses) < round(config.trajectory.period_s * at.radar.frame_rate_hz):
        kind = ""  # not one whole turn
    if kind == "rail":
        kind = "radial" if abs(config.trajectory.angle_deg) < 22.5 else "diagonal"
    return (kind if at.motion else ""), config.scene.target


def probe_of(config: Config, at: Staged, count: int | None = None, between: bool = False) -> Probe:
    """A few frames of a configured recording, or `count` of them, with the features that are asked of it; `between` as `thinned`.

    Raises:
        ConfigError: a recording whose repeatability is not known, or features that it does not have.
    """
    from radartwin.adaptive.probe import thinned
    from radartwin.build.auto import families_of
    from radartwin.features.log import Nominal

    sensor, target = at.course.sensor_poses, at.course.target_poses
    frames = max(len(sensor), len(target))
    away = np.linalg.norm(target[:, :2, 3] - sensor[:, :2, 3], axis=1) * np.ones(frames)
    rate = at.radar.frame_rate_hz
    motion = measured_as(config, at)[0]
    turned = np.arange(frames, dtype=np.float64) * (2 * np.pi / (rate * config.trajectory.period_s))
    angle = turned if motion == "turntable" else None
    families = families_of(config.features, motion)
    course = Nominal(rate, away, angle)
    return thinned(at.room, at.kept, at.radar, sensor, at.motion, course, families, config.simulator.variant, count, between)


def parts_of(config: SimulatorConfig, room: Scene) -> Scene:
    """What the simulator is told of a room."""
    from radartwin.adaptive.model import reduced

    return room if config.parts is None else reduced(room, config.parts)
