"""Compose a typed `Config` from command-line overrides. Every mistake is a ConfigError of one line. Hydra is imported when needed."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from radartwin.config import messages
from radartwin.config.config import SCHEMAS, Config
from radartwin.config.trusted import JoblibLauncher, check_hydra, check_secrets
from radartwin.errors import ConfigError, MissingError

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

CONFIG_NAME = "config"
_VALUE = re.compile(r"(?!hydra\.)(?:[A-Za-z_]\w*\.[\w.\[\]]+|seed|output)=")  # matches KEY=VALUE; not GROUP=OPTION, +KEY or ~KEY


def conf_dir() -> Path:
    """Return the folder conf/ of the installed Python wheel or of the repository checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "conf", package.parent / "conf"):
        if (folder / f"{CONFIG_NAME}.yaml").is_file():
            return folder
    raise MissingError(f"{package / 'conf'}: the configuration files are missing; install radartwin again")


def groups() -> dict[str, list[str]]:
    """Return the built-in option names of each configuration group: {"scene": ["empty", "lab", ...], ...}."""
    folders = sorted(d for d in conf_dir().iterdir() if d.is_dir() and d.name != "hydra")
    return {d.name: sorted(f.stem for f in d.glob("*.yaml")) for d in folders}


def compose(overrides: Sequence[str] = (), config_dirs: Sequence[Path] = ()) -> Config:
    """Compose the configuration of a run from overrides such as ["experiment=environment", "seed=1"]. Raises ConfigError.

    config_dirs: further folders with option files (`--config-dir`).
    """
    return Composer(config_dirs).compose(overrides)


class Composer:
    """Composes many configurations. The option files of a combination of options are read once, because this takes 0.1 s."""

    def __init__(self, config_dirs: Sequence[Path] = ()) -> None:
        self._search_path = _search_path(config_dirs)
        self._cache: dict[tuple[str, ...], DictConfig] = {}

    def compose(self, overrides: Sequence[str]) -> Config:
        from omegaconf import OmegaConf, open_dict

        overrides = quoted(overrides)
        with _one_line_errors():
            values = [override for override in overrides if _VALUE.match(override)]
            options = tuple(override for override in overrides if override not in values)
            if options not in self._cache:
                self._cache[options] = self._read(options)
                with open_dict(self._cache[options]) as cached:
                    del cached["hydra"]
            composed = copy.deepcopy(self._cache[options])
            for override in _parse(values):
                if override.is_sweep_override():
                    raise ConfigError(messages.several_values(override.key_or_group))
                OmegaConf.update(composed, override.key_or_group, override.value())
            check_secrets(composed)
            config = OmegaConf.to_object(composed)
        if not isinstance(config, Config):
            raise ConfigError("config.yaml: the list 'defaults' does not begin with 'schema'; add schema as its first entry")
        return config

    def launching(self, overrides: Sequence[str]) -> tuple[str, dict[str, Any], str]:
        """Return the option of hydra/launcher, its keys, and hydra.sweep.dir, which is empty unless the user sets it."""
        from omegaconf import OmegaConf

        with _one_line_errors():
            settings = self._read(quoted(overrides)).hydra
            keys = cast(dict[str, Any], OmegaConf.to_container(settings.launcher, resolve=True))
            return settings.runtime.choices["hydra/launcher"], keys, str(settings.sweep.dir)

    def _read(self, options: Sequence[str]) -> DictConfig:
        import hydra
        from hydra.core.global_hydra import GlobalHydra

        for override in _parse(options):
            key, value = override.key_or_group, override.value()
            if not key or (override.is_delete() and not isinstance(value, str | None)):  # Hydra would raise a ValueError
                raise ConfigError(messages.unreadable(override.input_line))
            if isinstance(value, list) and key in groups():  # of several options of a group, Hydra would take the last
                raise ConfigError(messages.several_values(key))
        _register_schemas()
        GlobalHydra.instance().clear()
        with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
            composed = _with_plugins(lambda: hydra.compose(CONFIG_NAME, overrides=[*options, *self._search_path], return_hydra_config=True))
            if self._search_path or any("hydra" in override for override in options):
                check_hydra(composed, hydra.compose(CONFIG_NAME, return_hydra_config=True))
        return composed


def _with_plugins(read: Callable[[], DictConfig]) -> DictConfig:
    """Call `read`, and register missing options that plug-ins provide. Check that no chosen option is both built in and a plug-in."""
    from hydra.errors import MissingConfigException

    from radartwin.config import plugged

    tried: set[str] = set()
    while True:
        try:
            composed = read()
        except MissingConfigException as error:
            missing = error.missing_cfg_file or ""
            if missing in tried or not plugged.register(missing):
                raise
            tried.add(missing)
        else:
            plugged.check(composed.hydra.runtime.choices, groups())
            return composed


