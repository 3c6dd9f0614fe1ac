"""From command-line overrides to a typed `Config`, with every mistake as one line.

Hydra and OmegaConf report the same mistake in several exceptions and many lines; `explain` reduces them to what is
wrong, where, and what would have been right. Hydra is imported on use: it costs a tenth of a second that `radartwin
--help` does not have.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import difflib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin.config.config import Config
from radartwin.config.trusted import check_secrets, check_targets
from radartwin.errors import ConfigError, MissingError

if TYPE_CHECKING:
    from omegaconf import DictConfig

CONFIG_NAME = "config"
_VALUE = re.compile(
    r"(?!hydra\.)(?:[A-Za-z_]\w*\.[\w.\[\]]+|seed|output)="
)  # key.below=value: no option of a group, nothing added or deleted
LAUNCHER_EXTRAS = {"joblib": "joblib", "submitit_slurm": "slurm", "submitit_local": "slurm"}  # option to the extra that brings it


def conf_dir() -> Path:
    """conf/ of the installed wheel, or of the checkout this package runs from."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "conf", package.parent / "conf"):
        if (folder / f"{CONFIG_NAME}.yaml").is_file():
            return folder
    raise MissingError(f"{package / 'conf'}: the configuration files are missing; install radartwin again")


def register() -> None:
    """Put the schema in Hydra's ConfigStore. Idempotent; every process that composes calls it."""
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    if "schema.yaml" not in store.repo:
        store.store(name="schema", node=Config)


def groups() -> dict[str, list[str]]:
    """Options of each group as shipped: {"scene": ["empty", "lab", ...], ...}."""
    folders = sorted(d for d in conf_dir().iterdir() if d.is_dir() and d.name != "hydra")
    return {d.name: sorted(f.stem for f in d.glob("*.yaml")) for d in folders}


def compose(overrides: Sequence[str] = (), config_dirs: Sequence[Path] = ()) -> Config:
    """The configuration that `overrides` describe, e.g. ["experiment=environment", "seed=1"].

    Args:
        config_dirs: folders searched for options besides the shipped ones (`--config-dir`).
    Raises:
        ConfigError: a wrong key, option, type or combination, in one line.
    """
    return Composer(config_dirs).compose(overrides)


class Composer:
    """Composes any number of configurations from the same folders.

    Reading the files costs a tenth of a second, so it is done once for each choice of options; values are then put in as
    Hydra does it itself.
    """

    def __init__(self, config_dirs: Sequence[Path] = ()) -> None:
        self._searched = search_override(config_dirs)
        self._read: dict[tuple[str, ...], DictConfig] = {}

    def compose(self, overrides: Sequence[str]) -> Config:
        """As `compose`."""
        from hydra._internal.config_loader_impl import ConfigLoaderImpl
        from hydra.core.override_parser.overrides_parser import OverridesParser

        register()
        overrides = quoted(overrides)
        with composing(overrides):
            values = [override for override in overrides if _VALUE.match(override)]
            options = tuple(override for override in overrides if override not in values)
            if options not in self._read:
                self._read[options] = self._of(options)
            composed = copy.deepcopy(self._read[options])
            parsed = OverridesParser.create().parse_overrides(values)
            for override in parsed:
                if override.is_sweep_override():
                    raise ConfigError(_several(str(override.key_or_group)))
            ConfigLoaderImpl._apply_overrides_to_config(parsed, composed)
            return typed(composed)

    def _of(self, options: Sequence[str]) -> DictConfig:
        import hydra
        from hydra.core.global_hydra import GlobalHydra
        from omegaconf import open_dict

        GlobalHydra.instance().clear()
        with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
            composed = hydra.compose(CONFIG_NAME, overrides=[*options, *self._searched], return_hydra_config=True)
        check_targets(composed)
        with open_dict(composed):
            del composed["hydra"]
        return composed


