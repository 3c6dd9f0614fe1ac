"""Make configuration options of plug-ins: `simulator=NAME`, `materials=NAME`, `features=NAME` and `experiment=NAME`.

The option's keys are the fields of the plug-in's dataclass. The field `code` holds the digest of the plug-in's source code, so that stored
results are computed again when it changes. A worker process makes the dataclass again when it unpickles a configuration.
"""

from __future__ import annotations

import dataclasses
import functools
import types
import typing
from collections.abc import Mapping
from typing import Any

from radartwin import plugins
from radartwin.config.checked_fields import Checked
from radartwin.config.config import SCHEMAS
from radartwin.config.materials import MaterialsConfig
from radartwin.config.simulator import SimulatorConfig
from radartwin.config.study import FeaturesConfig
from radartwin.errors import ConfigError, MissingError
from radartwin.plugins import EXPERIMENTS, FEATURES, MATERIALS, SIMULATORS, Plugin
from radartwin.store import digest

GROUPS = {"simulator": SIMULATORS, "materials": MATERIALS, "features": FEATURES, "experiment": EXPERIMENTS}
_SCALARS = (int, float, str, bool)


@dataclasses.dataclass
class _Plugged(Checked):
    """Base of the options of plug-ins."""

    code: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.code != type(self).code:
            raise ConfigError(f"{self.KEY}.code is the digest of the plug-in's source code and cannot be set; leave it out")


@dataclasses.dataclass
class PluginSimulator(_Plugged, SimulatorConfig):
    """Base of the options of simulators in other packages."""

    def settings(self) -> dict[str, Any]:
        return {name: value for name, value in super().settings().items() if name != "code"}


@dataclasses.dataclass
class PluginMaterials(_Plugged, MaterialsConfig):
    """Base of the options of material sources in other packages. A field `seed` of the source takes the configured seed."""


def register(config_file: str) -> bool:
    """Add the option of a plug-in, GROUP/OPTION, to Hydra's ConfigStore. Return whether a plug-in has this name. Raises PluginError."""
    from hydra.core.config_store import ConfigStore

    group, _, option = config_file.removesuffix(".yaml").rpartition("/")
    plugin = plugins.find(GROUPS[group], option) if group in GROUPS else None
    if plugin is None:
        return False
    if group == "experiment":
        node: Any = _experiment(plugin)
    elif group == "features":
        node = FeaturesConfig(name=plugin.name, code=code_of(plugin))
    else:
        node = SCHEMAS[group][option] = _schema(plugin)
    ConfigStore.instance().store(group=group, name=option, node=node, package="_global_" if group == "experiment" else None)
    return True


def check(choices: Mapping[str, Any], options: Mapping[str, list[str]]) -> None:
    """Raise PluginError if a chosen option is both a built-in option, as listed in `options`, and the name of a plug-in."""
    for group, entry_points in GROUPS.items():
        plugins.check(entry_points, str(choices.get(group)), options.get(group, []))


def code_of(plugin: Plugin) -> str:
    """Return the digest of a plug-in's source code, or of the plug-in's version if the plug-in has no Python source."""
    digest.include(plugin.module.partition(".")[0])
    try:
        return digest.source_digest((plugin.module,))
    except (ConfigError, MissingError):
        from importlib import metadata

        return digest.spec_digest([plugin.package, metadata.version(plugin.package)])


@functools.cache
def _schema(plugin: Plugin) -> type:
    """Return the configuration dataclass of a simulator or a material source."""
    if plugin.group == SIMULATORS:
        from radartwin.simulation.backends.backend import plugged_in as simulator

        owner, base, selector = simulator(plugin)[1], PluginSimulator, "backend"
    else:
        from radartwin.label.material_sources import plugged_in as source

        owner, base, selector = source(plugin), PluginMaterials, "source"
    inherited = {field.name for field in dataclasses.fields(base)}
    hints = typing.get_type_hints(owner)
    settings = []
    for field in dataclasses.fields(owner):
        if (field.name, base) in (("variant", PluginSimulator), ("seed", PluginMaterials)):
            continue  # every simulator has the key `variant`, and a source takes the configured seed
        if field.name in inherited:
            raise plugins.refusal(plugin, f"the setting '{field.name}' has the name of a key that every option has")
        if field.default is field.default_factory is dataclasses.MISSING:
            raise plugins.refusal(plugin, f"the setting '{field.name}' needs a default value")
        default = dataclasses.field(default=field.default, default_factory=field.default_factory)  # type: ignore[call-overload]
        settings.append((field.name, _typed(plugin, field.name, hints[field.name]), default))
    settings += [(selector, str, plugin.name), ("code", str, code_of(plugin))]
    namespace = {"__doc__": f"The option of {plugin}.", "seeded": "seed" in hints, "__reduce__": functools.partialmethod(_pickled, plugin)}
    made = dataclasses.make_dataclass(f"Plugged_{plugin.name}", settings, bases=(base,), namespace=namespace)
    made.__module__ = __name__
    return made


def _pickled(config: Any, plugin: Plugin) -> tuple[Any, ...]:
    return _unpickled, (plugin, dataclasses.asdict(config))


def _unpickled(plugin: Plugin, values: Mapping[str, Any]) -> Any:
    return _schema(plugin)(**values)


def _typed(plugin: Plugin, name: str, hint: Any) -> Any:
    """Return the type of a setting for OmegaConf: a scalar, a list of scalars, or either with None."""
    options = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    kinds = [option for option in options if option is not type(None)]
    (kind,) = kinds if len(kinds) == 1 else (None,)
    if typing.get_origin(kind) is typing.Literal:
        kind = str if all(isinstance(value, str) for value in typing.get_args(kind)) else None
    item = typing.get_args(kind)[0] if typing.get_origin(kind) is list and typing.get_args(kind) else kind
    if kind is None or item not in _SCALARS:
        raise plugins.refusal(plugin, f"the setting '{name}' must be int, float, str, bool, a list of these, or one of these with None")
    return kind if len(options) == 1 else kind | None


def _experiment(plugin: Plugin) -> dict[str, Any]:
    """Return the option of an experiment. The module may name options of other groups in OVERRIDES, such as {"scene": "void"}."""
    module = plugins.load(plugin)
    if not isinstance(module, types.ModuleType) or not callable(getattr(module, "run", None)):
        raise plugins.refusal(plugin, f"{plugin.value} is no module with a function run(config, store, progress)")
    overrides = getattr(module, "OVERRIDES", {})
    if not isinstance(overrides, Mapping) or not all(isinstance(part, str) for pair in overrides.items() for part in pair):
        raise plugins.refusal(plugin, "OVERRIDES must map names of groups to names of options")
    defaults = [{f"override /{group}": option} for group, option in overrides.items()]
    return {"defaults": [*defaults, "_self_"], "experiment": {"name": plugin.name, "module": plugin.module}}
