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
from radartwin.config.simulator import AutoSimulator
from radartwin.config.study import FeaturesConfig
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
    """Hold the radar, the room and the target of a recording, with their poses."""

    room: Scene  # without the target, but with the objects of the furniture layout
    target: Scene  # with its stand; empty for scene.target=none
    radar: Radar
    course: Course
    motion: dict[str, np.ndarray]  # object-to-world poses by surface name, (F, 4, 4), or (1, 4, 4) for surfaces at rest
    provenance: dict[str, Any]  # see `radartwin.builders.scene.describe_room`

    @property
    def measured_motion(self) -> str:
        """Return the name of the target's motion relative to the radar; "" if the repeatability of features is unknown for this motion."""
        return self.course.motion if self.motion else ""

    def probe(self, features: FeaturesConfig, variant: str = "auto", count: int | None = None, between: bool = False) -> Probe:
        """Select the frames and the features on which simulator=auto compares its settings. Raises ConfigError, see `families_of`.

        variant: name of the Mitsuba variant (compute backend), or "auto". count, between: see `radartwin.adaptive.probe.thinned`.
        """
        families = families_of(features, self.measured_motion)
        sensor, target = self.course.sensor_poses, self.course.target_poses
        frames = max(len(sensor), len(target))
        distance_m = np.linalg.norm(target[:, :2, 3] - sensor[:, :2, 3], axis=1) * np.ones(frames)
        log = Nominal(self.radar.frame_rate_hz, distance_m, self.course.angle_rad)
        return thinned(self.room, self.target, self.radar, sensor, self.motion, log, families, variant, count, between)


def build_setup(config: Config) -> Setup:
    """Build radar, room, target and poses of a recording. Raises UserError if radar, room, target and poses do not fit together."""
    radar, scene = build_radar(config.radar), config.scene
    room = build_room(scene, config.materials, config.seed)
    provenance = describe_room(room, scene, config.materials)
    target = build_target(scene, config.contents)
    foot = np.array([0.0, 0.0, lowest_m(target)])
    position = scene.target_position_m
    if position is not None:
        position = room.placed(pose(position), "scene.target_position_m")[:3, 3] - foot
    course = build_course(config.trajectory, radar, room, position)
    room = add_layout(scene, room, course.sensor_poses[0])
    check_course(room, radar, course)
    placed = Scene(target)
    if scene.stand:
        placed = rooms.support(course.target_poses[0, :3, 3] + foot - [0, 0, rooms.GAP]) + placed
    return Setup(room, placed, radar, course, {TARGET: course.target_poses} if target else {}, provenance)


def simulate_scene(config: Config, **options: Any) -> Recording:
    """Simulate a recording of the configured radar in the configured scene. `options` are those of `simulate_setup`."""
    return simulate_setup(build_setup(config), config, config.scene.target, **options)


def simulate_setup(
    setup: Setup,
    config: Config,
    target: str,
    noise: bool = False,
    store: Store | None = None,
    say: Callable[[str], None] = lambda line: None,
    out: Path | None = None,
) -> Recording:
    """Simulate a recording of a radar, a room and a target. Of the configuration, only simulator, features and seed are read.

    The name of the target chooses the limits of simulator=auto. `choose_simulator` describes `store` and `say`, and `simulate` the rest.
    """
    simulator = config.simulator
    if isinstance(simulator, AutoSimulator):
        probe = setup.probe(config.features, simulator.variant)
        simulator = choose_simulator(simulator, probe, Limits.shipped(setup.measured_motion, target), store, say)
    return simulate(
        simulated_parts(simulator, setup.room) + setup.target, setup.radar, setup.course.sensor_poses, motion=setup.motion or None,
        noise=noise, seed=config.seed, out=out, provenance=setup.provenance, **simulator_options(simulator),
    )  # fmt: skip
