"""Benchmarks: run time per frame, as ratios within one run.

    python experiments/speed/bench.py [--repeats 5] [--only synthesis frames rfgenesis memory scan] [--variant cuda]
        [--json FILE] [--history]

Methods take turns, so that a machine that slows down slows all of them. Medians and ranges are printed; only the ratios can be compared
between machines. `--history` adds the ratios as a line to bench_history.csv beside this file. The direct sum is timed on DIRECT_PATHS
instead of PATHS paths and its time is scaled up, because it is proportional to the number of paths. The error of gridding is computed on
the same DIRECT_PATHS paths. Without `--variant`, the tracing benchmarks run on the processor, and then in another process on a GPU if
there is one.
"""

import argparse
import itertools
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_history import append
from machine import processor

import radartwin as rt
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene import objects, rooms
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import variant as variant_module
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.backends.rfgenesis import RFGenesisSettings
from radartwin.simulation.backends.rfgenesis_signal import whole_frame_seconds
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import planar_phase, synthesize

PATHS, DIRECT_PATHS = 100_000, 1_000
FRAMES = 100
ROOM_FRAMES = 20  # with a room around the object
MOVING_FRAMES = {"panels": 50, "tubes": 5}  # by method, for a sensor that moves 2 cm per frame; with tubes, frames share no work
MEMORY_RAYS = 3_000_000
BENCHMARKS = ("synthesis", "frames", "rfgenesis", "memory", "scan")
Rows = dict[str, object]


def random_paths(count: int, rate_mps: float) -> Paths:
    """Return random paths of one sensor pose: lengths as in a room, all directions, and path length rates up to `rate_mps`."""
    rng = np.random.default_rng(0)
    unit = [d / np.linalg.norm(d, axis=1, keepdims=True) for d in rng.normal(size=(2, count, 3))]
    amplitude = rng.normal(size=(count, 1)) + 1j * rng.normal(size=(count, 1))
    lengths = rng.uniform(0.3, 5.0, (2, count))
    rates = rng.uniform(-rate_mps, rate_mps, count)
    frequency = np.array([78.72e9])
    return Paths(1, np.zeros(count, int), np.ones(count, int), amplitude, frequency, lengths[0], lengths[1], unit[0], unit[1], rates)


def direct_sum(paths: Paths, radar: Radar) -> np.ndarray:
    """Compute the signal by its definition in NumPy: one exponential per path, chirp, channel and sample."""
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
    """Return the seconds of each method's repetitions. Methods take turns, after a first round without timing that compiles the kernels."""
    for method in methods.values():
        method()
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(repeats):
        for name, method in methods.items():
            began = time.perf_counter()
            method()
            seconds[name].append(time.perf_counter() - began)
    return {name: np.array(values) for name, values in seconds.items()}


def show(rows: Rows, name: str, seconds: np.ndarray, note: str) -> float:
    """Print the run time of a method, store it in `rows`, and return its median in seconds."""
    median = float(np.median(seconds))
    print(f"  {name:44s} {median * 1e3:9.2f} ms  ({seconds.min() * 1e3:.2f} to {seconds.max() * 1e3:.2f})  {note}")
    rows[name] = {"median_s": median, "least_s": float(seconds.min()), "most_s": float(seconds.max())}
    return median


def ratio(rows: Rows, name: str, value: float) -> None:
    print(f"  ratio {name}: {value:.3g}")
    rows[f"ratio {name}"] = value


