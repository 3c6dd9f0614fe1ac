"""Compute the point cloud of each frame: detections in range and azimuth.

The range-azimuth map of a frame is |w(phi)^H A(f, r)|^2 of the channel signals A, every degree from -60 to 60 degrees. The weights w are
those of a Bartlett beamformer with a Hamming window over the antennas in ascending y. Without this window, two targets at the same range
would cause detections where their sidelobes overlap. A detection is a local maximum of this map that exceeds the threshold of a
cell-averaging CFAR along range and lies within DEPTH_DB of the strongest cell of the frame. A detection is dropped if it is within
BESIDE_BINS range bins of a stronger detection and more than LOBE_DB weaker, because it may be a sidelobe of the stronger detection in
azimuth. A Doppler bin of the IWR1843 is 0.93 m/s wide, which is more than the speed of the rover, so that the velocity does not separate
detections.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.radar.cfar import ca_cfar
from radartwin.radar.processing import row_places, steering

AZIMUTH_RAD = np.deg2rad(np.arange(-60.0, 61.0))
GUARD, TRAINING = 2, 6  # number of guard bins and of training bins on each side, along range
FALSE_ALARM = 1e-4  # per cell
MIN_CONTRAST_DB = 3.0  # smallest ratio of the power of a detection to the mean power of its training cells
DEPTH_DB = 40.0  # a cell that is weaker than the strongest cell of the frame by more than this may be a sidelobe of the window
SIZE = (3, 15)  # size (range, azimuth) of the block of cells in which a local maximum is the largest cell
BESIDE_BINS, LOBE_DB = 2, 20.0  # the sidelobes of 8 equal antennas are below -30 dB, but unequal antennas can have higher sidelobes


def detections(processed: Processed) -> list[NDArray[np.float64]]:
    """Return the detections (N, 2) of each of the F frames, as range in metres and azimuth in radians, the strongest first.

    The ranges are bin centres from NEAR_M to FAR_M. The azimuth is positive to the left.
    """
    from scipy.ndimage import maximum_filter

    weights = steering(processed.radar, AZIMUTH_RAD)
    places = row_places(processed.radar)
    taper = np.hamming(places.max() + 1)[places]
    weights = (weights * (taper / taper.mean())[:, None]).astype(np.complex64)
    inside = (processed.range_m >= NEAR_M) & (processed.range_m <= FAR_M)
    range_m, clouds = processed.range_m[inside], []
    for frame in processed.channels:
        power = np.abs(frame.T @ weights).astype(np.float64) ** 2  # (B, azimuths)
        hits, _ = ca_cfar(
            power, guard=(GUARD, 0), training=(TRAINING, 0), false_alarm=FALSE_ALARM, looks=1,
            min_factor=10 ** (MIN_CONTRAST_DB / 10), wrap=(False, False),
        )  # fmt: skip
        power, hits = power[inside], hits[inside]
        peak = hits & (power == maximum_filter(power, SIZE, mode="nearest")) & (power > power.max() * 10 ** (-DEPTH_DB / 10))
        rows, columns = np.nonzero(peak)
        order = np.argsort(-power[rows, columns], kind="stable")
        rows, columns = rows[order], columns[order]
        level = power[rows, columns]
        lobe = (np.abs(rows[:, None] - rows) <= BESIDE_BINS) & (level[:, None] < level * 10 ** (-LOBE_DB / 10))
        kept = np.flatnonzero(~lobe.any(axis=1))
        clouds.append(np.column_stack([range_m[rows[kept]], AZIMUTH_RAD[columns[kept]]]))
    return clouds


def chamfer_m(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the Chamfer distance in metres of two clouds (N, 2) and (M, 2) of range and azimuth; nan if one of them is empty.

    For each cloud, the function computes the mean distance of its points to the nearest point of the other cloud, in the horizontal plane.
    The Chamfer distance is the mean of these two values.

    >>> near, far = np.array([[1.0, 0.0]]), np.array([[1.0, 0.0], [3.0, 0.0]])
    >>> chamfer_m(near, far)
    0.5
    """
    if not (len(first) and len(second)):
        return float("nan")
    first_m, second_m = (cloud[:, :1] * np.column_stack([np.cos(cloud[:, 1]), np.sin(cloud[:, 1])]) for cloud in (first, second))
    apart = np.linalg.norm(first_m[:, None] - second_m[None], axis=2)
    return float((apart.min(axis=1).mean() + apart.min(axis=0).mean()) / 2)


def matched(first: NDArray[np.float64], second: NDArray[np.float64], range_m: float, azimuth_rad: float) -> float:
    """Return the share of the detections `first` (N, 2) that have a detection of `second` (M, 2) within both limits; nan if N is 0.

    >>> matched(np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([[1.05, 0.1]]), 0.1, 0.26)
    0.5
    """
    if not len(first):
        return float("nan")
    near = np.abs(first[:, None] - second[None]) <= np.array([range_m, azimuth_rad])
    return float(np.any(np.all(near, axis=-1), axis=-1).mean())
