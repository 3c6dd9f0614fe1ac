"""Benchmarks of run time, against the project's targets for 2 processor cores and against the last run.

    python -m experiments.speed.bench [--repeats 5] [--only synthesis frames single drives] [--variant cuda] [--history]

The exit status is 0 even if a figure misses its target, because run times depend on the machine and its load. Ratios of run times within
one run can also be compared between machines, because the compared methods take turns.
"""

import argparse
import itertools
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import radartwin as rt
from experiments.validation.oracles import sampling
from radartwin.benchmark.leaderboard import processor
from radartwin.io import files
from radartwin.runs import checkout
from radartwin.scene import objects, rooms
from radartwin.scene.rooms.parts import GAP, Bench
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import variant as variant_module
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.signal.synthesis import received, synthesize

PATHS, FRAME_PATHS, DIRECT_PATHS = 100_000, 5_000, 1_000
MANY_PATHS = 1_000_000
FRAMES = 100
ROOM_FRAMES = 20  # number of frames with a room around the object
MOVING_FRAMES = {"panels": 50, "tubes": 5}  # by method, for a sensor that moves 2 cm per frame; with tubes, frames do not share work
CALLS = 20  # number of calls, each of one frame
WARM_UP = slice(20, 26)  # poses of a drive that is simulated first, to compile the kernels
ASIDE_M = 1e-3  # shift of the sensor between repetitions, so that no paths come from a cache
HISTORY = Path(__file__).with_name("bench_history.csv")
COMPARABLE = ("processor", "cores", "variant")  # columns of the history that are equal in comparable runs
LARGER = ("", "frames/s")  # units of figures that are better if larger
FIGURES: dict[str, tuple[str, float | None]] = {  # unit, and the worst value that passes
    "gridding of 5,000 paths x 8 channels": ("ms/frame", 10), "gridding of 100,000 paths at 0.0 m/s": ("ms/frame", None),
    "gridding of 100,000 paths at 0.5 m/s": ("ms/frame", None), "gridding of 1,000,000 paths at 0.5 m/s": ("ms/frame", None),
    "direct sum to gridding at 0.0 m/s": ("", 80), "exact to planar elements at 0.0 m/s": ("", None),
    "direct sum to gridding at 0.5 m/s": ("", 80), "exact to planar elements at 0.5 m/s": ("", None),
    "object only, 100 frames in one call": ("frames/s", 1000), "object in a static furnished room": ("ms/frame", 30),
    "moving sensor and object, flat faces": ("ms/frame", 30), "moving sensor and object, tubes alone": ("ms/frame", 250),
    "moving sensor, resting target, flat faces": ("ms/frame", 30), "static room to object only": ("", None),
    "moving, tubes alone to flat faces": ("", None), "one frame in one call, sphere": ("ms", 3),
    "one frame in one call, corner reflector": ("ms", 3), "drive frame": ("ms/frame", 30), "track set-up": ("s", None),
    "object track set-up": ("s", None), "drive frame past a can": ("ms/frame", 30), "drive frame past a can, clutter": ("ms/frame", 30),
    "track set-up, clutter": ("s", None),
}  # fmt: skip
Values = dict[str, float]  # measured values by the name of their figure in FIGURES


def timed(methods: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, np.ndarray]:
    """Return the seconds of each repetition of each method. The methods alternate, after a round that compiles the kernels."""
    for method in methods.values():
        method()
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(repeats):
        for name, method in methods.items():
            began = time.perf_counter()
            method()
            seconds[name].append(time.perf_counter() - began)
    return {name: np.array(values) for name, values in seconds.items()}


def show(name: str, seconds: np.ndarray, note: str = "") -> float:
    """Print the run times of a method with a note. Returns the median run time in seconds."""
    median = float(np.median(seconds))
    print(f"  {name:44s} {median * 1e3:9.2f} ms  ({seconds.min() * 1e3:.2f} to {seconds.max() * 1e3:.2f})  {note}".rstrip())
    return median


