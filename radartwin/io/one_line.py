"""Write messages and warnings in one line each, and counts with their nouns."""

from __future__ import annotations

import sys
from typing import Any

from radartwin.io.secret import hidden


def one_line(message: object) -> str:
    """Return a message as one line, without secrets from environment variables and without control characters."""
    return "".join(sign if sign.isprintable() else "?" for sign in " ".join(hidden(str(message)).split()))


def plural(count: int, noun: str) -> str:
    """Return a count with its noun, which is plural unless the count is 1.

    >>> plural(1, "frame"), plural(2, "frame")
    ('1 frame', '2 frames')
    """
    return f"{count} {noun}{'' if count == 1 else 's'}"


def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a warning as one line, in the place of `warnings.showwarning`."""
    print(f"radartwin: warning: {one_line(message)}", file=sys.stderr)