def synthesis(repeats: int, rows: Rows) -> None:
    """Compare the synthesis by gridding with the direct sum, and planar with exact antenna elements."""
    radar = rt.Radar.iwr1843(element="isotropic")
    for rate in (0.0, 0.5):
        paths, few = random_paths(PATHS, rate), random_paths(DIRECT_PATHS, rate)
        methods = {
            "gridding": lambda p=paths: synthesize(p, radar),
            "gridding, planar elements": lambda p=paths: synthesize(p, radar, elements="planar"),
            "direct sum in NumPy": lambda p=few: direct_sum(p, radar),
        }
        seconds = timed(methods, repeats)
        seconds["direct sum in NumPy"] *= PATHS / DIRECT_PATHS
        expected = direct_sum(few, radar)
        error = float(np.linalg.norm(synthesize(few, radar) - expected) / np.linalg.norm(expected))
        print(f"IQ synthesis, {PATHS} paths x {radar.num_chirps} chirps x 8 channels, speeds up to {rate} m/s:")
        notes = {"gridding": f"relative error {error:.1e}", "direct sum in NumPy": f"scaled from {DIRECT_PATHS} paths"}
        at = f" at {rate} m/s"
        grid, planar, direct = (show(rows, name + at, values, notes.get(name, "")) for name, values in seconds.items())
        rows[f"relative error{at}"] = error
        ratio(rows, f"direct sum to gridding{at}", direct / grid)
        ratio(rows, f"exact to planar elements{at}", grid / planar)
    for shortest_m in (0.5, 2.0, 5.0):
        path = random_paths(DIRECT_PATHS, 0.0)
        path = replace(path, length_in_m=path.length_in_m * 0 + shortest_m, length_out_m=path.length_out_m * 0 + shortest_m)
        exact, planar_iq = (synthesize(path, radar, elements=elements) for elements in ("exact", "planar"))
        off = float(np.linalg.norm(exact - planar_iq) / np.linalg.norm(exact))
        print(f"  planar elements at {shortest_m} m: relative error {off:.1e}, bound {planar_phase(path, radar):.1e}")
        rows[f"planar error at {shortest_m} m"] = off


