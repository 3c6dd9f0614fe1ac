"""Benchmarks of run time and memory, against the targets in `bench_figures` and against earlier runs.

    python -m experiments.speed.bench [--repeats 5] [--only synthesis frames single drives memory scan] [--variant cuda] [--history]

The exit status is 0 even if a figure misses its target or differs from earlier runs, because run times depend on the machine and its load.
Ratios of run times within one run can also be compared between machines.

The function `timed` runs the compared methods in turn, once per repetition. If other programs slow the machine for some time, this affects
all compared methods alike. The direct sum is timed on DIRECT_PATHS instead of PATHS paths, and the measured time is scaled up, because the
time of the direct sum is proportional to the number of paths.
"""

import argparse
import itertools
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import trimesh

import radartwin as rt
from experiments.speed.bench_figures import FIGURES, table
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
MEMORY_RAYS = 3_000_000
SCAN_FACES, SCAN_NOISE_M = 500_000, 0.005  # triangles of a scan, and deviation of a vertex coordinate as in the fused mesh of a phone LiDAR
HISTORY = Path(__file__).with_name("bench_history.csv")

Values = dict[str, float]  # measured values by the name of their figure in FIGURES


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
        """Simulate a scene with a moving sensor and with objects in `motion`. Each call of this function shifts the sensor, so that no
        paths of the room come from the cache.
        """
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
    """Time drives along one track past an object: a corner reflector on a stand, traced as a campaign traces them
    (`campaign.target.seen`), and a metal can alone.

    The set-up of a track traces what all drives along the track share: the room, and the paths between the object and the room. Before the
    timing, a drive through another room compiles the kernels. Because the room is another one, the timed set-up takes no results from a
    cache.
    """
    bench = rooms.bench("lab")
    nominal = trajectory.lateral_sweep(bench.sensor_pose)
    reflector, disc, post = on_stand(bench)
    at = trajectory.pose(bench.target_position(1.0))
    can = rt.Surface(objects.cylinder(0.033, 0.12).apply_transform(at), "metal", "can", role="object")
    stand, alone = ([disc, reflector], [post]), ([can],)
    values, declared = Values(), {figure.name for figure in FIGURES}
    _driven(rooms.lab((6.1, 5.0, 2.8), detail="cluttered"), nominal[WARM_UP], {"": stand, " past a can": alone}, 1, variant)
    for detail, end, groups in (("furnished", "", {"": stand, " past a can": alone}), ("cluttered", ", clutter", {" past a can": alone})):
        print(f"Drives of {len(nominal)} frames through the laboratory, {detail}:")
        for name, seconds in _driven(rooms.room("lab", detail=detail), nominal, groups, repeats, variant).items():
            wall = show(name, seconds[:, 0], f"{1e3 * np.median(seconds[:, 1]):.2f} ms of processor time")
            if name + end in declared:
                values[name + end] = wall if "set-up" in name else 1e3 * wall
    return values


def _driven(
    room: rt.Scene, nominal: np.ndarray, objects_of: Mapping[str, Sequence[list[rt.Surface]]], repeats: int, variant: str
) -> dict[str, np.ndarray]:
    """Time drives past objects in a room.

    Args:
        objects_of: {ending of the names of the results: groups of surfaces}; only the first group has paths over both object and room.
    Returns:
        Wall time and processor time (repeats, 2) in seconds: of each part of a frame, of the whole frame ("drive frame"), and of each part
        of the set-up.
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


def in_new_process(imports: str, code: str, *arguments: str) -> dict[str, float]:
    """Run code that makes a scene `scene` in a new process.

    Returns the number `surfaces` of the scene, the wall time `seconds` of the code without its imports, and for the whole process the
    processor time `core_seconds` and the largest resident memory `peak_gib`.
    """
    code = f"""
import json, sys, time
from experiments.speed.machine import peak_gib
{imports}
began = time.perf_counter()
{code}
print(json.dumps({{"seconds": time.perf_counter() - began, "core_seconds": time.process_time(), "peak_gib": peak_gib(),
                  "surfaces": len(scene)}}))
