"""What configuration may name: code of radartwin and of Hydra's launchers, and no secret of the environment.

Configuration files may be a stranger's. Hydra calls what a `_target_` names, the logging configuration what "()" and "class" name, and
`env_set` reaches the processes that are started; `${oc.env:NAME}` would put a key into the logs and results that hold the configuration.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Iterator
from typing import Any

from radartwin.errors import ConfigError
from radartwin.io import secret

TARGETS = ("radartwin.", "hydra._internal.core_plugins.", "hydra_plugins.hydra_joblib_launcher.", "hydra_plugins.hydra_submitit_launcher.")
_CALLED = ("()", "class")  # keys of logging.config.dictConfig that name what is called
_LOGGING = re.compile(r"logging\.(handlers\.)?[A-Z]\w+|colorlog\.ColoredFormatter|ext://sys\.std(out|err)")


def check_targets(config: Any) -> None:
    """Refuse what would call code elsewhere.

    Args:
        config: composed, with Hydra's own node.
    Raises:
        ConfigError: naming the key and what it would call.
    """
    from omegaconf import OmegaConf

    content = OmegaConf.to_container(config, resolve=False, throw_on_missing=False)
    for path, value in _leaves(content):
        where, text = ".".join(path), str(value)
        if path[-1] == "_target_" and not _ours(text):
            raise ConfigError(f"{where}={value} is refused: configuration may only name launchers of Hydra and what is in radartwin")
        logs = path[0] == "hydra" and path[1:2] in (("job_logging",), ("hydra_logging",))
        if logs and (path[-1] in _CALLED or text.startswith("ext://")) and not _LOGGING.fullmatch(text):
            raise ConfigError(f"{where}={value} is refused: a logging configuration may only name classes of logging")
        if path[:3] == ("hydra", "job", "env_set"):
            raise ConfigError(f"{where} is refused: set variables of the environment where the command is typed")


def check_secrets(config: Any) -> None:
    """Refuse a composed configuration that holds a key of the environment. Raises ConfigError naming where, not what."""
    from omegaconf import OmegaConf

    for path, value in _leaves(OmegaConf.to_container(config, resolve=True, throw_on_missing=False)):
        if isinstance(value, str) and secret.hidden(value) != value:
            raise ConfigError(f"{'.'.join(path)} holds a key of the environment, and it is written into logs and results; leave it out")


def _ours(target: str) -> bool:
    """Whether it is defined in one of our modules, and not just to be reached through one (radartwin.runs.dashboard.os.system)."""
    module, _, name = target.rpartition(".")
    try:
        if not target.startswith(TARGETS) or importlib.util.find_spec(module) is None:
            return False
        return getattr(importlib.import_module(module), name).__module__.startswith(TARGETS)
    except (ImportError, AttributeError, ValueError):
        return False


def _leaves(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(node, list):
        node = dict(enumerate(node))
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _leaves(value, (*path, str(key)))
    elif path:
        yield path, node
