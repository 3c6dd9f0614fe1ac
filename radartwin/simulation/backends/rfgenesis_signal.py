"""Signal of the naive tracer, computed as in the published program of RF Genesis, to measure the time of a whole frame.

For every chirp, transmitter and receiver, the program evaluates each hit's echo at every sample with its carrier, sums the weighted echoes
and mixes them with the transmitted chirp: s = tx conj(sum of echoes). Unlike the shared synthesis, this includes the residual video phase
S L^2/(2 c^2).
"""

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation.backends import rfgenesis


def direct_frame(start_m: np.ndarray, stop_m: np.ndarray, weight: np.ndarray, radar: Radar) -> np.ndarray:
    """Compute one frame with simultaneous transmitters. The hits move from `start_m` to `stop_m` until the next frame.

    Args:
        start_m, stop_m: (N, 3) hits in the sensor frame, at the start of this frame and of the next.
        weight: (N,) factor by which the free-space power loss is multiplied.
    Returns:
        complex (C, T, R, samples) for C chirps, T transmitters and R receivers.
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
