"""Compute the far-field pattern of a single antenna of the radar.

Reference: AWR1843BOOST and IWR1843BOOST user's guide (TI SPRUIM4B), antenna section. This guide gives a peak gain above 10.5 dBi from 76 to
81 GHz. The one-way beamwidths in azimuth are +-28 degrees (3 dB) and +-50 degrees (6 dB). In elevation they are +-14 degrees (3 dB) and
+-20 degrees (6 dB).

The pattern is the product of an azimuth cut, an elevation cut and a ground-plane factor. The angle psi is the azimuth atan2(y, x) or the
elevation asin(z).

Data of the user's guide: the peak gain and the four beamwidths. In each cut, the gain of the main lobe at the angle psi is
a (sqrt(1 + (s/b)^2) - 1) dB below the peak gain, with s = 2 sin(psi/2). The constants a and b of this hyperbola are chosen so that the
loss is 3 dB and 6 dB at the published beamwidths. The hyperbola is smooth and is quadratic near boresight.

Conventions of this module, for which there is no measurement of these boards:

- Side lobes in elevation. TI measures the patterns of such boards only up to 30 degrees of elevation (TI E2E 821216, IWR6843ISK). The gain
  of three equal patches in series, at a spacing of one wavelength on the board (SPACING), is 2.8 dB below the peak at 14 degrees and 6.2 dB
  below the peak at 20 degrees. These values agree with the published beamwidths within 0.2 dB. The pattern therefore has the side lobe of
  three such patches. With d = SPACING, the array factor of the three patches is (1 + 2 cos(2 pi d sin psi))/3, and each patch has the
  pattern cos(pi d/2 sin psi) of its two radiating edges (C. Balanis, Antenna Theory, section 14.2). Beyond the first null of the array
  factor, the power of the side lobe is added to the power of the main lobe, which fills the null. The side lobe is 12.4 dB below the peak
  gain at 53 degrees. For comparison, 77 GHz arrays of tapered patches have side lobes of -15 and -20 dB (W. Wang, X. Wang, Progress In
  Electromagnetics Research Letters 72 (2018) 23).
- Ground plane. The amplitude gain has the factor 1 - (1 - cos theta)^16, where theta is the angle from boresight. The gain falls to zero in
  the plane of the board. This factor changes the gain by less than 0.01 dB up to 50 degrees from boresight.
- Beyond 50 degrees of azimuth, the pattern continues the hyperbola. Behind the board, the gain is zero.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.compiled import compiled, fixed, innermost, shared_out
from radartwin.errors import InputError

ELEMENTS = ("iwr1843", "isotropic")

PEAK_GAIN_DBI = 10.5
_AZIMUTH_DEG = (28.0, 50.0)  # azimuths at which the gain is 3 dB and 6 dB below the peak gain
_ELEVATION_DEG = (14.0, 20.0)  # elevations at which the gain is 3 dB and 6 dB below the peak gain
# Distance between the patches of an antenna, in wavelengths in air. The distance is one wavelength on a board with an effective
# permittivity of 2.8, which a microstrip line has on the laminate RO4835 (relative permittivity 3.5). The laminate is quoted from memory.
SPACING = 0.6


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
    flat = fixed(directions.reshape(-1, 3))
    out = np.empty(len(flat))
    shared_out(_gains, len(flat), flat, out, grain=10_000)
    return out.reshape(directions.shape[:-1])


def _hyperbola(half_power_deg: float, quarter_power_deg: float) -> tuple[float, float]:
    """Return the constants (1/b^2, a) of the hyperbola a (sqrt(1 + (s/b)^2) - 1), from the angles of 3 dB and 6 dB loss."""
    near, far = (2 * (1 - math.cos(math.radians(degrees))) for degrees in (half_power_deg, quarter_power_deg))  # (2 sin(psi/2))^2
    # The loss is 3 dB at `near` and 6 dB at `far` if sqrt(1 + near/b^2) = k / (4 - k), with k = far/near.
    ratio = far / near
    at_near = ratio / (4 - ratio)
    return (at_near**2 - 1) / near, 3.0 / (at_near - 1)


_AZIMUTH, _ELEVATION = _hyperbola(*_AZIMUTH_DEG), _hyperbola(*_ELEVATION_DEG)


@compiled
def _gains(first, last, directions, out):
    """Write the amplitude gains of the element "iwr1843" for the directions `first` to `last` - 1 of `directions` (N, 3) to `out` (N,)."""
    for i in range(first, last):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        if not x > 0:
            out[i] = 0.0
            continue
        across = np.sqrt(x * x + y * y)
        length = np.sqrt(across * across + z * z)
        sine = z / length  # of the elevation
        array = (1 + 2 * np.cos(2 * np.pi * SPACING * sine)) / 3
        patch = np.cos(np.pi / 2 * SPACING * sine)
        # The side lobe of three equal patches begins at their first null, where the power and its derivative are zero.
        side_lobe = (array * patch) ** 2 if abs(sine) > 1 / (3 * SPACING) else 0.0
        power = 10 ** (-_loss_db(across / length, _ELEVATION) / 10) + side_lobe
        ground = 1.0 - (1.0 - x / length) ** 16
        out[i] = 10 ** ((PEAK_GAIN_DBI - _loss_db(x / across, _AZIMUTH)) / 20) * np.sqrt(power) * ground


@innermost
def _loss_db(cosine, hyperbola):
    """Return the loss below the peak gain in dB in one cut, from the cosine of the cut's angle and the constants of the cut's hyperbola."""
    return hyperbola[1] * (np.sqrt(1 + 2 * hyperbola[0] * (1 - cosine)) - 1)
