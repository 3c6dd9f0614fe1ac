"""Define fields of the configuration dataclasses together with the check of each field's value.

`positive(4)` is a field of a `Checked` dataclass with the default 4. A value that is not above zero raises ConfigError. The value null
passes every check. radartwin/store/digest.py treats two kinds of fields specially when it computes the run key,
the digest that identifies a run's result. For a `path_name` field, the content of the named file enters the run key. An `unkeyed` field
does not enter the run key, because it only influences where or how a run computes, and not the run's result.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar

from radartwin.errors import ConfigError

MISSING: Any = "???"  # the value of omegaconf.MISSING, without importing OmegaConf: Hydra replaces it with the value in the option's file


def choice(default: str | list[str] | None, *others: str) -> Any:
    """Define a field whose value, or each entry of its list, must be one of the given words. A default of None allows null."""
    options = (default, *others) if isinstance(default, str) else others

    def check(key: str, value: str | list[str]) -> None:
        for entry in value if isinstance(value, list) else [value]:
            if entry not in options:
                raise ConfigError(f"{key}={entry} is not known; options: {', '.join(options)}")

    return _field(default, check)


def number(default: Any, fits: Callable[[float], bool], words: str) -> Any:
    """Define a field for numbers, each of which must satisfy `fits`. `words` follows "must be" in the error message."""

    def check(key: str, value: Any) -> None:
        for entry in value if isinstance(value, list) else [value]:
            if not fits(entry):
                raise ConfigError(f"{key}={entry:g} must be {words}")

    return _field(default, check)


def positive(default: Any) -> Any:
    return number(default, lambda value: 0 < value < math.inf, "above zero and finite")


def not_negative(default: Any) -> Any:
    return number(default, lambda value: 0 <= value < math.inf, "zero or above, and finite")


def finite(default: float) -> Any:
    return number(default, math.isfinite, "finite")


def share(default: float) -> Any:
    return number(default, lambda value: 0 <= value <= 1, "from 0 to 1")


def triple(content: str) -> Any:
    """Define a field for three finite numbers, null by default. The error message uses `content` to describe the three numbers."""

    def check(key: str, value: list[float]) -> None:
        for entry in value:
            if not math.isfinite(entry):
                raise ConfigError(f"{key}={entry} must be finite")
        if len(value) != 3:
            raise ConfigError(f"{key}={value} must be {content}")

    return _field(None, check)


def url(remedy: str) -> Any:
    """Define a field for a URL, null by default. A URL with a password raises an error that states `remedy`."""

    def check(key: str, value: str) -> None:
        if re.match(r"[\w+.-]+://[^/?#]*@", value):
            raise ConfigError(f"{key} contains a user name or password, which logs and results would show; {remedy}")

    return _field(None, check)


def path_name(missing: str = "") -> Any:
    """Define a field for a path, null by default; with `missing`, the message of the error if it is not given, empty by default."""

    def check(key: str, value: str) -> None:
        if missing and not value:
            raise ConfigError(missing)

    return field(default="" if missing else None, metadata={"path": True, "check": check})


def unkeyed(default: Any) -> Any:
    """Mark a dataclass field as not part of run keys, or create such a field with the given default value."""
    if isinstance(default, Field):
        return field(default=default.default, metadata={**default.metadata, "unkeyed": True})
    return field(default=default, metadata={"unkeyed": True})


@dataclass
class Checked:
    """Base of the configuration dataclasses, which checks the value of every field."""

    KEY: ClassVar[str] = ""  # key of the dataclass in the configuration, such as "supervision.encoder"
    SELECTOR: ClassVar[str] = ""  # field that names the selected option, such as `backend`; it has one of NAMES, or its default
    NAMES: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        if self.SELECTOR:
            group, value, names = self.KEY, getattr(self, self.SELECTOR), self.NAMES or (getattr(type(self), self.SELECTOR),)
            if not names[0]:
                raise ConfigError(f"{group}: the file of this option names no schema; begin it with 'defaults: [schema_{value or 'NAME'}]'")
            if value not in names:
                contradicts = f"{group}.{self.SELECTOR}={value} contradicts {group}={names[0]}"
                raise ConfigError(f"{contradicts}; choose {group}={value}, or leave {group}.{self.SELECTOR} out")
        for entry in fields(self):
            if (check := entry.metadata.get("check")) and (value := getattr(self, entry.name)) is not None:
                check(f"{self.KEY}.{entry.name}".lstrip("."), value)


def _field(default: Any, check: Callable[[str, Any], None]) -> Any:
    if isinstance(default, list):
        return field(default_factory=lambda: list(default), metadata={"check": check})
    return field(default=default, metadata={"check": check})
