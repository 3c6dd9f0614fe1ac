"""Remove keys and passwords of the environment from text before it is logged, shown or stored."""

from __future__ import annotations

import os

VARIABLES = ("RADARTWIN_VLM_KEY", "RADARTWIN_LLM_KEY", "MLFLOW_TRACKING_PASSWORD", "MLFLOW_TRACKING_TOKEN", "HF_TOKEN")
SHORTEST = 6  # characters; a shorter value may occur in any text by chance
HIDDEN = "***"


def hidden(text: str, *more: str | None) -> str:
    """The text without the values of VARIABLES and of `more`. Error messages of servers and libraries may repeat them.

    >>> hidden("invalid key abc-123-def", "abc-123-def")
    'invalid key ***'
    """
    for value in (*(os.environ.get(name) for name in VARIABLES), *more):
        for form in {value, value.strip()} if value else ():
            if len(form) >= SHORTEST:
                text = text.replace(form, HIDDEN).replace(repr(form)[1:-1], HIDDEN)
    return text
