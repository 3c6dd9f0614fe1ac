"""Compute feature rows of randomised copies of a simulated revolution of the user's own objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from radartwin.features import families
from radartwin.features.log import Log
from radartwin.features.processed import Processed, process
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import frame_shape
from radartwin.radar.recording import Recording
from radartwin.recognize.randomise import Randomisation, copies
from radartwin.simulation.signal.synthesis import thermal_noise

FEATURES, WITHOUT = "rotation", ("brightness",)  # brightness is an absolute level, and the gain of a user's radar is unknown
NOISE_FRAMES = 8  # number of simulated noise frames from which the noise power is computed, with an error of about 1 %


def feature_rows(
    processed: Processed, log: Log, echoes: Sequence[NDArray], count: int, strengths: Randomisation, seed: Sequence[int]
) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Return the names of the D features, and the feature rows (count, D) of randomised copies of a simulated revolution.

    Args:
        processed: simulated revolution without noise.
        log: nominal motion of the revolution.
    """
    made = copies(processed, echoes, thermal_power(processed.radar), count, strengths, seed)
    rows = [families.vector(copy, log, FEATURES, WITHOUT) for copy in made]
    return tuple(rows[0][0]), np.stack([values for _, values in rows]).astype(np.float64)


def thermal_power(radar: Radar) -> float:
    """Return the power of the radar's thermal noise per range bin of a processed recording, as the mean over all range bins."""
    noise = thermal_noise((NOISE_FRAMES, *frame_shape(radar)), radar, np.random.default_rng(0))
    if radar.real_sampling:
        noise.imag = 0
    return float(process(Recording(noise, radar), doppler=False).power.mean())
