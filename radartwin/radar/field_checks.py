"""Check field values of the dataclasses that describe a radar."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from radartwin.errors import InputError


def is_number(value: Any) -> bool:
    """Return whether a value is a finite real number. Booleans and integers beyond the range of a float are refused."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def from_mapping(kind: Any, name: str, values: Any) -> Any:
    """Build an instance of a dataclass from a mapping of its fields.

    Args:
        kind: the dataclass.
        name: the name of the mapping in error messages.
    Raises:
        InputError: `values` is not a mapping, or a field is unknown, missing or invalid.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{name}: expected a mapping of fields, not {reprlib.repr(values)}")
    known = {field.name for field in fields(kind)}
    if unknown := sorted(set(values) - known, key=str):
        raise InputError(f"{name}: unknown field {unknown[0]!r}; known fields: {', '.join(sorted(known))}")
    try:
        return kind(**values)
    except TypeError as error:
        raise InputError(f"{name}: {error}".replace(f"{kind.__name__}.__init__() ", "")) from None
