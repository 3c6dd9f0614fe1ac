"""What a result depends on, as SHA-256: the meaning of its configuration, the source of its code, its input files.

A key must change with everything that could change a number and with nothing else. So the configuration enters without
paths, launcher and verbosity; source enters as its syntax tree, where comments, docstrings and layout do not count,
over the static import closure of the modules a stage names; files enter by content.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import hashlib
import importlib.util
import json
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from radartwin.errors import ConfigError, MissingError

PACKAGES = ("radartwin", "experiments")  # whose source counts; everything else is pinned by constraints.txt


def spec_digest(spec: Any) -> str:
    """Of a tree of dictionaries, lists and scalars; the order of dictionary keys does not matter."""
    return hashlib.sha256(canonical(spec).encode()).hexdigest()


def canonical(spec: Any) -> str:
    return json.dumps(_plain(spec), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return semantic(value)
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if tolist := getattr(value, "tolist", None):  # NumPy arrays and scalars
        return _plain(tolist())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, str | int | float | bool):
        return value
    raise TypeError(f"a key cannot be made of {type(value).__name__}: {value!r}")


def semantic(description: Any) -> dict[str, Any]:
    """What a dataclass says is computed: without its unkeyed fields, paths replaced by the digest of their content."""
    out = {}
    for field in dataclasses.fields(description):
        value = getattr(description, field.name)
        if field.metadata.get("unkeyed"):
            continue
        if field.metadata.get("path") and value is not None:
            value = path_digest(Path(value))
        out[field.name] = _plain(value)
    return out


def path_digest(path: Path) -> str:
    """Of a file's bytes, or of a folder's relative names and bytes."""
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


def source_digest(roots: Iterable[str]) -> str:
    """Of the modules in `roots` and all they import, directly or not, within PACKAGES.

    Raises:
        ConfigError: a root that is no module.
    """
    for root in roots:
        if _source(root) is None:
            raise ConfigError(f"there is no module '{root}'")
    lines = (f"{name} {_tree_digest(name)}\n" for name in sorted(import_closure(tuple(roots))))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


@functools.cache
def import_closure(roots: tuple[str, ...]) -> frozenset[str]:
    """Names of the modules reached from `roots` by import statements, those inside functions included."""
    reached: set[str] = set()
    waiting = list(roots)
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting.extend(imports(name))
    return frozenset(reached)


@functools.cache
def imports(name: str) -> frozenset[str]:
    """Modules of PACKAGES that the module `name` imports, with the packages that contain them."""
    path = _source(name)
    if path is None:
        return frozenset()
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found: set[str] = set()
    for node in _executed(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                found |= {alias.name, *_on_demand(alias.name).values()}
        elif isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            for alias in node.names:
                submodule = f"{base}.{alias.name}"
                found |= {base, submodule if _source(submodule) else _on_demand(base).get(alias.name, base)}
    return frozenset(_parents(m for m in found if _source(m)) - {name})


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a module without what only a type checker reads."""
    for node in ast.iter_child_nodes(tree):
        if not (isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")):
            yield node
            yield from _executed(node)


@functools.cache
def _on_demand(package: str) -> dict[str, str]:
    """Names a package loads on first use and the modules they come from: the dictionary its `__getattr__` looks in."""
    path = _source(package)
    if path is None or path.name != "__init__.py":
        return {}
    homes: dict[str, str] = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and isinstance(value, ast.Constant) and _source(str(value.value)):
                    homes[str(key.value)] = str(value.value)
    return homes


def _parents(names: Iterable[str]) -> set[str]:
    return {".".join(parts[:n]) for parts in (name.split(".") for name in names) for n in range(1, len(parts) + 1)}


@functools.cache
def _source(name: str) -> Path | None:
    """Source file of a module of PACKAGES or of a user's experiment, found without importing; None for others."""
    top, _, rest = name.partition(".")
    root = _package_root(top)
    if root is None:
        return None
    base = root.joinpath(*rest.split(".")) if rest else root
    for candidate in (base.with_suffix(".py") if rest else root, base / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


def _package_root(top: str) -> Path | None:
    if top == "radartwin":
        return Path(__file__).resolve().parents[1]
    if top not in PACKAGES and top not in _extra:
        return None
    spec = importlib.util.find_spec(top)
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    return Path(spec.origin) if spec.origin else None


_extra: set[str] = set()


def include(top: str) -> None:
    """Let the source of one more top-level package or module count: a user's own experiment."""
    _extra.add(top)
    _source.cache_clear()


@functools.cache
def _tree_digest(name: str) -> str:
    path = _source(name)
    assert path is not None
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body[0] = ast.Pass()
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()
