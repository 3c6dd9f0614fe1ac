"""Build the configured simulator."""

from __future__ import annotations

from typing import Any

from radartwin.adaptive.model import reduced
from radartwin.config.simulator import MitsubaSimulator, SimulatorConfig
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.backend import backend, settings_of


def simulator_options(config: SimulatorConfig) -> dict[str, Any]:
    """Return the arguments `simulator` and `elements` of `radartwin.simulate`.

    Raises:
        InputError: the settings contradict each other.
    """
    settings = config.settings()
    if "variant" in settings_of(config.backend):
        settings["variant"] = config.variant
    return {"simulator": backend(config.backend, **settings), "elements": config.elements}


def simulated_parts(config: SimulatorConfig, room: Scene) -> Scene:
    return reduced(room, config.parts) if isinstance(config, MitsubaSimulator) else room
