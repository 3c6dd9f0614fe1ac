"""The configured simulator."""

from __future__ import annotations

from typing import Any

from radartwin.adaptive.model import reduced
from radartwin.config.simulator import MitsubaSimulator, SimulatorConfig
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.backend import backend, settings_of


def simulator_options(config: SimulatorConfig) -> dict[str, Any]:
    """The arguments `simulator` and `elements` of `radartwin.simulate`.

    Raises:
        InputError: settings that exclude each other.
    """
    settings = config.settings()
    if "variant" in settings_of(config.backend):
        settings["variant"] = config.variant
    return {"simulator": backend(config.backend, **settings), "elements": config.elements}


def simulated_parts(config: SimulatorConfig, room: Scene) -> Scene:
    """The surfaces of the room that the configured simulator models."""
    return reduced(room, config.parts) if isinstance(config, MitsubaSimulator) else room
