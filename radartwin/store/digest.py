"""Compute the SHA-256 digests of a configuration, of source code and of input files. The keys of stored results are formed from these
digests.

The key of a stored result must change whenever the result could change. The digest of source code covers whole packages: every package with
a module that the computation imports, directly or indirectly. In this module, a package is a folder two levels deep, such as
radartwin.simulation; a file in radartwin/ itself counts as its own package. Comments, docstrings, code formatting and imports for type
checkers do not change the digest of source code. The versions of the installed packages in NUMERICAL change the digest.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import gc
import hashlib
import importlib
import importlib.metadata
import importlib.util
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin.errors import ConfigError, MissingError

if TYPE_CHECKING:
    import numpy as np


def spec_digest(spec: Any) -> str:
    """Return the digest of a tree of dictionaries, lists, arrays, dataclasses and scalars. The order of dictionary keys does not change the
    digest.
    """
    return hashlib.sha256(canonical(spec).encode()).hexdigest()


def canonical(spec: Any) -> str:
    """Convert the tree to a JSON text with sorted keys. Raises TypeError for a value that JSON cannot represent."""
    return json.dumps(_plain(spec), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _plain(value: Any) -> Any:
    if type(value) in (str, int, bool, type(None)):  # first, because most values are of these types
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return semantic(value)
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if tolist := getattr(value, "tolist", None):  # NumPy arrays and scalars
        return tolist() if _all_finite(value) else _plain(tolist())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, str | int | float | bool):
        return value
    raise TypeError(f"a key cannot be made of {type(value).__name__}: {value!r}")


def _all_finite(array: Any) -> bool:
    """Return whether a NumPy array or scalar has only finite real numbers, which need no conversion."""
    import numpy as np

    return array.dtype.kind in "biuf" and bool(np.isfinite(array).all())


def semantic(description: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that influence a result. Fields marked `unkeyed` are left out, and the path of a file is replaced by
    the digest of its content.
    """
    out = {}
    for field in dataclasses.fields(description):
        value = getattr(description, field.name)
        if field.metadata.get("unkeyed"):
            continue
        if field.metadata.get("path") and value is not None:
            value = path_digest(Path(value))
        out[field.name] = _plain(value)
    return out


def array_digest(array: np.ndarray) -> str:
    """Return the digest of an array's data type, shape and bytes. For large arrays this function is faster than `spec_digest`."""
    total = hashlib.sha256(f"{array.dtype.str} {array.shape}:".encode())
    total.update(array.tobytes())
    return total.hexdigest()


def path_digest(path: Path) -> str:
    """Return the digest of a file's bytes, or of the relative names and bytes of all files in a folder. Raises MissingError if the path is
    absent.
    """
    if path.is_file():
        files = [path]
    elif path.is_dir():
        files = sorted(p for p in path.rglob("*") if p.is_file())
    else:
        raise MissingError(f"{path}: no such file or folder")
    total = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            content = hashlib.file_digest(stream, "sha256").hexdigest()
        total.update(f"{file.relative_to(path).as_posix()} {content}\n".encode())
    return total.hexdigest()


def source_digest(entries: Iterable[str]) -> str:
    """Return the digest of the source code of all packages that the modules in `entries` import, directly or indirectly, and of the
    installed versions of the packages in NUMERICAL.

    Args:
        entries: modules or packages where the computation starts, such as "experiments.campaign.truth" or "radartwin.simulation".
    Raises:
        ConfigError: an entry is neither a module nor a package.
    """
    return _source_digest(tuple(entries))


@functools.cache
def _source_digest(entries: tuple[str, ...]) -> str:
    for entry in entries:
        if not _members(entry):
            raise ConfigError(f"there is no module or package '{entry}'")
    packages = {".".join(name.split(".")[:2]) for name in import_closure(entries)}
    modules = sorted({name for package in packages for name in _members(package)})
    parts = [f"{name} {_parsed(name)[1]}\n" for name in modules]
    parts += [_data_digest(package) for package in sorted(packages)]
    parts += [f"{name} {_version(name)}\n" for name in NUMERICAL]
    return hashlib.sha256("".join(parts).encode()).hexdigest()


@functools.cache
def _data_digest(package: str) -> str:
    """Return names and digests of the data files that the modules of a package read; empty for a name that is no package."""
    folder = _location(package)
    if not folder or package.count(".") != 1 or not folder.is_dir():
        return ""
    found = sorted(file for file in folder.rglob("*") if file.suffix in DATA and file.name != WRITTEN)
    return "".join(f"{file.relative_to(folder)} {hashlib.sha256(file.read_bytes()).hexdigest()}\n" for file in found)


