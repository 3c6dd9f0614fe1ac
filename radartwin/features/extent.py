"""Compute the angular extent of the target: the standard deviation of the azimuth spectrum in the target gate.

The azimuth spectrum S(f, phi) of frame f is |w(phi)^H A(f, r)|^2, summed over the range bins r of the target gate, minus the noise. A are
the channel signals, and w are the weights of a Bartlett beamformer over the azimuth row of the array, for azimuths phi from -90 to 90
degrees. The angular extent in radians is sqrt(sum S (phi - m)^2 / sum S) with the mean azimuth m = sum S phi / sum S. A point target has
the angular extent of the beam with its sidelobes. On boresight, this extent is 0.25 rad for 8 antennas at a spacing of half a wavelength.
The angular extent does not depend on the signal level and the range.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.features.processed import Processed
from radartwin.features.profile import GATE_BINS
from radartwin.radar.processing import steering

AZIMUTH_RAD = np.deg2rad(np.arange(-90.0, 91.0))


def gate_spectrum(processed: Processed, target_m: ArrayLike) -> NDArray[np.float64]:
    """Compute the azimuth spectrum S(f, phi) of the target gate, (F, len(AZIMUTH_RAD)), at least zero."""
    weights = steering(processed.radar, AZIMUTH_RAD).astype(np.complex64)
    target_m = np.broadcast_to(target_m, processed.num_frames)
    centre = np.abs(processed.range_m - target_m[:, None]).argmin(axis=1)
    gate = np.clip(centre[:, None] + np.arange(-GATE_BINS, GATE_BINS + 1), 0, len(processed.range_m) - 1)
    noise = processed.noise_floor[gate].sum(axis=1, keepdims=True) * np.sum(np.abs(weights) ** 2, axis=0)
    channels = np.take_along_axis(processed.channels, gate[:, None], axis=2)
    spectrum = np.sum(np.abs(channels.swapaxes(1, 2) @ weights) ** 2, axis=1).astype(np.float64)
    return np.maximum(spectrum - noise, 0.0)


def angular_extent(processed: Processed, target_m: ArrayLike) -> NDArray[np.float64]:
    """Compute the angular extent of each frame in radians, (F,).

    If the target gate has no energy above the noise, the result is the angular extent of a constant azimuth spectrum.

    Args:
        processed: processed recording of F frames.
        target_m: range of the centre of the target gate in metres, one value for all frames or one value per frame (F,).
    """
    spectrum = gate_spectrum(processed, target_m)
    total = spectrum.sum(axis=1, keepdims=True)
    share = np.where(total > 0, spectrum / np.where(total > 0, total, 1.0), 1.0 / len(AZIMUTH_RAD))
    mean = share @ AZIMUTH_RAD
    return np.sqrt(np.sum(share * (AZIMUTH_RAD - mean[:, None]) ** 2, axis=1))
