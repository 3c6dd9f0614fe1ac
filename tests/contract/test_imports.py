"""Arrows point down the data flow: a module imports only from its own layer and the ones before it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# What each part may import besides itself and the shared leaves. The platform (configuration, store, runner) comes
# last in the library: nothing in the data flow knows of it.
LEAVES = {"chat", "compiled", "errors", "constants", "files", "memory", "picture_file", "plain_json", "plain_yaml", "plotting", "progress"}
FLOW: dict[str, set[str]] = {
    "materials": set(),
    "scene": {"materials"},
    "label": {"materials", "scene"},
    "reconstruct": {"materials", "scene", "label"},
    "radar": set(),
    "simulation": {"materials", "scene", "radar"},
    "measured": {"materials", "scene", "radar", "simulation"},
    "features": {"radar"},
    "recognize": {"features", "radar"},
    "adaptive": {"materials", "scene", "radar", "simulation", "features"},
}
HEAVY = {"mlflow": {"radartwin.runs.tracking", "radartwin.runs.artifacts"}}


def modules(package: str) -> dict[str, Path]:
    """Every module of a package by dotted name."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(name: str, path: Path) -> set[str]:
    """Dotted names a module imports, wherever in it the statement stands."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join([*package.split(".")[: len(package.split(".")) - node.level + 1], *filter(None, [node.module])])
            source = base if node.level else str(node.module)
            names |= {f"{source}.{alias.name}" for alias in node.names}
    return names


LIBRARY = modules("radartwin")


@pytest.mark.parametrize("name", LIBRARY)
def test_the_library_does_not_know_the_study(name: str) -> None:
    tops = {target.partition(".")[0] for target in imported(name, LIBRARY[name])}
    assert not tops & {"experiments", "analysis", "tests"}


@pytest.mark.parametrize("name", modules("experiments"))
def test_an_experiment_does_not_know_how_it_is_presented(name: str) -> None:
    tops = {target.partition(".")[0] for target in imported(name, modules("experiments")[name])}
    assert not tops & {"analysis", "tests"}


@pytest.mark.parametrize("name", [name for name in LIBRARY if name.count(".") >= 1 and name.split(".")[1] in FLOW])
def test_the_data_flow_has_one_direction(name: str) -> None:
    part = name.split(".")[1]
    allowed = {part} | FLOW[part] | LEAVES
    for target in imported(name, LIBRARY[name]):
        if target.startswith("radartwin."):
            assert target.split(".")[1] in allowed, f"{name} imports {target}"


@pytest.mark.parametrize("heavy", HEAVY)
def test_a_heavy_dependency_has_one_owner(heavy: str) -> None:
    owners = {n for n, p in LIBRARY.items() if any(t.partition(".")[0] == heavy for t in imported(n, p))}
    assert owners == HEAVY[heavy]


def test_every_part_of_the_flow_is_listed() -> None:
    folders = {p.name for p in (ROOT / "radartwin").iterdir() if (p / "__init__.py").is_file()}
    assert folders <= set(FLOW)
