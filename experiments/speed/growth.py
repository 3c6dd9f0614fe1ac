"""Growth of the run time with the size of the problem: surfaces, bounces, frames, ray tubes and antenna channels.

Each sweep changes one size and leaves the others at small values. The slope of a sweep is that of the straight line through the logarithms
of size and processor time. A slope of 1 means that the time grows in proportion to the size.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.interface import Config, Progress, Result, Table
from experiments.speed.flat_of_rooms import flat
from experiments.speed.machine import machine
from experiments.statistics import Estimate, exact
from experiments.verdicts import BELOW, Claim, RowList
from radartwin.radar.chirp import Radar
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import variant
from radartwin.simulation.backends import mitsuba
from radartwin.simulation.backends.static_scene import StaticScene
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.pruning import PRUNE
from radartwin.simulation.simulate import simulate, trace_paths
from radartwin.store.products import Store, save_json

TABLE = Table(
    name="growth",
    title="Growth of the run time",
    caption="Processor time of all threads against the size of the problem, without kernel compilation. Surfaces: a furnished flat of "
    "rooms with this number of flat surfaces, and a radar that drives through 10 cm in the middle room. Its set-up finds the faces and "
    "the sequences of faces and edges; the time per frame is that of the paths. Bounces: the same two times in the flat of 100 surfaces. "
    "Frames: a whole simulation of a driving radar in a room of ten surfaces, with one chirp per frame. Tubes: a metal sphere in "
    "free space, by its area in square wavelengths. Channels: a whole simulation of one frame of a radar at rest in a room of 30 "
    "surfaces, without the search for paths. A slope is that of a straight line through the logarithms of size and time. Its interval is "
    "the range of the slopes without one of the points. n counts the points.",
    timed=True,
)

SECONDS, SLOPE = "processor time (s)", "slope of time against size"
DRIVE_M, FRAMES = 0.1, 20  # length in metres and number of frames of the drives through flats of rooms
ROOM, ROOM_BOUNCES = 100, 4  # surfaces of the flat in the sweep of bounces, and bounces in the sweep of surfaces
SPHERES_M = (0.02, 0.04, 0.08, 0.16, 0.32)  # radii of the spheres in metres
CHANNELS = ((2, 4), (4, 4), (4, 12), (8, 12), (12, 16))  # transmitters and receivers


@dataclass(frozen=True)
class Sweep:
    """A sweep over one size of the problem, and the claims about the slope of each part of the run time."""

    size: str  # name of the size that the sweep changes
    measure: Callable[[int], dict[str, tuple[float, float]]]  # {part of the run time: (size, processor seconds)} of one step
    quick: tuple[int, ...]  # steps of the quick profile
    paper: tuple[int, ...]  # steps of the paper profile
    limits: Mapping[str, float]  # largest claimed slope of each part


def seconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of a call in seconds, and its result."""
    began = time.process_time()
    result = call()
    return time.process_time() - began, result


def driven(size: int, surfaces: int, bounces: int) -> dict[str, tuple[float, float]]:
    """Return {part of the run time: (size, processor seconds)} of a radar that drives through a flat of rooms."""
    variant.activate("auto")
    radar, (scene, place) = Radar.iwr1843(), flat(surfaces)
    poses = np.array([trajectory.pose(place + np.array([x, 0.0, 0.0])) for x in np.linspace(0.0, DRIVE_M, FRAMES)])

    def prepared() -> tuple[Any, Any]:
        static = StaticScene(list(scene.surfaces), *mitsuba.target(list(scene.surfaces), radar))
        return static, static.room.searched(poses, radar, bounces, PRUNE)

    setup_s, (static, searched) = seconds(prepared)
    whole_s, _ = seconds(lambda: static.room_paths(poses, radar, bounces, PRUNE, searched))
    return {"set-up": (size, setup_s), "frame": (size, whole_s / FRAMES)}


def of_frames(count: int) -> dict[str, tuple[float, float]]:
    """Return {part: (size, seconds)} for a drive of `count` frames up and down a track of 10 cm."""
    radar, (scene, place) = replace(Radar.iwr1843(), num_chirps=1), flat(10)
    track = DRIVE_M * (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / 50))
    poses = np.array([trajectory.pose(place + np.array([x, 1e-6 * count, 0.0])) for x in track])
    return {"simulation": (count, seconds(lambda: simulate(scene, radar, poses))[0])}


def of_tubes(step: int) -> dict[str, tuple[float, float]]:
    """Return {part: (size, seconds)} for a metal sphere, where the size is its cross-section in square wavelengths."""
    radar, radius_m = Radar.iwr1843(), SPHERES_M[step]
    scene = Scene([Surface(objects.sphere(radius_m, 4), "metal", "sphere", role="object")])
    poses = [trajectory.pose([-1.0 - 1e-4 * k, 0.0, 0.0])[None] for k in range(4)]
    trace_paths(scene, radar, poses[0], None, TraceSettings())
    spent = min(seconds(lambda pose=pose: trace_paths(scene, radar, pose, None, TraceSettings()))[0] for pose in poses[1:])
    return {"tracing": (np.pi * radius_m**2 / radar.wavelength_m**2, spent)}


