"""Compute the signal of the naive tracer (see `rfgenesis`) in the same way as the original RF-Genesis program, to measure that program's
time per frame.

For every chirp, transmitter and receiver, the program evaluates the echo of each hit at every sample, with its carrier frequency. It sums
the weighted echoes and mixes the sum with the transmitted chirp tx: s = tx conj(sum of echoes). Unlike
`radartwin.simulation.signal.synthesis`, this signal includes the residual video phase S L^2/(2 c^2), in cycles, with the chirp slope S and
the path length L.
"""

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation.backends import rfgenesis


def direct_frame(start_m: np.ndarray, stop_m: np.ndarray, weight: np.ndarray, radar: Radar) -> np.ndarray:
    """Compute the samples of one frame, with all transmitters active at the same time.

    Args:
        start_m: (N, 3) positions of the hits in the sensor frame at the start of the frame, in metres.
        stop_m: (N, 3) positions of the same hits at the start of the next frame, in metres.
        weight: (N,) factor of each hit by which its free-space power loss is multiplied.
        radar: radar with C chirps per frame, T transmitters and R receivers.
    Returns:
        Complex samples (C, T, R, samples per chirp).
    """
    samples = np.arange(radar.num_samples) / radar.sample_rate_hz
    sent = _chirp(samples, radar)
    out = np.zeros((radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples), complex)
    for c in range(radar.num_chirps):
        share = c / radar.num_chirps
        points = start_m * (1 - share) + stop_m * share
        for t, tx in enumerate(radar.tx_positions):
            for r, rx in enumerate(radar.rx_positions):
                length = np.linalg.norm(points - tx, axis=1) + np.linalg.norm(points - rx, axis=1)
                level = rfgenesis.power_loss(length) * weight
                echoes = _chirp(samples - length[:, None] / SPEED_OF_LIGHT, radar) * level[:, None]
                out[c, t, r] = sent * np.conj(echoes.sum(axis=0))
    return out


def _chirp(t: np.ndarray, radar: Radar) -> np.ndarray:
    phase = 2 * np.pi * (radar.start_frequency_hz * t + 0.5 * radar.slope_hz_per_s * t * t)
    return np.cos(phase) + 1j * np.sin(phase)
