"""Simulate the recording of a composed configuration."""

from __future__ import annotations

from collections.abc import Callable

from radartwin.adaptive.limits import Limits
from radartwin.builders.auto import choose_simulator
from radartwin.builders.setup import build_setup
from radartwin.builders.simulator import simulated_parts, simulator_options
from radartwin.config.config import Config
from radartwin.config.simulator import AutoSimulator
from radartwin.radar.recording import Recording
from radartwin.simulation.simulate import simulate
from radartwin.store.products import Store


def simulate_scene(
    config: Config, noise: bool = False, store: Store | None = None, say: Callable[[str], None] = lambda line: None
) -> Recording:
    """Simulate a recording of the configured radar in the configured scene. Its provenance describes the scene and its materials.

    Args:
        store, say: see `radartwin.builders.auto.choose_simulator`.
    """
    setup = build_setup(config)
    simulator = config.simulator
    if isinstance(simulator, AutoSimulator):
        probe = setup.probe(config.features, simulator.variant)
        simulator = choose_simulator(simulator, probe, Limits.shipped(setup.measured_motion, config.scene.target), store, say)
    recording = simulate(
        simulated_parts(simulator, setup.room) + setup.target, setup.radar, setup.course.sensor_poses, motion=setup.motion or None,
        noise=noise, seed=config.seed, **simulator_options(simulator),
    )  # fmt: skip
    recording.provenance |= setup.provenance
    return recording
