"""Remove the values of secret environment variables (keys and passwords) from a text before the text is logged, shown or stored."""

from __future__ import annotations

import os
import sys
from typing import Any

VARIABLES = ("RADARTWIN_VLM_KEY", "RADARTWIN_LLM_KEY", "MLFLOW_TRACKING_PASSWORD", "MLFLOW_TRACKING_TOKEN", "HF_TOKEN")
SHORTEST = 6  # characters; a shorter value may occur in any text by chance
HIDDEN = "***"


def hidden(text: str, *more: str | None) -> str:
    """Replace the values of the environment variables in VARIABLES, and the strings in `more`, by *** in a text.

    Messages need this replacement because error texts of servers and libraries may repeat a key.

    >>> hidden("invalid key abc-123-def", "abc-123-def")
    'invalid key ***'
    """
    for value in (*(os.environ.get(name) for name in VARIABLES), *more):
        for form in {value, value.strip()} if value else ():
            if len(form) >= SHORTEST:
                text = text.replace(form, HIDDEN).replace(repr(form)[1:-1], HIDDEN)
    return text


def one_line(message: object) -> str:
    """Return a message as one line, without secrets from environment variables and without control characters, which a file name may
    contain.
    """
    return "".join(sign if sign.isprintable() else "?" for sign in " ".join(hidden(str(message)).split()))


def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a warning as one line, in the place of `warnings.showwarning`."""
    print(f"radartwin: warning: {one_line(message)}", file=sys.stderr)
