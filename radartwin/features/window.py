"""Range-profile window: the log energy of the two metres around the target.

E_k(f) = integral of P(f, r) over the k-th of BINS bins of 0.1 m, centred on the tracked peak, a range bin's energy spread evenly over its
width; the feature is 10 log10 E_k (paper, signal fidelity along trajectories: the range-profile window is among the most consistent
families). Ranges before NEAR_M, where the antennas couple, and beyond the processed ones hold nothing. No bin reads less than the noise of
its width, nor less than FLOOR_DB below the window's whole energy: what is darker is an artefact of the receiver in one domain and nothing
in the other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.features.processed import Processed
from radartwin.features.profile import NEAR_M

SPAN_M, WIDTH_M = 2.0, 0.1
BINS = round(SPAN_M / WIDTH_M)
FLOOR_DB = 60.0  # below the window's energy; about the dynamic range of 16 bits with phase noise
CENTRES_M = WIDTH_M * (np.arange(BINS) - (BINS - 1) / 2)  # from the target


def energies(power: NDArray, range_m: NDArray, centre_m: NDArray) -> NDArray[np.float64]:
    """Energy per bin of WIDTH_M around each frame's centre.

    Args:
        power: (F, B). centre_m: (F,).
    Returns:
        (F, BINS).
    """
    width = float(np.diff(range_m).mean())
    edges = np.concatenate([range_m - width / 2, range_m[-1:] + width / 2])
    used = np.where(range_m >= NEAR_M, power, 0.0)
    filled = np.concatenate([np.zeros((*used.shape[:-1], 1)), np.cumsum(used, axis=-1, dtype=np.float64)], axis=-1)
    wanted = np.asarray(centre_m)[:, None] + WIDTH_M * (np.arange(BINS + 1) - BINS / 2)
    # Linear between edges, as np.interp, but for a row per frame.
    place = np.clip((wanted - edges[0]) / width, 0, len(range_m))
    left = np.minimum(place.astype(int), len(range_m) - 1)
    start, end = np.take_along_axis(filled, left, axis=1), np.take_along_axis(filled, left + 1, axis=1)
    return np.diff(start + (place - left) * (end - start), axis=1)


def window_db(processed: Processed, centre_m: NDArray) -> NDArray[np.float64]:
    """10 log10 E_k, (F, BINS), in decibels of received over transmitted power."""
    found = energies(processed.power, processed.range_m, centre_m)
    floor = float(np.median(processed.noise_floor)) * WIDTH_M / float(np.diff(processed.range_m).mean())
    least = np.maximum(floor, 10 ** (-FLOOR_DB / 10) * found.sum(axis=1, keepdims=True))
    return 10 * np.log10(np.maximum(np.maximum(found, least), np.finfo(np.float64).tiny))
