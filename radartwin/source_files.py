"""Find the source files of modules, and the modules that they import, without importing them.

The keys of stored results (radartwin/store/digest.py) and of compiled machine code (radartwin/compiled.py) depend on these files.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import re
from collections.abc import Callable, Iterable
from pathlib import Path

_IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|.*)|import[ \t]+(.*))", re.MULTILINE)
_FOR_TYPE_CHECKERS = re.compile(r"^([ \t]*)if (?:typing\.)?TYPE_CHECKING:\n(?:\1[ \t].*\n|\n)+", re.MULTILINE)
OWN = ("radartwin", "experiments")
_tops = {*OWN}


def include(top: str) -> None:
    """Also find the modules of a further top-level package or module, such as the module of a user's own experiment."""
    _tops.add(top)


def forget() -> None:
    """Forget all source files that have been read."""
    for function in (closure, text, source, _imports):
        function.cache_clear()


@functools.cache
def closure(entries: tuple[str, ...], follows: Callable[[str], bool] = lambda name: True) -> frozenset[str]:
    """Return the modules of the included packages that the modules or packages in `entries` import, directly or indirectly, and the
    entries themselves. Imports inside functions count, but not imports for type checkers.

    follows: whether the imports of a module are included.
    """
    reached: set[str] = set()
    waiting = [*_with_parents(name for entry in entries for name in members(entry))]
    while waiting:
        if (name := waiting.pop()) not in reached:
            reached.add(name)
            waiting.extend(_imports(name) if follows(name) else ())
    return frozenset(reached)


def members(name: str) -> list[str]:
    """Return the modules of a package two levels deep. For a name that is not such a package, return the name itself if it is a module, and
    [] if no such module exists.
    """
    folder = location(name)
    if name.count(".") == 1 and folder and folder.is_dir():
        parts = (path.relative_to(folder).with_suffix("").parts for path in sorted(folder.rglob("*.py")))
        return [".".join((name, *part)).removesuffix(".__init__") for part in parts]
    return [name] if source(name) else []


@functools.cache
def text(name: str) -> str:
    """Return the source code of a module without the blocks that only a type checker reads."""
    path = source(name)
    assert path is not None
    return _FOR_TYPE_CHECKERS.sub("", path.read_text(encoding="utf-8"))


@functools.cache
def source(name: str) -> Path | None:
    """Return the source file of a module, or None if the module has no file or is outside the included packages."""
    if (path := location(name)) is None:
        return None
    return next((file for file in (path.with_name(f"{path.name}.py"), path / "__init__.py") if file.is_file()), None)


def location(name: str) -> Path | None:
    """Return the path of a module's file or folder, without suffix."""
    top, *rest = name.split(".")
    spec = importlib.util.find_spec(top) if top in _tops else None
    if spec and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))).joinpath(*rest)
    return Path(spec.origin).with_suffix("") if spec and spec.origin and not rest else None


@functools.cache
def _imports(name: str) -> frozenset[str]:
    package = name if (path := source(name)) and path.name == "__init__.py" else name.rpartition(".")[0]
    return imports_of(text(name), package) - {name}


def imports_of(code: str, package: str) -> frozenset[str]:
    """Return the modules of the included packages that the source code of a module in `package` imports."""
    homes: dict[str, str] = getattr(importlib.import_module("radartwin"), "_HOMES", {})
    imported: set[str] = set()
    for base, names, whole in _IMPORT.findall(code):
        if base:
            base = importlib.util.resolve_name(base, package)
            imported |= {base, *(f"{base}.{each}" for each in re.findall(r"\w+", names))}
        else:
            modules = {each.split()[0] for each in whole.split(",") if each.strip()}
            imported |= modules | set(homes.values() if "radartwin" in modules else ())
    # `radartwin` imports the modules of its public names on first use
    return _with_parents(homes.get(each.removeprefix("radartwin."), each) for each in imported)


def _with_parents(names: Iterable[str]) -> frozenset[str]:
    """Return the modules among `names`, and the packages that contain them, because Python runs the __init__.py of a package before its
    modules.
    """
    parents = {".".join(parts[:n]) for parts in (name.split(".") for name in names) for n in range(1, len(parts) + 1)}
    return frozenset(name for name in parents if source(name))