def of_channels(step: int) -> dict[str, tuple[float, float]]:
    """Return {part: (size, seconds)} for a radar at rest with T transmitters and R receivers."""
    transmitters, receivers = CHANNELS[step]
    half = Radar.iwr1843().wavelength_m / 2
    radar = replace(
        Radar.iwr1843(), frame_rate_hz=1.0,
        tx_positions_m=tuple((0.0, receivers * half * k, 0.0) for k in range(transmitters)),
        rx_positions_m=tuple((0.0, half * k, 0.0) for k in range(receivers)),
    )  # fmt: skip
    scene, place = flat(30)
    pose = trajectory.pose(place - np.array([0.0, 0.5 * (transmitters * receivers - 1) * half, 0.0]))[None]
    simulate(scene, radar, pose)
    return {"simulation": (transmitters * receivers, min(seconds(lambda: simulate(scene, radar, pose))[0] for _ in range(5)))}


SWEEPS = (
    Sweep(
        "surfaces",
        lambda n: driven(n, n, ROOM_BOUNCES),
        (10, 30, 100),
        (10, 30, 100, 300, 1000, 3000, 10_000),
        {"set-up": 1.0, "frame": 0.5},
    ),
    Sweep("bounces", lambda n: driven(n, ROOM, n), (1, 2, 3, 4), (1, 2, 3, 4, 5, 6), {"set-up": 3.0, "frame": 3.0}),
    Sweep("frames", of_frames, (10, 30, 100, 300, 1000), (10, 30, 100, 300, 1000, 3000, 10_000), {"simulation": 1.05}),
    Sweep("tubes", of_tubes, (0, 1, 2, 3), (0, 1, 2, 3, 4), {"tracing": 1.05}),
    Sweep("channels", of_channels, (0, 1, 2, 3, 4), (0, 1, 2, 3, 4), {"simulation": 1.05}),
)


def identity() -> dict[str, Any]:
    """Return additions to the run key: the description of the machine, because run times depend on the machine."""
    return {"machine": machine()}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Measure each sweep that has no stored run times of this machine. Then fit the slope of log(time) over log(size)."""
    rows: list[dict[str, Any]] = []
    keys = []
    for sweep in progress.over(SWEEPS, "sizes"):
        steps = sweep.quick if config.profile.name == "quick" else sweep.paper
        spec = {"size": sweep.size, "steps": steps, **identity()}
        product = store.fetch("timing", spec, (__name__,), partial(_measure, sweep, steps))
        keys.append(product.key)
        rows += table(config, sweep, product.read_json("steps"), product.key)
    metrics = {f"{r['size']} {r['part']}": r["value"] for r in rows if r["metric"] == SLOPE}
    return Result(TABLE.name, rows, {TABLE.name: lambda: chart(rows)}, metrics, keys)


def _measure(sweep: Sweep, steps: Sequence[int], folder: Path) -> None:
    sweep.measure(steps[0])  # compiles the kernels
    save_json(folder, "steps", [sweep.measure(step) for step in steps])


def table(config: Config, sweep: Sweep, measured: Sequence[Mapping[str, Any]], key: str) -> RowList:
    """Return the rows of a sweep: the processor time of each step, then the slope of each part with its claim."""
    rows = RowList(config)
    for part, limit in sweep.limits.items():
        sizes, spent = np.array([step[part] for step in measured], float).T
        case = {"size": sweep.size, "part": part, "machine": "; ".join(machine().values())}
        for size, value in zip(sizes, spent, strict=True):
            rows.add({**case, "at": float(size)}, SECONDS, exact(float(value), 1), [key])
        claim = Claim(f"the slope is at most {limit:g}", bound=limit, direction=BELOW, limit=True)
        rows.add({**case, "at": None}, SLOPE, slope(sizes, spent), [key], claim)
    return rows


def slope(sizes: np.ndarray, spent: np.ndarray) -> Estimate:
    """Return the slope of a line through the logarithms of sizes and times, and the range of the slopes with one point left out.

    >>> slope(np.array([1.0, 2.0, 4.0]), np.array([3.0, 12.0, 48.0])).value.round(6)
    np.float64(2.0)
    """
    x, y = np.log(sizes), np.log(np.maximum(spent, 1e-6))
    keep = ~np.eye(len(x), dtype=bool)
    fits = [np.polyfit(x, y, 1)[0], *(np.polyfit(x[kept], y[kept], 1)[0] for kept in keep)]
    return Estimate(fits[0], min(fits), max(fits), len(x))


def chart(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw processor time against size, with one panel per sweep and the fitted slope of each part."""
    drawing, panels = figure(2, 3, width_in=PAGE_WIDTH_IN, height_in=4.4)
    for panel, sweep in zip(panels.flat, SWEEPS, strict=False):
        for colour, part in zip(PALETTE, sweep.limits, strict=False):
            mine = [r for r in rows if (r["size"], r["part"]) == (sweep.size, part)]
            fitted = next(r["value"] for r in mine if r["metric"] == SLOPE)
            points = [(r["at"], r["value"]) for r in mine if r["metric"] == SECONDS]
            panel.plot(*zip(*points, strict=True), marker="o", markersize=3, color=colour, label=f"{part}, slope {fitted:.2f}")
        panel.set(xscale="log", yscale="log", xlabel=sweep.size, ylabel=SECONDS)
        if max(at for at, _ in points) < 10:  # a logarithmic axis of less than a decade has labels that overlap
            panel.set_xticks([at for at, _ in points], [f"{at:g}" for at, _ in points], minor=False)
            panel.minorticks_off()
        panel.legend()
    for panel in list(panels.flat)[len(SWEEPS) :]:
        panel.set_visible(False)
    return drawing
