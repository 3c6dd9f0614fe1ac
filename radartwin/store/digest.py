"""Compute the SHA-256 digests of configuration, source code and input files, from which the keys of stored results are formed.

The digest of source code covers whole packages (folders two levels deep, such as radartwin.simulation): every one with a module that the
computation imports, and the versions of NUMERICAL. Comments, docstrings, formatting and imports for type checkers do not change it.
"""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin import source_files
from radartwin.errors import ConfigError, MissingError, OutputError
from radartwin.io import files

if TYPE_CHECKING:
    import numpy as np


def spec_digest(spec: Any) -> str:
    """Return the digest of a tree of dictionaries (in any order of keys), lists, arrays, dataclasses and scalars."""
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
    """Return the keyed fields of a dataclass. The path of a file is replaced by the digest of its content."""
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
    """Return the digest of a file's bytes, or of the names and bytes of all files in a folder. Raises MissingError if it is absent."""
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
    versions of NUMERICAL. Raises ConfigError if an entry is neither a module nor a package.
    """
    return _source_digest(tuple(entries))


@functools.cache
def _source_digest(entries: tuple[str, ...]) -> str:
    for entry in entries:
        if not source_files.members(entry):
            raise ConfigError(f"there is no module or package '{entry}'")
    packages = sorted({".".join(name.split(".")[:2]) for name in source_files.closure(entries)})
    modules = sorted({name for package in packages for name in source_files.members(package)})
    count = len(_known())
    parts = [f"{name} {_code_digest(name)}\n" for name in modules]
    if len(_known()) > count:
        with contextlib.suppress(OutputError):  # if the folder cannot be written, every process computes the digests
            files.write_atomically(KNOWN, json.dumps(_known()))
    parts += [_data_digest(package) for package in packages]
    parts += [f"{name} {_version(name)}\n" for name in NUMERICAL]
    return hashlib.sha256("".join(parts).encode()).hexdigest()


@functools.cache
def _code_digest(name: str) -> str:
    """Return the digest of a module's syntax tree without docstrings. The file KNOWN keeps it, because those of all modules take 2 s."""
    text = source_files.text(name)
    content = hashlib.sha256(text.encode()).hexdigest()
    if content not in _known():
        _known()[content] = _tree_digest(text)
    return _known()[content]


@functools.cache
def _known() -> dict[str, str]:
    """Return the digests of the syntax trees of source files by the digests of their contents."""
    try:
        return json.loads(KNOWN.read_text())
    except (OSError, ValueError):
        return {}


def _tree_digest(text: str) -> str:
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


@functools.cache
def _data_digest(package: str) -> str:
    """Return names and digests of the data files that the modules of a package read; empty for a name that is no package."""
    folder = source_files.location(package)
    if not folder or package.count(".") != 1 or not folder.is_dir():
        return ""
    data_files = sorted(file for file in folder.rglob("*") if file.suffix in DATA and file.name != WRITTEN)
    return "".join(f"{file.relative_to(folder)} {hashlib.sha256(file.read_bytes()).hexdigest()}\n" for file in data_files)


@functools.cache
def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def include(top: str) -> None:
    """Include a further top-level package in source digests, such as the user's experiment. Otherwise all source files stay read."""
    if top not in source_files.OWN:
        source_files.include(top)
        forget()


def forget() -> None:
    """Forget all source code that has been read, so that the next digest reads the files again."""
    source_files.forget()
    for function in (_source_digest, _code_digest, _known, _data_digest, _version):
        function.cache_clear()


# Another Python or another version of this module has a file of its own. The suffix is none of DATA, because the file would count.
KNOWN = Path(__file__).parent / "__pycache__" / f"{sys.implementation.cache_tag}-{path_digest(Path(__file__))[:8]}.digests"
DATA = (".csv", ".json", ".npz", ".yaml")  # suffixes of data files
WRITTEN = "bench_history.csv"  # `make bench` adds lines to this file, and no result depends on the file
# Installed packages whose functions compute the stored numbers
NUMERICAL = (
    "drjit", "fast-simplification", "mapbox_earcut", "miepython", "mitsuba", "networkx", "numba", "numpy", "scikit-image", "scikit-learn",
    "scipy", "shapely", "sionna-rt", "torch", "trimesh",
)  # fmt: skip
