"""Compute the permittivity of a material from its name. The known materials are those of ITU-R P.2040 and some plastics and liquids.

A material name may end with two factors on the permittivity, which model the spread between samples of one material. For example,
`plasterboard~1.0500~0.8000` has 1.05 times the real part and 0.8 times the imaginary part (loss) of the permittivity of plasterboard. Every
function that accepts a material name also accepts a name with factors.
"""

import difflib
import math

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import MaterialError
from radartwin.materials import containers, itu

MATERIAL_NAMES = tuple(sorted({*itu.P2040, *containers.NAMES}))
EXACT = ("metal", *containers.EMPTY)  # materials whose permittivity has no spread
_MARK = "~"


def check_name(name: str) -> None:
    """Raise MaterialError if `name` is not the name of a known material. The error message gives the most similar known names."""
    if split(name)[0] not in MATERIAL_NAMES:
        near = difflib.get_close_matches(str(name), MATERIAL_NAMES, 2)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(MATERIAL_NAMES)}"
        raise MaterialError(f"unknown material {name!r}; {hint}")


def permittivity(name: str, frequency_hz: np.ndarray | float) -> NDArray[np.complex128]:
    """Compute the complex relative permittivity eta' - j eta'' of a named material. The result has the shape of `frequency_hz`."""
    check_name(name)
    name, real, loss = split(name)
    if real != 1 or loss != 1:
        eta = permittivity(name, frequency_hz)
        return real * eta.real + 1j * loss * eta.imag
    return (containers if name in containers.NAMES else itu).permittivity(name, frequency_hz)


def varied(name: str, real: float, loss: float) -> str:
    """Return the material name `name` with the factors `real` and `loss` on the real and imaginary part of the permittivity.

    If `name` already has factors, the function multiplies them by `real` and `loss`. The function rounds all factors to four decimals.
    Metal, air and vacuum do not vary.

    >>> varied("glass", 1.05, 0.8), varied("metal", 1.05, 0.8)
    ('glass~1.0500~0.8000', 'metal')
    """
    if name in EXACT:
        return name
    base, real_before, loss_before = split(name)
    return f"{base}{_MARK}{real_before * real:.4f}{_MARK}{loss_before * loss:.4f}"


def split(name: str) -> tuple[str, float, float]:
    """Split a material name into the plain name and the factors on the real and the imaginary part of the permittivity.

    Both factors are 1 if the name has no factors.

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
