"""Check the arguments of simulators. Each check raises InputError with the argument's name, the rule and the wrong value."""

import math
import numbers
from collections.abc import Sequence

from radartwin.errors import InputError


def check_whole(name: str, value: object, low: int, high: int | None = None) -> None:
    """Require that `value` is a whole number from `low` to `high`, or of at least `low` if `high` is None. Booleans are not accepted."""
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or int(value) < low or (high is not None and int(value) > high):  # type: ignore[call-overload]
        bounds = f"of at least {low}" if high is None else f"from {low} to {high}"
        raise InputError(f"{name} must be a whole number {bounds}, not {value!r}")


def check_positive(name: str, value: object, most: float = math.inf) -> None:
    """Require that `value` is a finite real number above zero and at most `most`. Booleans and strings are not accepted."""
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not (real and 0 < float(value) <= most and math.isfinite(float(value))):  # type: ignore[arg-type]
        limit = "" if math.isinf(most) else f" of at most {most:_}"
        raise InputError(f"{name} must be a finite positive number{limit}, not {value!r}")


def check_option(name: str, value: object, options: Sequence[str]) -> None:
    if value not in options:
        raise InputError(f"{name} {value!r} is not one of {', '.join(options)}")


def check_flag(name: str, value: object) -> None:
    if not isinstance(value, bool):
        raise InputError(f"{name} must be True or False, not {value!r}")
