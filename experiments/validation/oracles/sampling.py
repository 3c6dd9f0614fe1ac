"""Compare the synthesis of radar samples from propagation paths with the direct sum over paths that defines the signal."""

from dataclasses import replace

import numpy as np

from experiments.validation.oracles import traced
from experiments.validation.oracles.case import SPEED_OF_LIGHT, Case, Finding, reference_rows, worst
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import synthesize

RADAR = traced.ARRAY


def scattered_paths(count: int, fastest_mps: float, seed: int) -> Paths:
    """Return `count` random paths of one sensor pose, up to 8 m long, whose lengths change at up to `fastest_mps`."""
    rng = np.random.default_rng(seed)
    ways = [way / np.linalg.norm(way, axis=1, keepdims=True) for way in rng.normal(size=(2, count, 3))]
    amplitude = rng.normal(size=(count, 1)) + 1j * rng.normal(size=(count, 1))
    lengths = rng.uniform(0.3, 8.0, (2, count))
    return Paths(
        1, np.zeros(count, int), np.ones(count, int), amplitude, np.array([RADAR.center_frequency_hz]),
        lengths[0], lengths[1], ways[0], ways[1], rng.uniform(-fastest_mps, fastest_mps, count),
    )  # fmt: skip


def direct(paths: Paths) -> np.ndarray:
    """Return samples (loops, tx, rx, samples), summed path by path, with exact distances to every element and motion within a chirp."""
    fast = np.arange(RADAR.num_samples) / RADAR.sample_rate_hz
    frequency = RADAR.start_frequency_hz + RADAR.slope_hz_per_s * fast
    start = (RADAR.num_tx * np.arange(RADAR.num_chirps)[:, None] + np.arange(RADAR.num_tx)) * RADAR.chirp_interval
    total = np.zeros((RADAR.num_chirps, RADAR.num_tx, RADAR.num_rx, RADAR.num_samples), complex)
    for i in range(len(paths)):
        out = np.linalg.norm(paths.length_in_m[i] * paths.departure[i] - RADAR.tx_positions, axis=1)
        back = np.linalg.norm(paths.length_out_m[i] * paths.arrival[i] - RADAR.rx_positions, axis=1)
        length = out[None, :, None, None] + back[None, None, :, None] + paths.rate_mps[i] * (start[:, :, None, None] + fast)
        total += paths.amplitude[i, 0] * np.exp(2j * np.pi * frequency * length / SPEED_OF_LIGHT)
    return total


def _direct(full: bool) -> Finding:
    errors = []
    for seed, fastest in enumerate((0.0, 0.2, 6.0) if full else (0.2,)):
        paths = scattered_paths(300 if full else 60, fastest, seed)
        expected = direct(paths)
        errors.append(float(np.linalg.norm(synthesize(paths, RADAR)[0] - expected) / np.linalg.norm(expected)))
    return Finding(0.0, max(errors), max(errors), len(errors))


def _array(full: bool) -> Finding:
    """Compare the largest deviation from plane-wave phase over the eight channels with the reference table, for a target on the axis."""
    pairs = []
    for row in reference_rows("array_phase_error_deg.csv"):
        distance = float(row["R_m"])
        direction = np.array([[1.0, 0.0, 0.0]])
        point = replace(
            scattered_paths(1, 0.0, 0), amplitude=np.ones((1, 1), complex), length_in_m=np.array([distance]),
            length_out_m=np.array([distance]), departure=direction, arrival=direction,
        )  # fmt: skip
        samples = synthesize(point, RADAR)[0, 0].reshape(8, -1)[:, 0]
        turned = np.degrees(np.angle(samples * np.exp(-4j * np.pi * RADAR.start_frequency_hz / SPEED_OF_LIGHT * distance)))
        pairs.append((float(row["planar_max_deg"]), float(np.abs(turned).max())))
    return worst(pairs)


CASES = [
    Case("synthesis", "samples", "paths to samples of all chirps and channels, moving", "direct sum over paths, chirps and samples",
         "relative error", 1e-3, "", _direct),
    Case("array-table", "samples", "spherical wave over the eight channels, 0.2 to 5 m", "reference/array_phase_error_deg.csv",
         "phase beyond a planar wave's (deg)", 0.3, "deg", _array),
]  # fmt: skip
