"""Check a composed configuration from an untrusted source: which code it would call, and whether it contains a secret.

Hydra calls the function that a `_target_` key names, the logging module calls functions named under the keys "()" and "class", and the key
`env_set` changes the environment of started processes. An entry `${oc.env:NAME}` would copy a secret of the environment into the logs and
results that store the configuration.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Iterator
from typing import Any

from radartwin.errors import ConfigError
from radartwin.io import secret

TRUSTED = ("radartwin.", "hydra._internal.core_plugins.", "hydra_plugins.hydra_joblib_launcher.", "hydra_plugins.hydra_submitit_launcher.")
_CALLED = ("()", "class")  # keys in a logging configuration (logging.config.dictConfig) whose values name functions to call
_LOGGING = re.compile(r"logging\.(handlers\.)?[A-Z]\w+|colorlog\.ColoredFormatter|ext://sys\.std(out|err)")


def check_targets(config: Any) -> None:
    """Raise ConfigError for a configuration that would call code outside radartwin and Hydra's launchers.

    Args:
        config: the composed configuration, including Hydra's own settings under the key `hydra`.
    Raises:
        ConfigError: the message names the configuration key and the code that it would call.
    """
    from omegaconf import OmegaConf

    content = OmegaConf.to_container(config, resolve=False, throw_on_missing=False)
    for path, value in _leaves(content):
        key, text = ".".join(path), str(value)
        if path[-1] == "_target_" and not _is_trusted(text):
            raise ConfigError(
                f"{key}={value} is refused; remove it, because a configuration may name only launchers of Hydra and code of radartwin"
            )
        is_logging = path[0] == "hydra" and path[1:2] in (("job_logging",), ("hydra_logging",))
        if is_logging and (path[-1] in _CALLED or text.startswith("ext://")) and not _LOGGING.fullmatch(text):
            raise ConfigError(
                f"{key}={value} is refused; remove it, because a logging configuration may name only classes of the module logging"
            )
        if path[:3] == ("hydra", "job", "env_set"):
            raise ConfigError(f"{key} is refused; set environment variables in the shell that starts the command")


def check_secrets(config: Any) -> None:
    """Raise ConfigError if a composed configuration contains a secret from an environment variable.

    The message does not show the secret.
    """
    from omegaconf import OmegaConf

    for path, value in _leaves(OmegaConf.to_container(config, resolve=True, throw_on_missing=False)):
        if isinstance(value, str) and secret.hidden(value) != value:
            raise ConfigError(
                f"{'.'.join(path)} contains the secret of an environment variable, which logs and results would show; leave it out"
            )


def _is_trusted(target: str) -> bool:
    """Return whether a trusted module itself defines the target.

    A name that a trusted module only imports, such as `radartwin.runs.dashboard.os.system`, is not trusted.
    """
    module, _, name = target.rpartition(".")
    try:
        if not target.startswith(TRUSTED) or importlib.util.find_spec(module) is None:
            return False
        return getattr(importlib.import_module(module), name).__module__.startswith(TRUSTED)
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
