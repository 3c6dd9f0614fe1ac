"""Find the checkout of the repository, its commit, and its folders experiments/ and analysis/, which the Python wheel does not contain."""

from __future__ import annotations

import functools
import importlib
import subprocess
import sys
import warnings
from pathlib import Path
from types import ModuleType

from radartwin.errors import MissingError
from radartwin.io.one_line import one_line

ROOT = Path(__file__).resolve().parents[2]


@functools.cache
def commit() -> tuple[str, bool]:
    """Return the commit of this package's checkout, and whether files differ from the commit; ("none", False) outside a checkout.

    If git fails, warn with its message and return ("unknown", True), because changes cannot be excluded.
    """
    if not (ROOT / ".git").exists():
        return "none", False
    questions = ("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no")
    try:
        head, changed = (subprocess.check_output(["git", "-C", str(ROOT), *words], stderr=subprocess.PIPE) for words in questions)
    except (OSError, subprocess.CalledProcessError) as error:
        reason = error.stderr.decode(errors="replace") if isinstance(error, subprocess.CalledProcessError) else str(error)
        warnings.warn(f"git cannot read the commit of {ROOT}, so results name an unknown commit: {one_line(reason)}", stacklevel=2)
        return "unknown", True
    return head.decode().strip(), bool(changed)


def add_to_path() -> Path | None:
    """Make experiments/ and analysis/ importable. Returns the root of their checkout, or None outside a checkout."""
    for root in (ROOT, Path.cwd()):
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
