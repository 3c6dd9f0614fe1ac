"""Build the configured simulator. For simulator=auto, search the cheapest sufficient settings for a recording, and store the result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from radartwin.adaptive.choice import Choice, choose
from radartwin.adaptive.limits import Limits
from radartwin.adaptive.probe import Probe
from radartwin.adaptive.scene_settings import reduced
from radartwin.config.simulator import AutoSimulator, MitsubaSimulator, SimulatorConfig
from radartwin.config.study import FeaturesConfig
from radartwin.errors import ConfigError
from radartwin.features.sets import SETS, feature_set
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.backend import backend, settings_of
from radartwin.store.products import Store, save_json

KIND = "choice"
ROOTS = ("radartwin.adaptive.choice", "radartwin.adaptive.probe")
_DRIVE = ("track", "multipath", "window", "extent", "brightness", "profile")
MOTION_FAMILIES = {  # feature families of each motion with a known repeatability
    "turntable": ("harmonics", "envelope", "multipath", "extent", "brightness", "profile"),
    "lateral": ("harmonics", "envelope", "multipath", "window", "extent", "brightness", "profile"),
    "depth": _DRIVE,
    "radial": _DRIVE,  # drive along a linear rail; it has the feature families of the diagonal drive
    "diagonal": _DRIVE,
}


def families_of(config: FeaturesConfig, motion: str) -> tuple[str, ...]:
    """Return the feature families that must stay within their limits: those of the configured set, or for features=raw all of the motion.

    Raises ConfigError if the limits of the motion are unknown, or if the feature set belongs to another motion.
    """
    if motion not in MOTION_FAMILIES:
        known = "a whole turntable revolution, or trajectory=rail, depth or lateral"
        raise ConfigError(
            f"simulator=auto needs a target, and a motion with known repeatability limits; use {known}, or use simulator=mitsuba"
        )
    available = MOTION_FAMILIES[motion]
    families = available if config.name == "raw" else feature_set(config.name)
    if not set(families) <= set(available):
        fitting = [name for name, of in SETS.items() if name == "raw" or set(of) <= set(available)]
        raise ConfigError(
            f"simulator=auto: features={config.name} do not apply to a {motion} recording; choose features={' or '.join(fitting)}"
        )
    return tuple(family for family in families if family not in config.without)


def fixed_simulator(config: SimulatorConfig) -> SimulatorConfig:
    """Return a simulator for a target alone in free space; for simulator=auto, the default tracer with the settings that the user fixed."""
    return MitsubaSimulator(variant=config.variant, **config.fixed()) if isinstance(config, AutoSimulator) else config


def choose_simulator(
    config: AutoSimulator, probe: Probe, limits: Limits, store: Store | None, say: Callable[[str], None]
) -> MitsubaSimulator:
    """Choose the cheapest simulator settings that keep the features of a recording within their repeatability limits.

    store: store of earlier search results; None repeats the search. say: receives lines with the chosen settings and the reasons.
    """
    fixed = config.fixed()
    if store is None:
        choice, source = choose([(probe, limits)], config.tolerance, fixed), ""
    else:
        spec = {"probe": probe.described(), "limits": limits.of, "tolerance": config.tolerance, "pinned": fixed}

        def build(folder: Path) -> None:
            save_json(folder, KIND, choose([(probe, limits)], config.tolerance, fixed).to_dict())

        product = store.fetch(KIND, spec, ROOTS, build)
        choice, source = Choice.from_dict(product.read_json(KIND)), ", as an earlier search chose" if product.reused else ""
    first, *reasons = choice.lines()
    for line in (f"simulator=auto for {', '.join(probe.families)}: {first}{source}", *reasons):
        say(line)
    model = choice.model
    return MitsubaSimulator(variant=config.variant, elements=model.elements, parts=model.parts, **model.settings())


def simulator_options(config: SimulatorConfig) -> dict[str, Any]:
    """Return the arguments `simulator` and `elements` of `radartwin.simulate`. Raises InputError if two settings contradict each other."""
    settings = config.settings()
    if "variant" in settings_of(config.backend):
        settings["variant"] = config.variant
    return {"simulator": backend(config.backend, **settings), "elements": config.elements}


def simulated_parts(config: SimulatorConfig, room: Scene) -> Scene:
    return reduced(room, config.parts) if isinstance(config, MitsubaSimulator) else room
