"""Check field values of the dataclasses that describe a radar or a recording."""

from __future__ import annotations

import difflib
import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, PoseError


def is_number(value: Any) -> bool:
    """Return whether a value is a finite real number. The result is False for booleans and for integers beyond the range of a float."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def require(described: Any, what: str, name: str, accepts: Callable[[Any], bool], expected: str) -> None:
    """Raise InputError, which calls the dataclass instance `what`, unless `accepts` is true for its field `name`."""
    if not accepts(value := getattr(described, name)):
        raise InputError(f"{what}: {name} must be {expected}, not {reprlib.repr(value)}")


def from_mapping(kind: Any, name: str, values: Any) -> Any:
    """Build an instance of a dataclass from a mapping of its fields.

    Args:
        kind: the dataclass to instantiate.
        name: name of the mapping in error messages.
        values: mapping from field names to field values.
    Raises:
        InputError: `values` is not a mapping, or it has an unknown, missing or invalid field.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{name}: expected a mapping of fields, not {reprlib.repr(values)}")
    known = {field.name for field in fields(kind)}
    if unknown := sorted(set(values) - known, key=str):
        near = difflib.get_close_matches(str(unknown[0]), sorted(known), 1)
        required = [field.name for field in fields(kind) if field.default is MISSING and field.default_factory is MISSING]
        hint = f"did you mean {near[0]}?" if near else f"required fields: {', '.join(required)}"
        raise InputError(f"{name}: unknown field {unknown[0]!r}; {hint}")
    try:
        return kind(**values)
    except TypeError as error:
        raise InputError(f"{name}: {error}".replace(f"{kind.__name__}.__init__() ", "")) from None


def check_distinct(positions: Sequence[tuple[float, ...]], what: str, error: type[InputError] = InputError) -> None:
    """Raise `error` if two antennas have the same position. The message gives the name `what` of the antennas and their numbers."""
    first: dict[tuple[float, ...], int] = {}
    for number, position in enumerate(positions, start=1):
        if (other := first.setdefault(position, number)) != number:
            raise error(f"{what}: antennas {other} and {number} are at the same position; give each its own, or leave one out")


def check_rigid(poses: NDArray[np.float64], what: str, error: type[InputError] = PoseError) -> None:
    """Raise `error` unless all poses (F, 4, 4) are finite and rigid. The error message gives the name `what` and the frame.

    A rigid pose has a right-handed rotation matrix and the last row 0 0 0 1. The product of the rotation matrix and its transpose may
    differ from the identity by up to 1e-4 per entry, because poses from text files and float32 arrays are rounded.
    """
    finite = np.isfinite(poses).all(axis=(1, 2))
    rotation = np.nan_to_num(poses[:, :3, :3]).clip(-2, 2)  # the limits avoid overflow; no entry of a rotation matrix exceeds 1
    straight = np.abs(rotation @ rotation.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) < 1e-4
    rigid = finite & straight & (np.linalg.det(rotation) > 0) & (np.abs(poses[:, 3] - (0, 0, 0, 1)) < 1e-9).all(axis=1)
    if not rigid.all():
        remedy = "give a rotation and a position in metres, all finite, with last row 0 0 0 1"
        raise error(f"{what}, frame {np.flatnonzero(~rigid)[0]}: not a rigid pose; {remedy}")