@functools.cache
def import_closure(entries: tuple[str, ...]) -> frozenset[str]:
    """Return the modules of radartwin and experiments that the modules in `entries` import, directly or indirectly, including imports
    inside functions.
    """
    reached: set[str] = set()
    waiting = [*_with_parents(name for entry in entries for name in _members(entry))]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting.extend(_imports(name))
    return frozenset(reached)


def include(top: str) -> None:
    """Include a further top-level package or module in source digests, such as the module of a user's own experiment."""
    if top not in _tops:
        _tops.add(top)
        forget()


def forget() -> None:
    """Forget all source code that has been read, so that the next digest reads the files again."""
    for function in (_source_digest, _data_digest, import_closure, _imports, _parsed, _source, _version):
        function.cache_clear()


DATA = (".csv", ".json", ".npz", ".yaml")  # suffixes of data files
WRITTEN = "bench_history.csv"  # `make bench` adds lines to this file, and no result depends on the file
# Installed packages whose functions compute the stored numbers
NUMERICAL = (
    "drjit", "fast-simplification", "mapbox_earcut", "miepython", "mitsuba", "networkx", "numba", "numpy", "scikit-image", "scikit-learn",
    "scipy", "shapely", "sionna-rt", "torch", "trimesh",
)  # fmt: skip
_tops = {"radartwin", "experiments"}
_HOMES: dict[str, str] = importlib.import_module("radartwin")._HOMES  # by name, so that this module imports no module above it


def _members(name: str) -> list[str]:
    """Return the modules of a package two levels deep. For a name that is not such a package, return the name itself if it is a module, and
    [] if no such module exists.
    """
    folder = _location(name)
    if name.count(".") == 1 and folder and folder.is_dir():
        parts = (path.relative_to(folder).with_suffix("").parts for path in sorted(folder.rglob("*.py")))
        return [".".join((name, *part)).removesuffix(".__init__") for part in parts]
    return [name] if _source(name) else []


@functools.cache
def _imports(name: str) -> frozenset[str]:
    """Return the modules that a module imports, also inside functions, but not those that it imports only for a type checker."""
    path = _source(name)
    assert path is not None
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    imported: set[str] = set()
    for node in _parsed(name)[0]:
        names = {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            names = {base, *(f"{base}.{each}" for each in names)}
        for each in names:  # `radartwin` imports the modules of its public names on first use
            lazy = _HOMES.values() if isinstance(node, ast.Import) and each == "radartwin" else ()
            imported |= {_HOMES.get(each.removeprefix("radartwin."), each), each, *lazy}
    return _with_parents(imported) - {name}


def _with_parents(names: Iterable[str]) -> frozenset[str]:
    """Return the modules among `names`, and the packages that contain them, because Python runs the __init__.py of a package before its
    modules.
    """
    parents = {".".join(parts[:n]) for parts in (name.split(".") for name in names) for n in range(1, len(parts) + 1)}
    return frozenset(name for name in parents if _source(name))


@functools.cache
def _parsed(name: str) -> tuple[list[ast.Import | ast.ImportFrom], str]:
    """Return the import statements of a module and the digest of its code, without docstrings and blocks that only a type checker reads."""
    path, collecting = _source(name), gc.isenabled()
    assert path is not None
    gc.disable()  # a syntax tree has no reference cycles, and the search for cycles would take most of the time
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and ast.get_docstring(node) is not None:
                node.body = node.body[1:] or [ast.Pass()]
            elif isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
                node.body = [ast.Pass()]
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
        return imports, hashlib.sha256(ast.dump(tree).encode()).hexdigest()
    finally:
        if collecting:
            gc.enable()


@functools.cache
def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


@functools.cache
def _source(name: str) -> Path | None:
    """Find the source file of a module without importing the module. Returns None if the module has no file or is outside the digested
    packages.
    """
    location = _location(name)
    if location is None:
        return None
    return next((file for file in (location.with_name(f"{location.name}.py"), location / "__init__.py") if file.is_file()), None)


def _location(name: str) -> Path | None:
    """Return the path of a module's file or folder, without suffix."""
    top, *rest = name.split(".")
    if top not in _tops:
        return None
    if top == "radartwin":
        return Path(__file__).resolve().parents[1].joinpath(*rest)
    spec = importlib.util.find_spec(top)
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))).joinpath(*rest)
    return None if rest or not spec.origin else Path(spec.origin).with_suffix("")
