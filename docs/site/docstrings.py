"""Prepare docstrings for mkdocstrings: put examples into fenced blocks, and split a joint description of several parameters into lines of
one parameter.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

EXAMPLE = re.compile(r"^(>>> .*(?:\n(?!\s*$).*)*)", re.MULTILINE)
JOINT = re.compile(r"^(?P<indent>[ ]{4})(?P<names>\**\w+(?:, \**\w+)+): (?P<text>.*(?:\n[ ]{5,}\S.*)*)", re.MULTILINE)


def prepared(text: str) -> str:
    """Return a docstring with its examples in fenced blocks and its joint parameters split.

    >>> print(prepared("Args:\\n    low, high: limits in metres."))
    Args:
        low: limits in metres.
        high: limits in metres.
    """
    text = EXAMPLE.sub(r"```pycon\n\1\n```", text)
    return JOINT.sub(lambda match: "\n".join(f"{match['indent']}{name}: {match['text']}" for name in match["names"].split(", ")), text)


class Prepare(griffe.Extension):
    """Prepare each docstring after griffe has read it."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = prepared(obj.docstring.value)
