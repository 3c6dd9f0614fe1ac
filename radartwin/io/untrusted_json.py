"""JSON of strangers: no larger than any of ours, and nested too deeply is malformed like anything else that cannot be read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

MAX_BYTES = 256 << 20  # parsed it takes up to twenty times as much; 10,000 poses are 4 MB


def load(text: str | bytes) -> Any:
    """The content of a JSON text. Raises ValueError for one that is malformed, nested too deeply, or too large.

    >>> load("[" * 100_000)
    Traceback (most recent call last):
    ValueError: it is nested too deeply
    """
    if len(text) > MAX_BYTES:
        raise ValueError(f"it has more than {MAX_BYTES:,} bytes")
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read(path: Path) -> Any:
    """The content of a JSON file in UTF-8. Raises ValueError as `load`, before a file that is too large is read; OSError."""
    with path.open("rb") as stream:
        content = stream.read(MAX_BYTES + 1)
    return load(content.decode("utf-8"))