def parse_overrides(overrides: Sequence[str]) -> list[Override]:
    """Parse command-line overrides with Hydra's grammar. Raises ConfigError for an override that cannot be parsed."""
    with _one_line_errors():
        return _parse(quoted(overrides))


def combinations(overrides: Sequence[str]) -> list[list[str]]:
    """Return the overrides of each job of a sweep; seed=0,1 and materials=vlm,void give four jobs. Raises ConfigError."""
    choices: dict[str, list[str]] = {}
    with _one_line_errors():
        for override in _parse(quoted(overrides)):
            key = override.get_key_element()
            if override.is_interval_sweep():
                raise ConfigError(f"{key}: a sweep needs a list of values; write {key}=1,2,3, or search the interval with --search METRIC")
            values = override.sweep_string_iterator() if override.is_sweep_override() else [override.get_value_element_as_str()]
            choices[key] = [f"{key}={value}" for value in values]
    return [list(job) for job in itertools.product(*choices.values())]


def quoted(overrides: Sequence[str]) -> list[str]:
    """Quote option names that Hydra would read as a boolean, a number or null, such as `true` in materials=true.

    Hydra would add a key with `+key=value`, but no code would read it. Without the plus sign, Hydra refuses an unknown key.
    """
    literal, known = re.compile(r"(?<=[=,])(true|false|null|[\d.]+)(?=,|$)", re.IGNORECASE), groups()
    plain = [re.sub(r"^\++(?!\+|hydra)", "", override) for override in overrides]
    return [literal.sub(r"'\1'", override) if override.partition("=")[0] in known else override for override in plain]


def refuse_unread(verb: str, overrides: Sequence[str], reads: Sequence[str], set_by: Mapping[str, str] | None = None) -> list[str]:
    """Return the keys of overrides. Raise ConfigError for a key of a group that the verb does not read.

    set_by: {key: argument} of keys that the verb sets from another argument.
    """
    keys = [override.lstrip("+~").partition("=")[0] for override in overrides]
    groups = {"hydra", *(entry.name for entry in dataclasses.fields(Config))}
    for key in keys:
        if set_by and key in set_by:
            raise ConfigError(f"{verb} does not read {key}; use {set_by[key]}")
        group = re.split(r"[./@]", key)[0]
        if group in groups and group not in reads:
            raise ConfigError(f"{verb} does not read {key}; it reads {', '.join(reads)}")
    return keys


def path_override(key: str, path: str | Path) -> str:
    """Return the override key=path with the path quoted, so that Hydra and OmegaConf keep every character of the path."""
    return f"{key}={_quoted_path(path)}"


def with_output(overrides: Sequence[str], output: str | Path | None) -> list[str]:
    """Return the overrides, and if the option --output is given, its override."""
    return [*overrides, *([path_override("output", output)] if output else [])]


def _quoted_path(path: str | Path) -> str:
    """Quote a path for OmegaConf, which halves backslashes before ${, and for Hydra, which halves them before a quote and at the end."""
    text = re.sub(r"(\\*)\$\{", lambda match: match.group(1) * 2 + "\\${", str(path))
    text = re.sub(r"(\\+)(?='|$)", lambda match: match.group(1) * 2, text).replace("'", "\\'")
    return f"'{text}'"


def _search_path(config_dirs: Sequence[Path]) -> list[str]:
    """Return a list with the override that adds folders to Hydra's search path; the list is empty if there are no folders."""
    for folder in config_dirs:
        if not folder.is_dir():
            raise MissingError(f"{folder}: no such folder of configuration files; give an existing folder with --config-dir")
    folders = [_quoted_path(f"file://{folder.resolve()}") for folder in config_dirs]
    return [f"hydra.searchpath=[{','.join(folders)}]"] if folders else []


@functools.cache
def _register_schemas() -> None:
    from hydra.core.config_store import ConfigStore
    from hydra.core.plugins import Plugins

    store = ConfigStore.instance()
    store.store(name="schema", node=Config)
    Plugins.instance()  # a first call registers the options of installed packages, of which `joblib` is replaced here
    store.store(group="hydra/launcher", name="joblib", node=JoblibLauncher)
    for group, schemas in SCHEMAS.items():
        for option, schema in schemas.items():
            store.store(group=group, name=f"schema_{option}", node=schema)


def _parse(overrides: Sequence[str]) -> list[Override]:
    from hydra.core.override_parser.overrides_parser import OverridesParser

    return OverridesParser.create().parse_overrides(list(overrides))


@contextlib.contextmanager
def _one_line_errors() -> Iterator[None]:
    """Within the `with` block, convert exceptions of Hydra and OmegaConf to a ConfigError with a message of one line."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(messages.explain(error)) from error
