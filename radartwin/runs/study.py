"""Import experiments/ and analysis/, which are in a checkout of the repository but not in the wheel."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

from radartwin.errors import MissingError


def add_to_path() -> Path | None:
    """Make experiments/ and analysis/ importable. Returns the root of their checkout, or None outside a checkout."""
    for root in (Path(__file__).resolve().parents[2], Path.cwd()):
        if (root / "experiments" / "__init__.py").is_file() and (root / "analysis" / "__init__.py").is_file():
            if str(root) not in sys.path:
                sys.path.insert(0, str(root))
            return root
    return None


def module(name: str) -> ModuleType:
    """Import and return a module of experiments/ or analysis/ by name. Raises MissingError outside a checkout."""
    if add_to_path() is None:
        raise MissingError("tables and the report need experiments/ and analysis/; run this from a checkout of the repository")
    return importlib.import_module(name)