"""
    answer = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    return json.loads(answer.stdout.splitlines()[-1])


def memory(repeats: int, variant: str) -> Values:
    """Measure the peak resident memory of a new process that traces a furnished room with many rays."""
    usage = in_new_process(
        "import radartwin as rt; from radartwin.scene import rooms",
        "scene = rooms.lab()\n"
        f"rt.simulate(scene, rt.Radar.iwr1843(), rooms.lab_bench().sensor_pose[None], rays={MEMORY_RAYS}, variant={variant!r})",
    )
    print(f"Memory: a furnished room at {MEMORY_RAYS} rays, 4 bounces: {usage['peak_gib']:.2f} GiB at most")
    return {"memory of a furnished room": usage["peak_gib"]}


def scan(repeats: int, variant: str) -> Values:
    """Time the reconstruction of a scan of half a million triangles, and measure its memory."""
    result = reconstruction()
    print(
        f"Reconstruction of a scan of {result['faces']:,.0f} faces: {result['seconds']:.0f} s ({result['core_seconds']:.0f} core-seconds), "
        f"peak {result['peak_gib']:.2f} GiB, {result['surfaces']:.0f} surfaces"
    )
    return {"reconstruction of a scan": result["seconds"], "memory of a scan reconstruction": result["peak_gib"]}


def reconstruction() -> dict[str, float]:
    """Reconstruct the scan of a furnished laboratory in a new process. Returns the entries of `in_new_process`, and the number `faces` of
    triangles. The times include reading the scan file and writing the reconstructed scene.

    The scan consists of the true surfaces, cut into about SCAN_FACES equal triangles, with colours and with the depth noise of a phone.
    """
    pieces = [surface.mesh for surface in rooms.lab()]
    area = sum(float(piece.area) for piece in pieces)
    edge = 1.5 * float(np.sqrt(4 / np.sqrt(3) * area / SCAN_FACES))  # the split edges are between half the allowed length and that length
    rng = np.random.default_rng(0)
    fine: list[Any] = [trimesh.Trimesh(piece.vertices, piece.faces, process=False).subdivide_to_size(edge, max_iter=20) for piece in pieces]
    colours = [np.tile(np.random.default_rng([0, k]).integers(60, 220, 3), (len(piece.vertices), 1)) for k, piece in enumerate(fine)]
    whole: Any = trimesh.util.concatenate(fine)
    shade = np.clip(np.vstack(colours) + rng.normal(0, 5, (len(whole.vertices), 3)), 0, 255).astype(np.uint8)
    noisy = whole.vertices + SCAN_NOISE_M * rng.standard_normal(whole.vertices.shape)
    with tempfile.TemporaryDirectory() as folder:
        trimesh.Trimesh(noisy, whole.faces, vertex_colors=shade, process=False).export(f"{folder}/scan.ply")
        imports, code = "from radartwin.reconstruct.build import reconstruct", "scene = reconstruct(sys.argv[1], sys.argv[2])"
        return {"faces": len(whole.faces), **in_new_process(imports, code, f"{folder}/scan.ply", f"{folder}/scene")}


def measured(benchmarks: Sequence[str], repeats: int, variant: str) -> Values:
    """Run benchmarks by name and return all their figures. Raises RuntimeError if a benchmark measures other figures than declared."""
    values = Values()
    for name in benchmarks:
        figures = BENCHMARKS[name](repeats, variant)
        if wrong := figures.keys() ^ {figure.name for figure in FIGURES if figure.benchmark == name}:
            raise RuntimeError(f"{', '.join(sorted(wrong))}: measured or declared for the benchmark {name}, but not both; correct FIGURES")
        values |= figures
    return values


def read(history: Path = HISTORY) -> pd.DataFrame:
    """Return the history with all cells as text, one row per run; an empty table if the file does not exist."""
    return pd.read_csv(history, dtype=str) if history.is_file() else pd.DataFrame()


def append(machine: Mapping[str, object], values: Mapping[str, float], history: Path = HISTORY) -> Path:
    """Add a line with commit, machine and figures to the history file, and return the path of this file. The file is replaced in one step.

    If the run did not measure a figure, the cell of this figure is empty. A figure that is new in the history file adds a column at the
    end.
    """
    head, changed = checkout.commit()
    line = {"date": time.strftime("%Y-%m-%d"), "commit": head[:12], "changed": "yes" if changed else "no", **machine}
    line |= {figure.column: f"{values[figure.name]:.4g}" for figure in FIGURES if figure.name in values}
    return files.write_atomically(history, pd.concat([read(history), pd.DataFrame([line])]).to_csv(index=False, lineterminator="\n"))


def main() -> None:
    parser = argparse.ArgumentParser(description="Benchmarks of run time and memory, against targets and earlier runs.")
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
    values = measured([name for name in BENCHMARKS if name in arguments.only], arguments.repeats, arguments.variant)
    print(f"\nTargets hold for 2 processor cores.\n{table(values, read(), machine)}")
    if arguments.history:
        print(f"history: {append(machine, values)}")


BENCHMARKS: dict[str, Callable[[int, str], Values]] = {
    "synthesis": synthesis, "frames": frames, "single": single, "drives": drives, "memory": memory, "scan": scan,
}  # fmt: skip

if __name__ == "__main__":
    main()