def frames(repeats: int, rows: Rows, variant: str) -> None:
    """Time whole frames, from poses to IQ samples."""
    radar, bench = rt.Radar.iwr1843(), rooms.lab_bench()
    turning = trajectory.turntable(bench.target_position(1.5), FRAMES, radar.frame_rate_hz)
    target = rt.Scene([rt.Surface(objects.trihedral(0.1), "metal", "reflector")])
    lab = rooms.lab()
    pose, motion = bench.sensor_pose[None], {"reflector": turning}
    some = {"reflector": turning[:: FRAMES // ROOM_FRAMES]}
    calls = itertools.count()

    def moving(room: str) -> None:
        """Simulate a moving sensor and object. Each call shifts the sensor, because otherwise the cache would supply the room's paths."""
        frames = MOVING_FRAMES[room]
        sensor = np.repeat(pose, frames, axis=0)
        sensor[:, 1, 3] += 0.02 * (np.arange(frames) - frames / 2) + 1e-3 * next(calls)
        tracer = MitsubaBackend(TraceSettings(variant=variant, room=room))
        rt.simulate(lab + target, radar, sensor, motion={"reflector": turning[:frames]}, simulator=tracer)

    began = time.perf_counter()
    rt.simulate(lab, radar, pose, variant=variant)
    first = time.perf_counter() - began
    methods = {
        "object only": (FRAMES, lambda: rt.simulate(target, radar, pose, motion=motion, variant=variant)),
        "object in a static furnished room": (ROOM_FRAMES, lambda: rt.simulate(lab + target, radar, pose, motion=some, variant=variant)),
        "moving sensor and object, panel images": (MOVING_FRAMES["panels"], lambda: moving("panels")),
        "moving sensor and object, tubes alone": (MOVING_FRAMES["tubes"], lambda: moving("tubes")),
    }
    seconds = timed({name: method for name, (_, method) in methods.items()}, repeats)
    print(f"Frames, corner reflector on a turntable at 1.5 m, 8 channels, {variant_module.activate(variant)}:")
    medians = {}
    for name, values in seconds.items():
        each = values / methods[name][0]
        medians[name] = show(rows, name, each, f"a frame, {1 / np.median(each):.0f} frames/s")
    print(f"  the room at rest is traced once, {first:.1f} s with compilation")
    ratio(rows, "static room to object only", medians["object in a static furnished room"] / medians["object only"])
    panels, alone = medians["moving sensor and object, panel images"], medians["moving sensor and object, tubes alone"]
    ratio(rows, "moving, tubes alone to panel images", alone / panels)


def rfgenesis(repeats: int, rows: Rows, variant: str) -> None:
    """Compare the time of one frame of RF-Genesis, with its own signal synthesis, with our time per frame of the same scene."""
    radar, bench = rt.Radar.iwr1843(), rooms.lab_bench()
    turning = trajectory.turntable(bench.target_position(1.5), FRAMES, radar.frame_rate_hz)
    pose, target = bench.sensor_pose[None], rt.Scene([rt.Surface(objects.trihedral(0.1), "metal", "reflector")])
    print("Whole frames against the naive tracer with its own synthesis:")
    for name, scene, count in (("object only", target, FRAMES), ("furnished room", rooms.lab() + target, ROOM_FRAMES)):
        motion = {"reflector": turning[:: FRAMES // count]}
        ours = timed({"ours": lambda s=scene, m=motion: rt.simulate(s, radar, pose, motion=m, variant=variant)}, repeats)["ours"] / count
        settings = RFGenesisSettings()
        slow = whole_frame_seconds(scene, radar, bench.sensor_pose, {"reflector": turning[:1]}, settings)
        mine = show(rows, f"{name}, radartwin", ours, "a frame")
        theirs = show(rows, f"{name}, rfgenesis", np.array([slow.total_s]), f"one frame of {slow.hits} hits, trace {slow.trace_s:.2f} s")
        ratio(rows, f"rfgenesis to radartwin, {name}", theirs / mine)


def memory(rows: Rows, variant: str) -> None:
    """Measure the peak resident memory of a new process that traces a furnished room with many rays."""
    code = (
        "import resource, numpy as np, radartwin as rt; from radartwin.scene import rooms\n"
        f"rt.simulate(rooms.lab(), rt.Radar.iwr1843(), rooms.lab_bench().sensor_pose[None], rays={MEMORY_RAYS}, variant={variant!r})\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    gibibytes = int(answer.stdout.split()[-1]) / 2**20
    print(f"Memory: a furnished room at {MEMORY_RAYS} rays, 4 bounces: {gibibytes:.2f} GiB at most")
    rows[f"peak GiB at {MEMORY_RAYS} rays"] = gibibytes


def scan(rows: Rows) -> None:
    """Time the reconstruction of a scan of half a million triangles."""
    from bench_scan import line, measure

    found = measure()
    print(line(found))
    rows["scan to scene"] = found


def main() -> None:
    parser = argparse.ArgumentParser(description="Benchmarks, as ratios within one run.")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=BENCHMARKS)
    parser.add_argument("--variant", choices=("llvm", "cuda"), help="trace with this Mitsuba variant only")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the measured values to this file")
    parser.add_argument("--history", action="store_true", help="add the ratios as a line to bench_history.csv")
    chosen = parser.parse_args()
    variant, load = chosen.variant or "llvm", f"{os.getloadavg()[0]:.1f}"
    print(f"{processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, NumPy {np.__version__}")
    rows: Rows = {}
    if "synthesis" in chosen.only:
        synthesis(chosen.repeats, rows)
    if "frames" in chosen.only:
        frames(chosen.repeats, rows, variant)
    if "rfgenesis" in chosen.only:
        rfgenesis(chosen.repeats, rows, variant)
    if "memory" in chosen.only:
        memory(rows, variant)
    if "scan" in chosen.only:
        scan(rows)
    rows["peak GiB of this process"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    results: dict[str, object] = {"processor": processor(), "cores": os.cpu_count(), "repeats": chosen.repeats, variant: rows}
    on_gpu = [name for name in chosen.only if name not in ("synthesis", "scan")]
    if chosen.variant is None and on_gpu and variant_module.has_cuda():
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "cuda.json"
            options = ["--repeats", str(chosen.repeats), "--variant", "cuda", "--json", str(file), "--only", *on_gpu]
            subprocess.run([sys.executable, __file__, *options], check=True)
            results["cuda"] = json.loads(file.read_text())["cuda"]
    if chosen.history:
        machine = {"processor": processor(), "cores": os.cpu_count(), "load": load, "python": platform.python_version()}
        machine["repeats"] = chosen.repeats
        for name in ("llvm", "cuda"):
            if ratios := _ratios(results.get(name, {})):
                print(f"history: {append(machine | {'variant': name}, ratios)}")
    if chosen.json:
        chosen.json.write_text(json.dumps(results, indent=1) + "\n")


def _ratios(rows: object) -> dict[str, float]:
    """Return the ratios among the measured values, by name."""
    assert isinstance(rows, dict)
    return {name.removeprefix("ratio "): value for name, value in rows.items() if name.startswith("ratio ")}


if __name__ == "__main__":
    main()
