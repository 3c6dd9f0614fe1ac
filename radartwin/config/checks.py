"""Field markers and value checks that the configuration dataclasses share."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import field
from typing import Any

from radartwin.errors import ConfigError


def path_field() -> Any:
    return field(default=None, metadata={"path": True})


def unkeyed(default: Any) -> Any:
    """A field that says where or how, never what: it stays out of run keys."""
    return field(default=default, metadata={"unkeyed": True})


def one_of(key: str, value: str, options: Sequence[str]) -> None:
    if value not in options:
        raise ConfigError(f"{key}={value} is not known; options: {', '.join(options)}")


def positive(key: str, *values: float | None) -> None:
    for value in values:
        if value is not None and not 0 < value < math.inf:
            raise ConfigError(f"{key}={value} must be above zero and finite")


def finite(key: str, *values: float) -> None:
    for value in values:
        if not math.isfinite(value):
            raise ConfigError(f"{key}={value} must be finite")


def no_password(key: str, url: str | None, remedy: str) -> None:
    """What is configured is logged and kept with the results; a password must not be in it."""
    if url and re.match(r"[\w+.-]+://[^/?#]*@", url):
        raise ConfigError(f"{key} carries a name or password, and it is written into logs and results; {remedy}")
