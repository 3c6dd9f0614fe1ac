"""Benchmarks: what a frame costs, as ratios within one run.

    python experiments/bench.py [--repeats 5]

Methods alternate, so that a machine that slows down slows all of them; medians and ranges are printed, and the ratios are what to
compare between machines. The direct sum is timed on a share of the paths and scaled (its cost is linear in them); its error reference is
that same share.
"""

import argparse
import os
import platform
import time
from collections.abc import Callable, Mapping

import numpy as np

import radartwin as rt
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene import objects, rooms, trajectory
from radartwin.simulation.paths import Paths
from radartwin.simulation.synthesis import synthesize

PATHS, DIRECT_PATHS = 100_000, 1_000
FRAMES = 100


def random_paths(count: int, rate_mps: float) -> Paths:
    """Paths of one pose with lengths of a room, all directions and speeds up to `rate_mps`."""
    rng = np.random.default_rng(0)
    unit = [d / np.linalg.norm(d, axis=1, keepdims=True) for d in rng.normal(size=(2, count, 3))]
    amplitude = rng.normal(size=(count, 1)) + 1j * rng.normal(size=(count, 1))
    lengths = rng.uniform(0.3, 5.0, (2, count))
    rates = rng.uniform(-rate_mps, rate_mps, count)
    frequency = np.array([78.72e9])
    return Paths(1, np.zeros(count, int), np.ones(count, int), amplitude, frequency, lengths[0], lengths[1], unit[0], unit[1], rates)


def direct_sum(paths: Paths, radar: rt.Radar) -> np.ndarray:
    """The signal's definition in NumPy: one exponential per path, chirp, channel and sample."""
    t = np.arange(radar.num_samples) / radar.sample_rate_hz
    f = radar.start_frequency_hz + radar.slope_hz_per_s * t
    out = np.zeros((1, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples), complex)
    start = radar.chirp_times()
    for k, p in enumerate(radar.tx_positions):
        to_tx = np.linalg.norm(paths.length_in_m[:, None] * paths.departure - p, axis=1)
        for r, q in enumerate(radar.rx_positions):
            still = to_tx + np.linalg.norm(paths.length_out_m[:, None] * paths.arrival - q, axis=1)
            for c in range(radar.num_chirps):
                length = still[:, None] + paths.rate_mps[:, None] * (start[c, k] + t)
                out[0, c, k, r] = paths.amplitude[:, 0] @ np.exp(2j * np.pi / SPEED_OF_LIGHT * f * length)
    return out


def timed(methods: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, np.ndarray]:
    """Seconds of each repetition, methods in turn; one unmeasured round first compiles the kernels."""
    for method in methods.values():
        method()
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(repeats):
        for name, method in methods.items():
            began = time.perf_counter()
            method()
            seconds[name].append(time.perf_counter() - began)
    return {name: np.array(values) for name, values in seconds.items()}


def show(name: str, seconds: np.ndarray, note: str) -> None:
    print(f"  {name:34s} {np.median(seconds) * 1e3:9.1f} ms  ({seconds.min() * 1e3:.1f} to {seconds.max() * 1e3:.1f})  {note}")


def synthesis(repeats: int) -> None:
    radar = rt.Radar.iwr1843(element="isotropic")
    for rate in (0.0, 0.5):
        paths, few = random_paths(PATHS, rate), random_paths(DIRECT_PATHS, rate)
        seconds = timed({"gridding": lambda p=paths: synthesize(p, radar), "direct": lambda p=few: direct_sum(p, radar)}, repeats)
        expected = direct_sum(few, radar)
        error = np.linalg.norm(synthesize(few, radar) - expected) / np.linalg.norm(expected)
        scaled = seconds["direct"] * PATHS / DIRECT_PATHS
        print(f"IQ synthesis, {PATHS} paths x {radar.num_chirps} chirps x 8 channels, speeds up to {rate} m/s:")
        show("gridding", seconds["gridding"], f"relative error {error:.1e}")
        show("direct sum in NumPy", scaled, f"scaled from {DIRECT_PATHS} paths")
        print(f"  ratio {np.median(scaled) / np.median(seconds['gridding']):.0f}")


def frames(repeats: int) -> None:
    radar, bench = rt.Radar.iwr1843(), rooms.lab_bench()
    turning = trajectory.turntable(bench.target_position(1.5), FRAMES, radar.frame_rate_hz)
    target = rt.Scene([rt.Surface(objects.trihedral(0.1), "metal", "reflector")])
    lab = rooms.lab()
    pose, motion = bench.sensor_pose[None], {"reflector": turning}
    began = time.perf_counter()
    rt.simulate(lab, radar, pose)
    first = time.perf_counter() - began
    methods = {
        "object only": lambda: rt.simulate(target, radar, pose, motion=motion),
        "object in a static furnished room": lambda: rt.simulate(lab + target, radar, pose, motion=motion),
    }
    seconds = timed(methods, repeats)
    print(f"Frames, corner reflector on a turntable at 1.5 m, 8 channels, {FRAMES} frames a call:")
    for name, values in seconds.items():
        show(name, values / FRAMES, f"a frame, {FRAMES / np.median(values):.0f} frames/s")
    ratio = np.median(seconds["object in a static furnished room"]) / np.median(seconds["object only"])
    print(f"  ratio room to object {ratio:.2f}; the room itself is traced once, {first:.1f} s with compilation")


def main() -> None:
    parser = argparse.ArgumentParser(description="Benchmarks, as ratios within one run.")
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, NumPy {np.__version__}"
    )
    synthesis(repeats)
    frames(repeats)


if __name__ == "__main__":
    main()
