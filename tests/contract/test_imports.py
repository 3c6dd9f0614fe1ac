"""The import contracts in pyproject.toml hold: one direction of data flow, no cycles, and few modules that import MLflow."""

from __future__ import annotations

from importlinter.cli import lint_imports


def test_import_contracts_hold() -> None:
    assert lint_imports(no_cache=True, show_timings=False) == 0, "run lint-imports to see which contract is broken"
