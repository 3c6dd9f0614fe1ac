"""Build the distributions of the checkout as pip does."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Literal

ROOT = Path(__file__).resolve().parents[2]


def build(kind: Literal["wheel", "sdist"], folder: Path) -> Path:
    """Build a distribution in the folder and return the path of its archive."""
    code = f"import sys, hatchling.build as b; print(b.build_{kind}(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", code, str(folder)], cwd=ROOT, capture_output=True, check=True)
    (archive,) = folder.iterdir()
    return archive
