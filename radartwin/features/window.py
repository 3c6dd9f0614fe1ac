"""Range-profile window: the logarithm of the energy in bins over the two metres around the target.

E_k(f) is the integral of P(f, r) over the k-th of BINS bins of 0.1 m, centred on the tracked peak; the energy of a range bin is uniform
over its width. The feature is 10 log10 E_k (paper, signal fidelity along trajectories: the range-profile window is among the most
consistent families). Ranges below NEAR_M, where the antennas couple, and beyond the processed range count as empty. The lower limit of a
bin is the noise of its width and FLOOR_DB below the energy of the whole window, because weaker energy is an artefact of the receiver that
only one domain has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.features.processed import Processed
from radartwin.features.profile import NEAR_M

SPAN_M, WIDTH_M = 2.0, 0.1
BINS = round(SPAN_M / WIDTH_M)
FLOOR_DB = 60.0  # about the dynamic range of 16 bits with phase noise
CENTRES_M = WIDTH_M * (np.arange(BINS) - (BINS - 1) / 2)  # relative to the target


def energies(power: NDArray, range_m: NDArray, centre_m: NDArray) -> NDArray[np.float64]:
    """Energy per bin of WIDTH_M around the centre of each frame.

    Args:
        power: (F, B). centre_m: (F,).
    Returns:
        (F, BINS).
    """
    width = float(np.diff(range_m).mean())
    edges = np.concatenate([range_m - width / 2, range_m[-1:] + width / 2])
    used = np.where(range_m >= NEAR_M, power, 0.0)
    cumulative = np.concatenate([np.zeros((*used.shape[:-1], 1)), np.cumsum(used, axis=-1, dtype=np.float64)], axis=-1)
    bin_edges = np.asarray(centre_m)[:, None] + WIDTH_M * (np.arange(BINS + 1) - BINS / 2)
    # Linear interpolation between edges, as np.interp, with one row per frame.
    place = np.clip((bin_edges - edges[0]) / width, 0, len(range_m))
    left = np.minimum(place.astype(int), len(range_m) - 1)
    start, end = np.take_along_axis(cumulative, left, axis=1), np.take_along_axis(cumulative, left + 1, axis=1)
    return np.diff(start + (place - left) * (end - start), axis=1)


def window_db(processed: Processed, centre_m: NDArray) -> NDArray[np.float64]:
    """10 log10 E_k, (F, BINS), in decibels of received over transmitted power."""
    energy = energies(processed.power, processed.range_m, centre_m)
    floor = float(np.median(processed.noise_floor)) * WIDTH_M / float(np.diff(processed.range_m).mean())
    lower_limit = np.maximum(floor, 10 ** (-FLOOR_DB / 10) * energy.sum(axis=1, keepdims=True))
    return 10 * np.log10(np.maximum(np.maximum(energy, lower_limit), np.finfo(np.float64).tiny))
