"""Far-field pattern of one antenna of the radar.

Reference: AWR1843BOOST and IWR1843BOOST user's guide (TI SPRUIM4B), antenna section: peak gain above 10.5 dBi from
76 to 81 GHz; one-way beamwidths in azimuth +-28 degrees (3 dB) and +-50 degrees (6 dB), in elevation +-14 degrees
(3 dB) and +-20 degrees (6 dB).

The fit is separable: with psi the azimuth atan2(y, x) or the elevation asin(z), each plane loses the hyperbola
a (sqrt(1 + (s/b)^2) - 1) dB in s = 2 sin(psi/2), through the two published points: smooth, quadratic on boresight. The
board's ground plane takes the gain to zero at and behind its plane through the factor 1 - (1 - cos psi)^16 on the
azimuth cut, which is under 0.01 dB inside 50 degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError

ELEMENTS = ("iwr1843", "isotropic")

PEAK_GAIN_DBI = 10.5
_AZIMUTH_DEG = (28.0, 50.0)  # 3 and 6 dB
_ELEVATION_DEG = (14.0, 20.0)


def element_gain(element: str, directions: ArrayLike) -> NDArray[np.float64]:
    """Amplitude gain (square root of power gain) of one antenna.

    Args:
        element: "iwr1843" or "isotropic".
        directions: vectors in the sensor frame away from the radar, any length above zero, shape (..., 3).
    Returns:
        gain, shape (...,); 1 everywhere for "isotropic", zero at and behind the board for "iwr1843".
    Raises:
        InputError: an unknown element, or directions that are not (..., 3).

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
    length = np.linalg.norm(directions, axis=-1)
    x, y, z = np.moveaxis(directions, -1, 0) / np.where(length > 0, length, 1.0)
    azimuth = np.arctan2(y, x)
    elevation = np.arcsin(np.clip(z, -1.0, 1.0))
    loss_db = _loss_db(azimuth, *_AZIMUTH_DEG) + _loss_db(elevation, *_ELEVATION_DEG)
    ground = 1.0 - (1.0 - np.clip(np.cos(azimuth), 0.0, 1.0)) ** 16
    return np.where(x > 0, 10 ** ((PEAK_GAIN_DBI - loss_db) / 20) * ground, 0.0)


def _loss_db(angle_rad: NDArray[np.float64], half_power_deg: float, quarter_power_deg: float) -> NDArray[np.float64]:
    """Power loss that is 3 dB at the first angle and 6 dB at the second, which is less than twice as far."""
    near, far = (2 * np.sin(np.radians(degrees) / 2) for degrees in (half_power_deg, quarter_power_deg))
    # The hyperbola doubles from near to far where sqrt(1 + (near/b)^2) = k / (4 - k), with k = (far/near)^2.
    ratio = (far / near) ** 2
    at_near = ratio / (4 - ratio)
    bend = (at_near**2 - 1) * (2 * np.sin(angle_rad / 2) / near) ** 2
    return 3.0 * (np.sqrt(1 + bend) - 1) / (at_near - 1)
