"""A material of its own: a named one with its permittivity a little off, as every board and bottle is.

It is a name too, `plasterboard~1.0500~0.8000`: the real part of plasterboard times 1.05, its loss times 0.8. So it goes wherever names go.
"""

from __future__ import annotations

import math

from radartwin.errors import MaterialError

_MARK = "~"


def varied(name: str, real: float, loss: float) -> str:
    """The name of a material with factors on its real permittivity and on its loss, to four digits; it may be varied already.

    >>> varied("glass", 1.05, 0.8)
    'glass~1.0500~0.8000'
    """
    base, before, lost = split(name)
    return f"{base}{_MARK}{before * real:.4f}{_MARK}{lost * loss:.4f}"


def split(name: str) -> tuple[str, float, float]:
    """Name, factor of the real part and factor of the loss; both 1 for a plain name.

    Raises:
        MaterialError: factors that are not two numbers above zero, at least zero for the loss.
    """
    base, *factors = str(name).split(_MARK)
    if not factors:
        return name, 1.0, 1.0
    try:
        real, loss = (float(factor) for factor in factors)
    except ValueError:
        real = loss = math.nan
    if not (0 < real < math.inf and 0 <= loss < math.inf):
        raise MaterialError(f"material {name!r}: after the name come two factors, of permittivity and loss: {base}{_MARK}1.05{_MARK}0.8")
    return base, real, loss