def on_stand(bench: Bench) -> list[rt.Surface]:
    """Return a corner reflector that faces the sensor from 1.5 m, and the disc and the post of the stand below the reflector."""
    at, sensor = bench.target_position(1.5), bench.sensor_pose[:3, 3]
    mesh = objects.trihedral(0.1).apply_transform(trajectory.look_at(at, sensor))
    low = mesh.bounds[0, 2] - GAP
    return [rt.Surface(mesh, "metal", "reflector", role="object"), *rooms.support(np.array([*at[:2], low]))]


def synthesis(repeats: int, variant: str) -> Values:
    """Compare the run time of sample synthesis by gridding with the direct sum, and of `elements="planar"` with `elements="exact"`."""
    radar = sampling.RADAR
    print(f"IQ synthesis, {radar.num_chirps} chirps x 8 channels, speeds up to 0.5 m/s, {variant_module.activate(variant)}:")
    values = Values()
    for count, end in ((FRAME_PATHS, " x 8 channels"), (MANY_PATHS, " at 0.5 m/s")):
        frame = sampling.scattered_paths(count, 0.5, 0)
        (seconds,) = timed({"": lambda frame=frame: received([frame], radar, 1)}, repeats).values()
        values[f"gridding of {count:,} paths{end}"] = 1e3 * show(f"gridding of {count:,} paths", seconds)
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
        grid, planar, direct = (show(name + at, each, notes.get(name, "")) for name, each in seconds.items())
        values[f"gridding of {PATHS:,} paths{at}"] = 1e3 * grid
        values[f"direct sum to gridding{at}"] = direct / grid
        values[f"exact to planar elements{at}"] = grid / planar
    return values


