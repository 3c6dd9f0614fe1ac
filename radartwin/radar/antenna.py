"""Far-field pattern of one antenna of the radar.

Reference: AWR1843BOOST and IWR1843BOOST user's guide (TI SPRUIM4B), antenna section: peak gain above 10.5 dBi from
76 to 81 GHz; one-way beamwidths in azimuth +-28 degrees (3 dB) and +-50 degrees (6 dB), in elevation +-14 degrees
(3 dB) and +-20 degrees (6 dB).

The fit is separable: with psi the azimuth atan2(y, x) or the elevation asin(z), each plane loses A |2 sin(psi/2)|^p dB,
where A and p pass through the two published points; |2 sin(psi/2)| is smooth around the circle and close to psi in the
beam. The board's ground plane takes the gain to zero at and behind its plane through the factor
1 - (1 - cos psi)^16 on the azimuth cut, which is under 0.01 dB inside 50 degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError

ELEMENTS = ("iwr1843", "isotropic")

PEAK_GAIN_DBI = 10.5
_AZIMUTH_DB = ((28.0, 3.0), (50.0, 6.0))
_ELEVATION_DB = ((14.0, 3.0), (20.0, 6.0))


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
    loss_db = _loss_db(azimuth, _AZIMUTH_DB) + _loss_db(elevation, _ELEVATION_DB)
    ground = 1.0 - (1.0 - np.clip(np.cos(azimuth), 0.0, 1.0)) ** 16
    return np.where(x > 0, 10 ** ((PEAK_GAIN_DBI - loss_db) / 20) * ground, 0.0)


def _loss_db(angle_rad: NDArray[np.float64], points: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
    """Power loss A |2 sin(angle/2)|^p through two (degrees, dB) points."""
    (near_deg, near_db), (far_deg, far_db) = points
    near, far = (2 * np.sin(np.radians(degrees) / 2) for degrees in (near_deg, far_deg))
    power = np.log(far_db / near_db) / np.log(far / near)
    return near_db * (np.abs(2 * np.sin(angle_rad / 2)) / near) ** power
