"""Remove the values of secret environment variables (keys and passwords) from a text before the text is logged, shown or stored."""

from __future__ import annotations

import os

VARIABLES = ("RADARTWIN_VLM_KEY", "MLFLOW_TRACKING_PASSWORD", "MLFLOW_TRACKING_TOKEN", "HF_TOKEN")
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
