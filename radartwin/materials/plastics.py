"""Give the permittivity of air, container plastics and oil, which is nearly lossless and constant between 10 and 100 GHz.

Refs: J. W. Lamb, Int. J. Infrared and Millimeter Waves 17 (1996) 1997 (HDPE 2.31, PET 2.9 at millimetre waves, loss
tangents of 0.0003 and 0.01); vegetable oils 2.4 to 2.5 with loss tangents of 0.03 to 0.05 (free-space measurements at W band).
"""

import numpy as np

from radartwin.errors import MaterialError

RANGE_HZ = (10e9, 100e9)

PERMITTIVITY = {
    "pet": 2.9 * (1 - 0.01j),
    "hdpe": 2.31 * (1 - 0.0003j),
    "oil": 2.45 * (1 - 0.04j),
    "air": 1.0 + 0.0j,
    "vacuum": 1.0 + 0.0j,
}
EMPTY = ("air", "vacuum")


def permittivity(name: str, frequency_hz: np.ndarray | float) -> np.ndarray:
    """Return the complex relative permittivity eta' - j eta'', constant over frequency, shape of `frequency_hz`.

    Raises:
        MaterialError: a frequency outside RANGE_HZ; air and vacuum have no such limit.
    """
    low, high = float(np.min(frequency_hz)), float(np.max(frequency_hz))
    if name not in EMPTY and not (RANGE_HZ[0] <= low and high <= RANGE_HZ[1]):
        raise MaterialError(
            f"material {name!r} has values from 10 to 100 GHz, not at {low / 1e9:g} to {high / 1e9:g} GHz; choose another material"
        )
    return np.full(np.shape(frequency_hz), PERMITTIVITY[name])
