"""Compute the far-field pattern of a single antenna of the radar.

Reference: AWR1843BOOST and IWR1843BOOST user's guide (TI SPRUIM4B), antenna section. This guide gives a peak gain above 10.5 dBi from 76 to
81 GHz. The one-way beamwidths in azimuth are +-28 degrees (3 dB) and +-50 degrees (6 dB). In elevation they are +-14 degrees (3 dB) and
+-20 degrees (6 dB).

The pattern is the product of an azimuth cut and an elevation cut. The angle psi is the azimuth atan2(y, x) or the elevation asin(z). In
each cut, the gain at the angle psi is a (sqrt(1 + (s/b)^2) - 1) dB below the peak gain, with s = 2 sin(psi/2). The constants a and b of
this hyperbola are chosen so that it passes through the 3 dB and the 6 dB beamwidth. The hyperbola is smooth and is quadratic near
boresight. In the azimuth cut, the amplitude gain has the additional factor 1 - (1 - cos psi)^16, which models the ground plane: the gain
falls to zero in the plane of the board. This factor changes the gain by less than 0.01 dB at azimuths up to 50 degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError

ELEMENTS = ("iwr1843", "isotropic")

PEAK_GAIN_DBI = 10.5
_AZIMUTH_DEG = (28.0, 50.0)  # azimuths at which the gain is 3 dB and 6 dB below the peak gain
_ELEVATION_DEG = (14.0, 20.0)  # elevations at which the gain is 3 dB and 6 dB below the peak gain


def element_gain(element: str, directions: ArrayLike) -> NDArray[np.float64]:
    """Compute the amplitude gain (square root of the power gain) of one antenna.

    Args:
        element: antenna pattern, "iwr1843" or "isotropic".
        directions: vectors (..., 3) in the sensor frame that point away from the radar, of any length above zero.
    Returns:
        Amplitude gain (...,). "isotropic" gives 1 in all directions; "iwr1843" gives 0 in the plane of the board and behind it.
    Raises:
        InputError: the element is unknown, or the shape of `directions` is not (..., 3).

    >>> float(np.round(20 * np.log10(element_gain("iwr1843", [1.0, 0.0, 0.0])), 2))
    10.5
    """
    directions = np.asarray(directions, dtype=np.float64)
    if directions.ndim < 1 or directions.shape[-1] != 3:
        raise InputError(f"element_gain: directions must have shape (..., 3), not {directions.shape}")
    if element == "isotropic":
        return np.ones(directions.shape[:-1])
    if element != "iwr1843":
        raise InputError(f"element_gain: element {element!r} is unknown; use one of {', '.join(ELEMENTS)}")
    x, y, z = np.moveaxis(directions, -1, 0)
    across = x * x + y * y
    length = np.sqrt(across + z * z)
    # `azimuth` and `elevation` are the cosines of these angles. A vector straight up has no azimuth and lies in the plane of the board.
    azimuth = np.divide(x, np.sqrt(across), out=np.zeros_like(x), where=across > 0)
    elevation = np.divide(np.sqrt(across), length, out=np.zeros_like(x), where=length > 0)
    loss_db = _loss_db(azimuth, *_AZIMUTH_DEG) + _loss_db(elevation, *_ELEVATION_DEG)
    behind = (1.0 - np.maximum(azimuth, 0.0)) ** 2
    ground = 1.0 - behind**8
    return np.where(x > 0, np.exp(np.log(10) / 20 * (PEAK_GAIN_DBI - loss_db)) * ground, 0.0)


def _loss_db(cosine: NDArray[np.float64], half_power_deg: float, quarter_power_deg: float) -> NDArray[np.float64]:
    """Compute how many dB the antenna gain is below its peak, from the cosine of the azimuth or of the elevation.

    The loss is 3 dB at `half_power_deg` and 6 dB at `quarter_power_deg`, which must be less than twice `half_power_deg`.
    """
    near, far = (2 * (1 - np.cos(np.radians(degrees))) for degrees in (half_power_deg, quarter_power_deg))  # (2 sin(psi/2))^2
    # The loss is 3 dB at `near` and 6 dB at `far` if sqrt(1 + near/b^2) = k / (4 - k), with k = far/near.
    ratio = far / near
    at_near = ratio / (4 - ratio)
    return 3.0 * (np.sqrt(1 + (at_near**2 - 1) * 2 / near * (1 - cosine)) - 1) / (at_near - 1)
