"""Build radar, room, target and poses of a recording from the configuration, and simulate the recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.adaptive.limits import Limits
from radartwin.adaptive.probe import Probe, thinned
from radartwin.builders.radar import build_radar
from radartwin.builders.scene import TARGET, add_layout, build_room, build_target, describe_room, lowest_m
from radartwin.builders.simulator import choose_simulator, families_of, simulated_parts, simulator_options
from radartwin.builders.trajectory import Course, build_course, check_course
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig
from radartwin.config.radar import RadarConfig
from radartwin.config.scene import SceneConfig
from radartwin.config.simulator import AutoSimulator
from radartwin.config.study import FeaturesConfig
from radartwin.config.trajectory import TrajectoryConfig
from radartwin.features.log import Nominal
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.scene import rooms
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import pose
from radartwin.simulation.simulate import simulate
from radartwin.store.products import Store


@dataclass(frozen=True, eq=False)
class Setup:
    """Hold the radar, the room and the target of a recording, with their poses.

    Attributes:
        room: the scene without the target, but with the objects of the furniture layout.
        target: surfaces of the target and of its stand; empty for scene.target=none.
        motion: object-to-world poses by surface name, (F, 4, 4), or (1, 4, 4) for surfaces at rest.
        provenance: see `radartwin.builders.scene.describe_room`.
    """

    room: Scene
    target: Scene
    radar: Radar
    course: Course
    motion: dict[str, np.ndarray]
    provenance: dict[str, Any]

    @property
    def measured_motion(self) -> str:
        """Return the name of the target's motion relative to the radar; "" if the repeatability of features is unknown for this motion."""
        return self.course.motion if self.motion else ""

    def probe(self, features: FeaturesConfig, variant: str = "auto", count: int | None = None, between: bool = False) -> Probe:
        """Select a few frames of the recording on which simulator=auto compares its settings, and the features that must stay accurate.

        Args:
            variant: name of the Mitsuba variant (compute backend), or "auto".
            count, between: see `radartwin.adaptive.probe.thinned`.
        Raises:
            ConfigError: see `radartwin.builders.simulator.families_of`.
        """
        families = families_of(features, self.measured_motion)
        sensor, target = self.course.sensor_poses, self.course.target_poses
        frames = max(len(sensor), len(target))
        distance_m = np.linalg.norm(target[:, :2, 3] - sensor[:, :2, 3], axis=1) * np.ones(frames)
        log = Nominal(self.radar.frame_rate_hz, distance_m, self.course.angle_rad)
        return thinned(self.room, self.target, self.radar, sensor, self.motion, log, families, variant, count, between)


def build_setup(
    radar_config: RadarConfig,
    scene: SceneConfig,
    materials: MaterialsConfig,
    trajectory: TrajectoryConfig,
    seed: int = 0,
    contents: str = "filled",
) -> Setup:
    """Build radar, room, target and poses of a recording. Raises UserError if radar, room, target and poses do not fit together."""
    radar = build_radar(radar_config)
    room = build_room(scene, materials, seed)
    provenance = describe_room(room, scene, materials)
    target = build_target(scene, contents)
    foot = np.array([0.0, 0.0, lowest_m(target)])
    position = scene.target_position_m
    if position is not None:
        position = room.placed(pose(position), "scene.target_position_m")[:3, 3] - foot
    course = build_course(trajectory, radar, room, position)
    room = add_layout(scene, room, course.sensor_poses[0])
    check_course(room, radar, course)
    placed = Scene(target)
    if scene.stand:
        placed = rooms.support(course.target_poses[0, :3, 3] + foot - [0, 0, rooms.GAP]) + placed
    return Setup(room, placed, radar, course, {TARGET: course.target_poses} if target else {}, provenance)


def simulate_scene(
    config: Config,
    noise: bool = False,
    store: Store | None = None,
    say: Callable[[str], None] = lambda line: None,
    out: Path | None = None,
) -> Recording:
    """Simulate a recording of the configured radar in the configured scene. The recording's provenance describes the scene and its
    materials.

    Args:
        out: as in `radartwin.simulation.simulate.simulate`.
        store, say: see `radartwin.builders.simulator.choose_simulator`.
    """
    setup = build_setup(config.radar, config.scene, config.materials, config.trajectory, config.seed, config.contents)
    return simulate_setup(setup, config, config.scene.target, noise, store, say, out)


def simulate_setup(
    setup: Setup,
    config: Config,
    target: str,
    noise: bool = False,
    store: Store | None = None,
    say: Callable[[str], None] = lambda line: None,
    out: Path | None = None,
) -> Recording:
    """Simulate a recording of a radar, a room and a target that are already built. Only the simulator, the features and the seed are read
    from the configuration.

    Args:
        target: name of the target. If the repeatability of the target's features is unknown, simulator=auto uses the limits pooled over all
            objects.
        noise, store, say, out: as in `simulate_scene`.
    """
    simulator = config.simulator
    if isinstance(simulator, AutoSimulator):
        probe = setup.probe(config.features, simulator.variant)
        simulator = choose_simulator(simulator, probe, Limits.shipped(setup.measured_motion, target), store, say)
    return simulate(
        simulated_parts(simulator, setup.room) + setup.target, setup.radar, setup.course.sensor_poses, motion=setup.motion or None,
        noise=noise, seed=config.seed, out=out, provenance=setup.provenance, **simulator_options(simulator),
    )  # fmt: skip
