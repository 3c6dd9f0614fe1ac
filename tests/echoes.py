"""Simulated recordings of point echoes with known ranges, levels, directions and speeds, for tests of features."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording

RADAR = Radar.iwr1843("isotropic")
BIN_M = RADAR.range_resolution_m
Motion = float | Callable[[np.ndarray], np.ndarray]


def echoes(
    frames: int, points: list[tuple[Motion, Motion] | tuple[Motion, Motion, float]], noise: float = 0.0, seed: int = 0, radar: Radar = RADAR
) -> Recording:
    """Compute the recording of point echoes in the far field of the array, chirp by chirp.

    Args:
        points: one tuple per point, (amplitude, range in metres) or (amplitude, range in metres, azimuth in degrees). Amplitude and range
            are numbers or functions of the time in seconds.
        noise: standard deviation of the complex noise in each sample.
    """
    time = np.arange(frames)[:, None, None] / radar.frame_rate_hz + radar.chirp_times()[None]
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    shape = (frames, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples)
    rng = np.random.default_rng(seed)
    iq = np.zeros(shape, complex)
    if noise:
        iq += noise / np.sqrt(2) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    for point in points:
        amplitude, distance = (value(time) if callable(value) else np.full(time.shape, value) for value in point[:2])
        azimuth = np.deg2rad(point[2]) if len(point) > 2 else 0.0
        towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        length = 2 * distance[..., None] - (radar.tx_positions @ towards)[:, None] - radar.rx_positions @ towards
        iq += amplitude[..., None, None] * np.exp(2j * np.pi * frequency * length[..., None] / SPEED_OF_LIGHT)
    return Recording(iq, radar)