@contextlib.contextmanager
def composing(overrides: Sequence[str]) -> Iterator[None]:
    """What Hydra and OmegaConf find wrong with the overrides, as one ConfigError line."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    try:
        yield
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(explain(error)) from error
    except ConfigError:
        raise
    except ValueError as error:  # Hydra's word for a group that is given a number, a boolean or nothing
        for override in overrides:
            group, _, option = override.partition("=")
            if option not in (options := groups().get(group, [])):
                raise ConfigError(_unknown_option(f"{group}/{option}", options)) from error
        raise


def quoted(overrides: Sequence[str]) -> list[str]:
    """The overrides with options of a group that Hydra would read as a boolean in quotes: materials=true is an option's
    name.
    """
    named = [(group, option) for group, options in groups().items() for option in options if option in ("true", "false", "null")]
    out = list(overrides)
    for group, option in named:
        for i, override in enumerate(out):
            if override.startswith(f"{group}="):
                out[i] = re.sub(rf"(?<=[=,]){option}(?=,|$)", f"'{option}'", override)
    return out


def path_override(key: str, path: str | Path) -> str:
    """key=path, so that Hydra and OmegaConf take every sign in the path as it is."""
    return f"{key}={_quoted_path(path)}"


def search_override(config_dirs: Sequence[Path]) -> list[str]:
    """The override that makes Hydra look for options in these folders too; none if there are none."""
    folders = [_quoted_path(f"file://{check_folder(folder)}") for folder in config_dirs]
    return [f"hydra.searchpath=[{','.join(folders)}]"] if folders else []


def _quoted_path(path: str | Path) -> str:
    """OmegaConf halves backslashes before ${, and Hydra those before a quote or at the end; all others stay."""
    text = re.sub(r"(\\*)\$\{", lambda match: match.group(1) * 2 + "\\${", str(path))
    text = re.sub(r"(\\+)(?='|$)", lambda match: match.group(1) * 2, text).replace("'", "\\'")
    return f"'{text}'"


def check_folder(folder: Path) -> Path:
    if not folder.is_dir():
        raise MissingError(f"{folder}: no such folder of configuration files; --config-dir names an existing one")
    return folder.resolve()


def typed(composed: DictConfig) -> Config:
    """The dataclasses behind a composed DictConfig, their cross-field checks passed."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    _refuse_additions(composed)
    try:
        check_secrets(composed)
        config = OmegaConf.to_object(composed)
    except OmegaConfBaseException as error:
        raise ConfigError(explain(error)) from error
    if not isinstance(config, Config):
        raise ConfigError("the primary configuration has lost its schema; its defaults list must begin with 'schema'")
    return config


def _refuse_additions(node: DictConfig, path: str = "") -> None:
    """Hydra lets `+key=value` past the schema; a key no dataclass has would be ignored in silence."""
    from omegaconf import DictConfig, OmegaConf

    owner = OmegaConf.get_type(node)
    if not dataclasses.is_dataclass(owner):
        return
    known = {f.name for f in dataclasses.fields(owner)}
    for key in node:
        full_key = f"{path}{key}"
        if key not in known:
            raise ConfigError(_unknown_key(full_key, owner))
        if not OmegaConf.is_missing(node, key) and isinstance(child := node._get_node(key), DictConfig):
            _refuse_additions(child, f"{full_key}.")


def explain(error: BaseException) -> str:
    """One line for an exception of Hydra or OmegaConf: what is wrong, where, and what is right."""
    from hydra.errors import MissingConfigException, OverrideParseException
    from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

    chain = list(_causes(error))
    for cause in chain:
        if isinstance(cause, OverrideParseException):
            return f"cannot read the override '{cause.override}'; write group=option or key=value"
        if isinstance(cause, MissingConfigException) and cause.missing_cfg_file:
            return _unknown_option(cause.missing_cfg_file, cause.options or ())
    for cause in reversed(chain):
        if isinstance(cause, ConfigKeyError | ConfigAttributeError) and cause.full_key:
            return _unknown_key(cause.full_key, cause.object_type)
        if isinstance(cause, OmegaConfBaseException) and cause.full_key:
            return f"{cause.full_key}: {_first_line(cause)}"
    if match := re.match(r"Could not override '([^']+)'", str(error)):
        return _unknown_key(match.group(1), Config)
    if match := re.match(r"Ambiguous value for argument '([^']+)'", str(error)):
        return _several(match.group(1))
    return _first_line(error)


def _several(key: str) -> str:
    return f"{key} lists several values; add -m to run them as a sweep, or choose one"


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__


def _unknown_option(config_file: str, options: Sequence[str]) -> str:
    group, _, option = config_file.removesuffix(".yaml").rpartition("/")
    if group == "hydra/launcher" and (extra := LAUNCHER_EXTRAS.get(option)):
        return f"hydra/launcher={extra} needs an extra: pip install 'radartwin[{extra}]'"
    if not group:
        return f"there is no configuration '{option}'"
    known = ", ".join(sorted(options))
    return f"{group}={option} is not an option of {group}{_nearest(option, options)}; options: {known}"


def _unknown_key(full_key: str, owner: Any) -> str:
    parent, _, name = full_key.rpartition(".")
    keys = [f.name for f in dataclasses.fields(owner)] if dataclasses.is_dataclass(owner) else []
    where = f"{parent} has" if parent else "groups and keys are"
    known = f"; {where} {', '.join(keys)}" if keys else ""
    return f"there is no configuration key '{full_key}'{_nearest(name, keys)}{known}"


def _nearest(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean {near[0]}?)" if near else ""
