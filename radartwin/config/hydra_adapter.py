"""All calls to Hydra functions that are not part of its public interface (Hydra 1.3).

Every other module composes and launches through radartwin/config/compose.py. Functions import Hydra themselves because the import
takes 0.1 s, and `radartwin --help` must be fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig


def parse(overrides: Sequence[str]) -> list[Override]:
    """Parse overrides with Hydra's grammar. Raises HydraException."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    return OverridesParser.create().parse_overrides(list(overrides))


def assign(config: DictConfig, overrides: Sequence[Override]) -> None:
    """Set values, but not options of a group, in a composed configuration, as hydra.compose does. Raises HydraException."""
    from hydra._internal.config_loader_impl import ConfigLoaderImpl

    ConfigLoaderImpl._apply_overrides_to_config(list(overrides), config)


def combinations(overrides: Sequence[str]) -> list[list[str]]:
    """Return the overrides of each job of a sweep: seed=0,1 and materials=vlm,void make four jobs. Raises HydraException."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper

    return [list(job) for batch in BasicSweeper.split_arguments(parse(overrides), max_batch_size=None) for job in batch]


def launcher(
    config_name: str, folder: Path, overrides: Sequence[str], job: Callable[[DictConfig], None], check: Callable[[DictConfig], None]
) -> Any:
    """Return the launcher plugin that hydra/launcher=... selects.

    Args:
        config_name, folder: name and folder of the primary configuration.
        job: called by the plugin once for each job, with the composed configuration.
        check: called with the composed configuration before any class that the configuration names is loaded; raises an exception to
            refuse the configuration.
    """
    from hydra._internal.callbacks import Callbacks
    from hydra._internal.hydra import Hydra
    from hydra._internal.utils import create_config_search_path
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.plugins import Plugins
    from hydra.types import HydraContext, RunMode
    from hydra.utils import instantiate

    GlobalHydra.instance().clear()
    main = Hydra.create_main_hydra2("radartwin", create_config_search_path(str(folder)))
    config = main.compose_config(config_name, list(overrides), RunMode.MULTIRUN, with_log_configuration=False)
    check(config)
    context = HydraContext(config_loader=main.config_loader, callbacks=Callbacks())
    if not str(config.hydra.launcher._target_).startswith("radartwin."):
        return Plugins.instance().instantiate_launcher(hydra_context=context, task_function=job, config=config)
    plugin = instantiate(config.hydra.launcher, _recursive_=False)  # Hydra registers only plugins of the package hydra_plugins
    plugin.setup(hydra_context=context, task_function=job, config=config)
    return plugin
