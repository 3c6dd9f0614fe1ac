"""Read JSON from untrusted sources, with limits on size and nesting depth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

MAX_BYTES = 256 << 20  # parsed JSON takes up to twenty times the memory of its text; 10,000 poses are 4 MB of JSON text


def load(text: str | bytes) -> Any:
    """Parse a JSON text. Raises ValueError if the text is malformed, nested too deeply or too large.

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
    """Parse a JSON file in UTF-8, with or without a byte order mark, of which at most MAX_BYTES are read.

    Raises ValueError for the same reasons as `load`, and OSError.
    """
    with path.open("rb") as stream:
        content = stream.read(MAX_BYTES + 1)
    return load(content.decode("utf-8-sig"))
