"""Compute the range-profile window: the energy, in decibels, in cells of 0.1 m over the two metres around the target.

E_k(f) is the integral of P(f, r) over cell k of BINS cells, which are centred on the tracked peak. The energy of a range bin is assumed
uniform over its width. The feature is 10 log10 E_k (paper, signal fidelity along trajectories: the range-profile window is among the most
consistent families). Cells are empty below NEAR_M, where antenna leakage dominates, and beyond the processed range. E_k is at least the
noise energy of its cell and at least the energy of the whole window minus FLOOR_DB. Weaker energy is an effect of the measuring receiver
that the simulation does not have.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.features.processed import Processed
from radartwin.features.profile import NEAR_M

SPAN_M, WIDTH_M = 2.0, 0.1
BINS = round(SPAN_M / WIDTH_M)
FLOOR_DB = 60.0  # about the dynamic range of a 16-bit receiver with phase noise
CENTRES_M = WIDTH_M * (np.arange(BINS) - (BINS - 1) / 2)  # cell centres relative to the target


def energies(power: NDArray, range_m: NDArray, centre_m: NDArray) -> NDArray[np.float64]:
    """Compute the energy (F, BINS) in the cells around the centre of each frame.

    Args:
        power: (F, B).
        centre_m: (F,), range of the window's centre in metres.
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
    """Compute the feature 10 log10 E_k, (F, BINS), in decibels of received over transmitted power."""
    energy = energies(processed.power, processed.range_m, centre_m)
    floor = float(np.median(processed.noise_floor)) * WIDTH_M / float(np.diff(processed.range_m).mean())
    lower_limit = np.maximum(floor, 10 ** (-FLOOR_DB / 10) * energy.sum(axis=1, keepdims=True))
    return 10 * np.log10(np.maximum(np.maximum(energy, lower_limit), np.finfo(np.float64).tiny))
