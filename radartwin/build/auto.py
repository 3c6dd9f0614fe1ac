"""simulator=auto: the cheapest sufficient model of a scene, chosen once, kept in the store, and told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from radartwin.adaptive.choice import Choice, choose
from radartwin.adaptive.limits import Limits
from radartwin.adaptive.probe import Probe
from radartwin.config.simulator import CHOSEN, SimulatorConfig
from radartwin.config.study import FeaturesConfig
from radartwin.errors import ConfigError
from radartwin.features.names import SETS
from radartwin.store.products import Store, save_json

KIND = "choice"
ROOTS = ("radartwin.adaptive.choice", "radartwin.adaptive.probe")
_DRIVEN = ("track", "multipath", "window", "extent", "brightness", "profile")
ALL = {  # of each motion: what is asked where no feature set is named
    "turntable": ("harmonics", "envelope", "multipath", "extent", "brightness", "profile"),
    "lateral": ("harmonics", "envelope", "multipath", "window", "extent", "brightness", "profile"),
    "depth": _DRIVEN,
    "radial": _DRIVEN,  # and diagonal: on a rail
    "diagonal": _DRIVEN,
}  # fmt: skip


def families_of(config: FeaturesConfig, motion: str) -> tuple[str, ...]:
    """Families that must stay within their limits: of the configured set, or, where that is raw, all that a motion exposes.

    Raises:
        ConfigError: a motion without a repeatability, or a feature set that it does not expose.
    """
    if motion not in ALL:
        known = "a turntable's whole turn, rail, depth or lateral"
        raise ConfigError(f"simulator=auto needs a thing under test and a motion of known repeatability, {known}; or use simulator=mitsuba")
    wanted = ALL[motion] if config.name == "raw" else SETS[config.name]
    if not set(wanted) <= set(ALL[motion]):
        fit = [name for name, of in SETS.items() if name == "raw" or set(of) <= set(ALL[motion])]
        raise ConfigError(f"simulator=auto: features={config.name} are not read from a {motion} recording; choose {' or '.join(fit)}")
    return tuple(family for family in wanted if family not in config.without)


def chosen(config: SimulatorConfig, probe: Probe, limits: Limits, store: Store | None, say: Callable[[str], None]) -> SimulatorConfig:
    """The configuration with everything chosen: simulator=mitsuba.

    Args:
        store: where choices are kept; None chooses anew.
        say: receives what was chosen and why, line by line.
    """
    pinned = {name: value for name in CHOSEN if (value := getattr(config, name)) is not None}
    if config.elements != "auto":
        pinned["elements"] = config.elements
    tolerance = 1.0 if config.tolerance is None else config.tolerance
    if store is None:
        found, known = choose([(probe, limits)], tolerance, pinned), ""
    else:
        spec = {"probe": probe.described(), "limits": limits.of, "tolerance": tolerance, "pinned": pinned}

        def build(folder: Path) -> None:
            save_json(folder, KIND, choose([(probe, limits)], tolerance, pinned).to_dict())

        product = store.fetch(KIND, spec, ROOTS, build)
        found, known = Choice.from_dict(product.read_json(KIND)), ", as chosen before" if product.reused else ""
    lines = found.lines()
    _tell([f"simulator=auto for {', '.join(probe.families)}: {lines[0]}{known}", *lines[1:]], say)
    model = found.model
    settings = {name: getattr(model, name) for name in CHOSEN}
    return replace(config, backend="mitsuba", room="auto", tolerance=None, elements=model.elements, **settings)


def _tell(lines: Sequence[str], say: Callable[[str], None]) -> None:
    for line in lines:
        say(line)
