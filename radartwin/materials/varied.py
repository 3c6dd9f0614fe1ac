"""Build and split material names with factors on the permittivity, which model the spread between samples of one material.

`plasterboard~1.0500~0.8000` has 1.05 times the real permittivity and 0.8 times the loss of plasterboard. The factors are part of the
name, so every function that accepts a material name accepts a varied material.
"""

from __future__ import annotations

import math

from radartwin.errors import MaterialError

_MARK = "~"


def varied(name: str, real: float, loss: float) -> str:
    """Return the material name with factors on real permittivity and loss, to four decimals. Factors that `name` already has multiply.

    >>> varied("glass", 1.05, 0.8)
    'glass~1.0500~0.8000'
    """
    base, real_before, loss_before = split(name)
    return f"{base}{_MARK}{real_before * real:.4f}{_MARK}{loss_before * loss:.4f}"


def split(name: str) -> tuple[str, float, float]:
    """Split a material name into the plain name, the factor on the real permittivity and the factor on the loss.

    Both factors are 1 for a plain name.

    Raises:
        MaterialError: the name does not end with two numbers, the first factor is not positive, or the second factor is negative.
    """
    base, *factors = str(name).split(_MARK)
    if not factors:
        return name, 1.0, 1.0
    try:
        real, loss = (float(factor) for factor in factors)
    except ValueError:
        real = loss = math.nan
    if not (0 < real < math.inf and 0 <= loss < math.inf):
        raise MaterialError(
            f"material {name!r} is not a name with two factors, of permittivity and loss; write for example {base}{_MARK}1.05{_MARK}0.8"
        )
    return base, real, loss
