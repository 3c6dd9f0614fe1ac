"""Find simulators, material sources, feature sets, encoders and experiments that other installed packages provide.

A package names its plug-ins in the entry points of one of GROUPS (docs/extending.md), for example

    [project.entry-points."radartwin.simulators"]
    echoes = "echo_package.backend:EchoBackend"
"""

from __future__ import annotations

import contextlib
import functools
import re
import sys
import traceback
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from radartwin.errors import InputError, UserError

SIMULATORS, MATERIALS, FEATURES, ENCODERS, EXPERIMENTS = GROUPS = (
    "radartwin.simulators", "radartwin.materials", "radartwin.features", "radartwin.encoders", "radartwin.experiments",
)  # fmt: skip
_NAME = re.compile(r"[A-Za-z_]\w*")


class PluginError(InputError):
    """Raised if a plug-in clashes with another name, cannot be imported or does not provide what its group needs."""


@dataclass(frozen=True)
class Plugin:
    """One plug-in: its group and name, the distribution that provides it, and the object, as "module" or "module:attribute"."""

    group: str
    name: str
    package: str
    value: str

    @property
    def module(self) -> str:
        return self.value.partition(":")[0].strip()

    def __str__(self) -> str:
        return f"plug-in '{self.name}' of package {self.package} ({self.group})"


def names(group: str) -> list[str]:
    """Return the names of the plug-ins of a group, sorted."""
    return sorted({plugin.name for plugin in _installed(tuple(sys.path)) if plugin.group == group})


def check(group: str, name: str, built_in: Collection[str]) -> None:
    """Raise PluginError if the plug-in's name is not valid, if several packages provide it, or if an option in `built_in` has it."""
    plugins = _plugins(group, name)
    if plugins and name in built_in:
        raise PluginError(f"{plugins[0]} has the name of a built-in option; uninstall {plugins[0].package}, or rename the plug-in")
    if len(plugins) > 1:
        packages = " and ".join(plugin.package for plugin in plugins)
        raise PluginError(f"packages {packages} both provide '{name}' in {group}; uninstall one of them")
    if plugins and not _NAME.fullmatch(name):
        raise PluginError(
            f"{plugins[0]}: a name may hold only letters, digits and underscores, and no digit at its start; rename the plug-in"
        )


def find(group: str, name: str, built_in: Collection[str] = ()) -> Plugin | None:
    """Return the plug-in of this name; None if no package provides it. Raises PluginError, see `check`."""
    check(group, name, built_in)
    return next(iter(_plugins(group, name)), None)


@functools.cache
def load(plugin: Plugin) -> Any:
    """Import a plug-in and return its object. If the import fails, raise a PluginError whose one-line message names the package."""
    try:
        return metadata.EntryPoint(plugin.name, plugin.value, plugin.group).load()
    except (Exception, SystemExit) as error:  # code of another package may raise anything
        raise refusal(plugin, f"its import raised {type(error).__name__}: {_first_line(error)}") from error


def refusal(plugin: Plugin, reason: str) -> PluginError:
    """Return an error whose message says that the plug-in cannot be used, and gives the reason."""
    return PluginError(f"{plugin} cannot be used: {reason}; correct or uninstall {plugin.package}")


def _plugins(group: str, name: str) -> list[Plugin]:
    return [plugin for plugin in _installed(tuple(sys.path)) if (plugin.group, plugin.name) == (group, name)]


@functools.cache
def _installed(path: tuple[str, ...]) -> tuple[Plugin, ...]:
    """Return the plug-ins of all packages on the import path `path`, which is sys.path."""
    entries = (entry for group in GROUPS for entry in metadata.entry_points(group=group))
    return tuple(Plugin(entry.group, entry.name, entry.dist.name if entry.dist else "", entry.value) for entry in entries)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [""])[0]


@contextlib.contextmanager
def calling(plugin: Plugin, what: str) -> Iterator[None]:
    """Within the `with` block, convert an exception of a plug-in's code to a PluginError in one line. A UserError stays unchanged."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:  # code of another package may raise anything
        frames = traceback.extract_tb(error.__traceback__)
        place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
        raise refusal(plugin, f"{what} raised {type(error).__name__}: {_first_line(error)}{place}") from error
