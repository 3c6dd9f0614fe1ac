"""Signal of the naive tracer, computed as in the published program of RF Genesis, to measure the time of a whole frame.

For every chirp, transmitter and receiver, the program evaluates each hit's echo at every sample with its carrier, sums the weighted echoes
and mixes them with the transmitted chirp: s = tx conj(sum of echoes). Unlike the shared synthesis, this includes the residual video phase
S L^2/(2 c^2).
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation.backends import rfgenesis


@dataclass(frozen=True)
class FrameSeconds:
    """Hold the number of hits and the wall-clock seconds of one frame."""

    hits: int
    trace_s: float
    synthesis_s: float

    @property
    def total_s(self) -> float:
        return self.trace_s + self.synthesis_s


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


def whole_frame_seconds(
    scene: Scene,
    radar: Radar,
    sensor_pose: np.ndarray,
    motion: Mapping[str, np.ndarray] | None = None,
    settings: rfgenesis.RFGenesisSettings | None = None,
) -> FrameSeconds:
    """Measure the time to trace and synthesise one frame with the shipped version, without the compilation of kernels.

    Args:
        sensor_pose: (4, 4). motion: (1, 4, 4) poses by surface name.
    """
    poses, motion, settings = sensor_pose[None], dict(motion or {}), settings or rfgenesis.RFGenesisSettings()
    rfgenesis.trace(scene, radar, poses, motion, settings)
    began = time.perf_counter()
    hits = rfgenesis.trace(scene, radar, poses, motion, settings)
    traced = time.perf_counter()
    seen = hits.distance[0] > rfgenesis.MIN_VISIBLE
    distance = hits.distance[0, seen]
    points = distance[:, None] * hits.directions[seen]
    direct_frame(points, points, distance, radar)
    return FrameSeconds(int(seen.sum()), traced - began, time.perf_counter() - traced)