def frames(repeats: int, variant: str) -> Values:
    """Time the simulation of whole frames, from poses to IQ samples."""
    radar, bench = rt.Radar.iwr1843(), rooms.lab_bench()
    turning = trajectory.turntable(bench.target_position(1.5), FRAMES, radar.frame_rate_hz)
    target = rt.Scene([rt.Surface(objects.trihedral(0.1), "metal", "reflector")])
    lab = rooms.lab()
    pose, motion = bench.sensor_pose[None], {"reflector": turning}
    few = {"reflector": turning[:: FRAMES // ROOM_FRAMES]}
    calls = itertools.count()

    def moving(room: str, scene: rt.Scene, motion: Mapping[str, np.ndarray]) -> None:
        frames = MOVING_FRAMES[room]
        sensor = np.repeat(pose, frames, axis=0)
        sensor[:, 1, 3] += 0.02 * (np.arange(frames) - frames / 2) + ASIDE_M * next(calls)
        shortened = {name: poses[:frames] for name, poses in motion.items()}
        rt.simulate(scene, radar, sensor, motion=shortened, simulator=MitsubaBackend(TraceSettings(variant=variant, room=room)))

    began = time.perf_counter()
    rt.simulate(lab, radar, pose, variant=variant)
    first = time.perf_counter() - began
    methods = {
        "object only, 100 frames in one call": (FRAMES, lambda: rt.simulate(target, radar, pose, motion=motion, variant=variant)),
        "object in a static furnished room": (ROOM_FRAMES, lambda: rt.simulate(lab + target, radar, pose, motion=few, variant=variant)),
        "moving sensor and object, flat faces": (MOVING_FRAMES["panels"], lambda: moving("panels", lab + target, motion)),
        "moving sensor and object, tubes alone": (MOVING_FRAMES["tubes"], lambda: moving("tubes", lab + target, motion)),
        "moving sensor, resting target, flat faces": (
            MOVING_FRAMES["panels"], lambda: moving("panels", lab + rt.Scene(on_stand(bench)), {})
        ),
    }  # fmt: skip
    seconds = timed({name: method for name, (_, method) in methods.items()}, repeats)
    print(f"Frames, corner reflector at 1.5 m, 8 channels, {variant_module.activate(variant)}:")
    values = {name: 1e3 * show(name, each / methods[name][0], "a frame") for name, each in seconds.items()}
    print(f"  the room at rest is traced once, {first:.1f} s with compilation")
    alone = values["object only, 100 frames in one call"]
    values["static room to object only"] = values["object in a static furnished room"] / alone
    faces, tubes = (values[f"moving sensor and object, {method}"] for method in ("flat faces", "tubes alone"))
    values["moving, tubes alone to flat faces"] = tubes / faces
    return values | {"object only, 100 frames in one call": 1e3 / alone}


def single(repeats: int, variant: str) -> Values:
    """Time calls that simulate one frame of one object each, at another sensor pose in each call."""
    radar = rt.Radar.iwr1843()
    shapes = {"sphere": objects.sphere(0.05), "corner reflector": objects.trihedral(0.1)}
    scenes = {name: rt.Scene([rt.Surface(mesh, "metal", name)]) for name, mesh in shapes.items()}
    calls = itertools.count()

    def call(scene: rt.Scene) -> None:
        for _ in range(CALLS):
            pose = trajectory.look_at([1.5, ASIDE_M * next(calls), 0.0], [0.0, 0.0, 0.0])
            rt.simulate(scene, radar, pose[None], variant=variant)

    print(f"One frame in one call, sphere of 10 cm diameter and corner reflector with 10 cm edges at 1.5 m, {CALLS} calls:")
    seconds = timed({name: lambda scene=scene: call(scene) for name, scene in scenes.items()}, repeats)
    return {f"one frame in one call, {name}": 1e3 * show(name, each / CALLS, "a call") for name, each in seconds.items()}


def drives(repeats: int, variant: str) -> Values:
    """Time drives along one track past a corner reflector on a stand, traced as a campaign traces them, and past a metal can alone.

    Before the timing, a drive through another room compiles the kernels, so that the timed set-up takes no results from a cache.
    """
    bench = rooms.bench("lab")
    nominal = trajectory.lateral_sweep(bench.sensor_pose)
    reflector, disc, post = on_stand(bench)
    at = trajectory.pose(bench.target_position(1.0))
    can = rt.Surface(objects.cylinder(0.033, 0.12).apply_transform(at), "metal", "can", role="object")
    stand, alone = ([disc, reflector], [post]), ([can],)
    values = Values()
    _driven(rooms.lab((6.1, 5.0, 2.8), detail="cluttered"), nominal[WARM_UP], {"": stand, " past a can": alone}, 1, variant)
    for detail, end, groups in (("furnished", "", {"": stand, " past a can": alone}), ("cluttered", ", clutter", {" past a can": alone})):
        print(f"Drives of {len(nominal)} frames through the laboratory, {detail}:")
        for name, seconds in _driven(rooms.room("lab", detail=detail), nominal, groups, repeats, variant).items():
            wall = show(name, seconds[:, 0], f"{1e3 * np.median(seconds[:, 1]):.2f} ms of processor time")
            if name + end in FIGURES:
                values[name + end] = wall if "set-up" in name else 1e3 * wall
    return values


def _driven(
    room: rt.Scene, nominal: np.ndarray, objects_of: Mapping[str, Sequence[list[rt.Surface]]], repeats: int, variant: str
) -> dict[str, np.ndarray]:
    """Return wall and processor time (repeats, 2) in seconds of each part of a frame, of a whole frame, and of each part of the set-up.
    `objects_of` has groups of surfaces by the ending of the results' names; only the first group has paths over both object and room.
    """
    radar, still = rt.Radar.iwr1843(), np.eye(4)[None]
    taken: dict[str, list[np.ndarray]] = {}

    def part(name: str, method: Callable[[], Any], frames: int = 1) -> Any:
        began = np.array([time.perf_counter(), time.process_time()])
        result = method()
        taken.setdefault(name, []).append((np.array([time.perf_counter(), time.process_time()]) - began) / frames)
        return result

    def set_up() -> Track:
        track = Track.of_drives(list(room), radar, nominal, TraceSettings(variant=variant))
        track.room(nominal)
        return track

    track = part("track set-up", set_up)
    for end, groups in objects_of.items():
        over = part(f"object track set-up{end}", lambda groups=groups: track.over_room(groups[0]))
        parts = [f"paths of the room{end}", f"paths of the object and of its shadow{end}", f"samples of room and object{end}"]
        for k in range(repeats):
            actual, frames = nominal.copy(), len(nominal)
            actual[:, 0, 3] += ASIDE_M * (k + 1 + repeats * list(objects_of).index(end))
            background = part(parts[0], lambda at=actual: track.room(at), frames)
            echo = part(parts[1], lambda at=actual, groups=groups, over=over: [
                *(paths for group in groups for paths in track.moving(group, at, still, False)),
                *over.seen(at, radar.frame_rate_hz),
            ], frames)  # fmt: skip
            part(parts[2], lambda paths=background + echo: received(paths, radar, len(nominal)), frames)
        taken[f"drive frame{end}"] = [np.sum(each, axis=0) for each in zip(*(taken[name] for name in parts), strict=True)]
    return {name: np.stack(each) for name, each in taken.items()}


def table(values: Mapping[str, float], history: pd.DataFrame, machine: Mapping[str, object]) -> str:
    """Return the measured figures with their targets, and the figures of the last run with the same processor, cores and variant."""
    same = history[[all(str(run[name]) == str(machine[name]) for name in COMPARABLE) for run in history.to_dict("records")]]
    last = same.iloc[-1] if len(same) else pd.Series(dtype=str)
    rows = {}
    for name, value in values.items():
        unit, target = FIGURES[name]
        larger = unit in LARGER
        passes = target is None or (value >= target if larger else value <= target)
        bound = f"{'at least' if larger else 'at most'} {target:g}" if target is not None else "-"
        rows[column(name)] = (f"{value:.4g}", bound, "-" if target is None else "pass" if passes else "miss", last.get(column(name), "-"))
    return pd.DataFrame.from_dict(rows, "index", columns=["value", "target", "", "last run"]).fillna("-").to_string()


def column(name: str) -> str:
    """Return the column of a figure in the history, which is its name with the unit."""
    return f"{name}, {FIGURES[name][0]}" if FIGURES[name][0] else name


def read(history: Path = HISTORY) -> pd.DataFrame:
    """Return the history with all cells as text, one row per run; an empty table if the file does not exist."""
    return pd.read_csv(history, dtype=str) if history.is_file() else pd.DataFrame()


def append(machine: Mapping[str, object], values: Mapping[str, float], history: Path = HISTORY) -> Path:
    """Add a line with commit, machine and figures to the history file, in one step. A new figure adds a column at the end."""
    head, changed = checkout.commit()
    line = {"date": time.strftime("%Y-%m-%d"), "commit": head[:12], "changed": "yes" if changed else "no", **machine}
    line |= {column(name): f"{value:.4g}" for name, value in values.items()}
    return files.write_atomically(history, pd.concat([read(history), pd.DataFrame([line])]).to_csv(index=False, lineterminator="\n"))


def main() -> None:
    parser = argparse.ArgumentParser(description="Benchmarks of run time, against targets and earlier runs.")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=BENCHMARKS)
    parser.add_argument("--variant", choices=("llvm", "cuda"), default="llvm", help="Mitsuba variant of the tracer")
    parser.add_argument("--history", action="store_true", help="add the figures as a line to bench_history.csv")
    arguments = parser.parse_args()
    machine = {
        "processor": processor(), "cores": os.cpu_count(), "load": f"{os.getloadavg()[0]:.1f}", "python": platform.python_version(),
        "repeats": arguments.repeats, "variant": arguments.variant,
    }  # fmt: skip
    print(f"{machine}, NumPy {np.__version__}")
    values = Values()
    for name in (name for name in BENCHMARKS if name in arguments.only):
        values |= BENCHMARKS[name](arguments.repeats, arguments.variant)
    print(f"\nTargets hold for 2 processor cores.\n{table(values, read(), machine)}")
    if arguments.history:
        print(f"history: {append(machine, values)}")


BENCHMARKS: dict[str, Callable[[int, str], Values]] = {
    "synthesis": synthesis, "frames": frames, "single": single, "drives": drives,
}  # fmt: skip

if __name__ == "__main__":
    main()
