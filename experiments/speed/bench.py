"""Benchmarks of run time per frame. The results are ratios of run times within one run of the benchmarks, because absolute times differ
between machines.

    python -m experiments.speed.bench [--repeats 5] [--only synthesis frames memory scan] [--variant cuda] [--history]

The timed methods alternate, so that a slow phase of the machine affects all methods. The direct sum is timed on DIRECT_PATHS instead of
PATHS paths, and the measured time is scaled up, because the time of the direct sum is proportional to the number of paths.
"""

import argparse
import itertools
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

import radartwin as rt
from experiments.speed.bench_scan import line, measure
from experiments.speed.machine import processor
from experiments.validation.oracles import sampling
from radartwin.io import files
from radartwin.runs import checkout
from radartwin.scene import objects, rooms
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import variant as variant_module
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.signal.synthesis import synthesize

PATHS, DIRECT_PATHS = 100_000, 1_000
FRAMES = 100
ROOM_FRAMES = 20  # with a room around the object
MOVING_FRAMES = {"panels": 50, "tubes": 5}  # by method, for a sensor that moves 2 cm per frame; with tubes, frames share no work
MEMORY_RAYS = 3_000_000
HISTORY = Path(__file__).with_name("bench_history.csv")
Rows = dict[str, float]  # measured ratios by name


def timed(methods: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, np.ndarray]:
    """Return the seconds of each repetition of each method.

    The methods alternate. A first round without timing compiles the kernels.
    """
    for method in methods.values():
        method()
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(repeats):
        for name, method in methods.items():
            began = time.perf_counter()
            method()
            seconds[name].append(time.perf_counter() - began)
    return {name: np.array(values) for name, values in seconds.items()}


def show(name: str, seconds: np.ndarray, note: str) -> float:
    """Print the run times of a method with a note. Returns the median run time in seconds."""
    median = float(np.median(seconds))
    print(f"  {name:44s} {median * 1e3:9.2f} ms  ({seconds.min() * 1e3:.2f} to {seconds.max() * 1e3:.2f})  {note}")
    return median


def ratio(rows: Rows, name: str, value: float) -> None:
    print(f"  ratio {name}: {value:.3g}")
    rows[name] = value


def synthesis(repeats: int, rows: Rows, variant: str) -> None:
    """Compare the run time of sample synthesis by gridding with the direct sum, and of `elements="planar"` with `elements="exact"`."""
    radar = sampling.RADAR
    for rate in (0.0, 0.5):
        paths, few = sampling.scattered_paths(PATHS, rate, 0), sampling.scattered_paths(DIRECT_PATHS, rate, 0)
        methods = {
            "gridding": lambda p=paths: synthesize(p, radar),
            "gridding, planar elements": lambda p=paths: synthesize(p, radar, elements="planar"),
            "direct sum in NumPy": lambda p=few: sampling.direct(p),
        }
        seconds = timed(methods, repeats)
        seconds["direct sum in NumPy"] *= PATHS / DIRECT_PATHS
        expected = sampling.direct(few)
        error = float(np.linalg.norm(synthesize(few, radar)[0] - expected) / np.linalg.norm(expected))
        print(f"IQ synthesis, {PATHS} paths x {radar.num_chirps} chirps x 8 channels, speeds up to {rate} m/s:")
        notes = {"gridding": f"relative error {error:.1e}", "direct sum in NumPy": f"scaled from {DIRECT_PATHS} paths"}
        at = f" at {rate} m/s"
        grid, planar, direct = (show(name + at, values, notes.get(name, "")) for name, values in seconds.items())
        ratio(rows, f"direct sum to gridding{at}", direct / grid)
        ratio(rows, f"exact to planar elements{at}", grid / planar)


def frames(repeats: int, rows: Rows, variant: str) -> None:
    """Time the simulation of whole frames, from poses to IQ samples."""
    radar, bench = rt.Radar.iwr1843(), rooms.lab_bench()
    turning = trajectory.turntable(bench.target_position(1.5), FRAMES, radar.frame_rate_hz)
    target = rt.Scene([rt.Surface(objects.trihedral(0.1), "metal", "reflector")])
    lab = rooms.lab()
    pose, motion = bench.sensor_pose[None], {"reflector": turning}
    some = {"reflector": turning[:: FRAMES // ROOM_FRAMES]}
    calls = itertools.count()

    def moving(room: str) -> None:
        """Simulate a moving sensor and object. Each call of this function shifts the sensor, so that no paths of the room come from
        the cache.
        """
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
        medians[name] = show(name, each, f"a frame, {1 / np.median(each):.0f} frames/s")
    print(f"  the room at rest is traced once, {first:.1f} s with compilation")
    ratio(rows, "static room to object only", medians["object in a static furnished room"] / medians["object only"])
    panels, alone = medians["moving sensor and object, panel images"], medians["moving sensor and object, tubes alone"]
    ratio(rows, "moving, tubes alone to panel images", alone / panels)


def memory(repeats: int, rows: Rows, variant: str) -> None:
    """Measure the peak resident memory of a new process that traces a furnished room with many rays."""
    code = (
        "import resource, numpy as np, radartwin as rt; from radartwin.scene import rooms\n"
        f"rt.simulate(rooms.lab(), rt.Radar.iwr1843(), rooms.lab_bench().sensor_pose[None], rays={MEMORY_RAYS}, variant={variant!r})\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    gibibytes = int(answer.stdout.split()[-1]) / 2**20
    print(f"Memory: a furnished room at {MEMORY_RAYS} rays, 4 bounces: {gibibytes:.2f} GiB at most")


def scan(repeats: int, rows: Rows, variant: str) -> None:
    """Time the reconstruction of a scan of half a million triangles."""
    print(line(measure()))


def append(machine: Mapping[str, object], ratios: Mapping[str, float], history: Path = HISTORY) -> Path:
    """Add a line with commit, machine and ratios to the history file, and return the path of this file. The history file is replaced as a
    whole.

    If the run did not measure a ratio, the cell of this ratio is empty. A ratio that is new in the history file adds a column at the end.
    """
    head, changed = checkout.commit()
    line = {"date": time.strftime("%Y-%m-%d"), "commit": head[:12], "changed": "yes" if changed else "no", **machine}
    line |= {name: f"{value:.4g}" for name, value in ratios.items()}
    earlier = pd.read_csv(history, dtype=str) if history.is_file() else pd.DataFrame()
    return files.write_atomically(history, pd.concat([earlier, pd.DataFrame([line])]).to_csv(index=False, lineterminator="\n"))


def main() -> None:
    parser = argparse.ArgumentParser(description="Benchmarks, as ratios within one run.")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=BENCHMARKS)
    parser.add_argument("--variant", choices=("llvm", "cuda"), default="llvm", help="Mitsuba variant of the tracer")
    parser.add_argument("--history", action="store_true", help="add the ratios as a line to bench_history.csv")
    chosen = parser.parse_args()
    machine = {
        "processor": processor(), "cores": os.cpu_count(), "load": f"{os.getloadavg()[0]:.1f}", "python": platform.python_version(),
        "repeats": chosen.repeats, "variant": chosen.variant,
    }  # fmt: skip
    print(f"{machine}, NumPy {np.__version__}")
    rows: Rows = {}
    for name in BENCHMARKS:
        if name in chosen.only:
            BENCHMARKS[name](chosen.repeats, rows, chosen.variant)
    if chosen.history:
        print(f"history: {append(machine, rows)}")


BENCHMARKS: dict[str, Callable[[int, Rows, str], None]] = {"synthesis": synthesis, "frames": frames, "memory": memory, "scan": scan}

if __name__ == "__main__":
    main()
