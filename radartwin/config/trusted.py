"""Check a composed configuration from an untrusted source: whether its settings of Hydra are used, and whether it contains a secret.

RadarTwin reads only the launcher, its keys and the folder of a sweep from Hydra's own settings, and never calls what a `_target_` key or a
logging configuration names. An entry `${oc.env:NAME}` would copy a secret of the environment into the logs and results that store the
configuration.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from radartwin.errors import ConfigError
from radartwin.io import secret

LAUNCHERS = ("basic", "joblib", "slurm")  # options of hydra/launcher
_READ = ("launcher", "sweep.dir", "searchpath")
_MADE = ("overrides", "runtime", "job.name", "job.override_dirname", "job.config_name")  # written by Hydra itself


@dataclass
class JoblibLauncher:
    """The keys of hydra/launcher=joblib. `n_jobs` is the number of worker processes; -1 means one per processor core."""

    n_jobs: int = -1


def check_hydra(config: Any, default: Any) -> None:
    """Raise ConfigError for a setting of Hydra that has no effect here, or would make it call code. `default` has no overrides."""
    choice = config.hydra.runtime.choices["hydra/launcher"]
    if choice not in LAUNCHERS:
        raise ConfigError(f"hydra/launcher={choice} is refused; options: {', '.join(LAUNCHERS)}")
    known = dict(_leaves(_content(default.hydra)))
    for path, value in _leaves(_content(config.hydra)):
        key = ".".join(path)
        read = any(f"{key}.".startswith(f"{name}.") for name in (*_READ, *_MADE)) and path[-1] != "_target_"
        launcher = key == "launcher._target_" and str(value).startswith("hydra_plugins.hydra_submitit_launcher.")
        if not (read or launcher) and known.get(path, ()) != value:
            allowed = ", ".join(f"hydra.{name}" for name in _READ)
            raise ConfigError(f"hydra.{key}={value} is refused, because only {allowed} have an effect; leave it out")


def check_secrets(config: Any) -> None:
    """Raise ConfigError, without the secret, if a composed configuration contains a secret from an environment variable."""
    for path, value in _leaves(_content(config, resolve=True)):
        if isinstance(value, str) and secret.hidden(value) != value:
            raise ConfigError(
                f"{'.'.join(path)} contains the secret of an environment variable, which logs and results would show; leave it out"
            )


def _content(config: Any, resolve: bool = False) -> Any:
    from omegaconf import OmegaConf

    return OmegaConf.to_container(config, resolve=resolve, throw_on_missing=False)


def _leaves(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if isinstance(node, list):
        node = dict(enumerate(node))
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _leaves(value, (*path, str(key)))
    elif path:
        yield path, node
