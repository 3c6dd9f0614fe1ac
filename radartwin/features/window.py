"""Compute the feature family `window`: the energy in decibels in range cells of 0.1 m over the two metres around the target.

The energy E_k(f) is the integral of the power P(f, r) over cell k. The BINS cells are centred on the tracked peak of the target. The module
assumes that the energy of a range bin is uniform over the width of the bin. The feature of cell k is 10 log10 E_k. The RadarTwin paper
reports that this feature family is among those that agree best between simulation and measurement. Cells have no energy below NEAR_M, where
antenna leakage dominates, and beyond the processed range. E_k has two lower limits: the noise energy of its cell (from the median noise of
all range bins), and the energy of all cells minus FLOOR_DB. The limits are needed because weaker energies come from the measuring receiver
and do not exist in the simulation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.features.processed import Processed
from radartwin.features.profile import NEAR_M
from radartwin.radar.processing import decibels

SPAN_M, WIDTH_M = 2.0, 0.1
BINS = round(SPAN_M / WIDTH_M)
FLOOR_DB = 60.0  # dynamic range of the feature in dB, about that of a 16-bit receiver with phase noise
CENTRES_M = WIDTH_M * (np.arange(BINS) - (BINS - 1) / 2)  # ranges of the cell centres minus the range of the target, in metres


def energies(power: NDArray, range_m: NDArray, centre_m: NDArray) -> NDArray[np.float64]:
    """Compute the energy (F, BINS) in the BINS range cells around the target in each of F frames.

    Args:
        power: (F, B) power in B range bins.
        range_m: (B,) centres of the range bins in metres.
        centre_m: (F,) range of the middle of the cells in metres.
    """
    width = float(np.diff(range_m).mean())
    edges = np.concatenate([range_m - width / 2, range_m[-1:] + width / 2])
    gated = np.where(range_m >= NEAR_M, power, 0.0)
    cumulative = np.concatenate([np.zeros((*gated.shape[:-1], 1)), np.cumsum(gated, axis=-1, dtype=np.float64)], axis=-1)
    bin_edges = np.asarray(centre_m)[:, None] + WIDTH_M * (np.arange(BINS + 1) - BINS / 2)
    # Interpolate the cumulative energy linearly between the edges of range bins, like np.interp, but with one row per frame.
    place = np.clip((bin_edges - edges[0]) / width, 0, len(range_m))
    left = np.minimum(place.astype(int), len(range_m) - 1)
    start, end = np.take_along_axis(cumulative, left, axis=1), np.take_along_axis(cumulative, left + 1, axis=1)
    return np.diff(start + (place - left) * (end - start), axis=1)


def window_db(processed: Processed, centre_m: NDArray) -> NDArray[np.float64]:
    """Compute the level 10 log10 E_k of each range cell in each frame, (F, BINS), in decibels of received over transmitted power."""
    energy = energies(processed.power, processed.range_m, centre_m)
    floor = float(np.median(processed.noise_floor)) * WIDTH_M / float(np.diff(processed.range_m).mean())
    lower_limit = np.maximum(floor, 10 ** (-FLOOR_DB / 10) * energy.sum(axis=1, keepdims=True))
    return decibels(np.maximum(energy, lower_limit))
