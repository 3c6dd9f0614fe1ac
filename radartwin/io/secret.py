"""Keys and passwords of the environment, so that they are found nowhere else: no log, no message, no artifact."""

from __future__ import annotations

import os

VARIABLES = ("RADARTWIN_VLM_KEY", "RADARTWIN_LLM_KEY", "MLFLOW_TRACKING_PASSWORD", "MLFLOW_TRACKING_TOKEN", "HF_TOKEN")
SHORTEST = 6  # a shorter word may stand in any text by chance
HIDDEN = "***"


def hidden(text: str, *more: str | None) -> str:
    """The text without the values of these variables and without `more`, which servers and libraries like to repeat.

    >>> hidden("invalid key abc-123-def", "abc-123-def")
    'invalid key ***'
    """
    for value in (*(os.environ.get(name) for name in VARIABLES), *more):
        for form in {value, value.strip()} if value else ():
            if len(form) >= SHORTEST:
                text = text.replace(form, HIDDEN).replace(repr(form)[1:-1], HIDDEN)
    return text
