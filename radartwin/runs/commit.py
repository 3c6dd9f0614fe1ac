"""Find the git commit of the checkout that computes a result."""

from __future__ import annotations

import functools
import subprocess
from pathlib import Path


@functools.cache
def commit() -> tuple[str, bool]:
    """Return the commit of this package's checkout, and whether files differ from the commit; ("none", False) outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return "none", False
    questions = ("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no")
    try:
        head, changed = (subprocess.check_output(["git", "-C", str(root), *words], stderr=subprocess.DEVNULL) for words in questions)
    except (OSError, subprocess.CalledProcessError):
        return "none", False
    return head.decode().strip(), bool(changed)
