"""Implement `radartwin demo`: turn a shipped phone scan (folder `scan`) into a labelled scene, a recording, named echoes and a page."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from radartwin.builders.recording import build_setup, simulate_setup
from radartwin.builders.simulator import simulated_parts, simulator_options
from radartwin.commands.demo.demo_page import Echoes, write_page
from radartwin.config.compose import compose, path_override
from radartwin.io import files
from radartwin.io.one_line import plural
from radartwin.label.labelling import LabelOptions, label_folder
from radartwin.radar.detection import Peaks
from radartwin.radar.power_maps import power_maps
from radartwin.radar.process_capture import process_capture
from radartwin.reconstruct.build import reconstruct
from radartwin.scene.scene import Scene
from radartwin.scene.thing_names import things
from radartwin.simulation.compile_ahead import compiling
from radartwin.simulation.origins import echo_origins

SCAN = Path(__file__).resolve().parent / "scan" / "room.glb"
# position of the radar in the scan's coordinates, 1 m above the floor in front of the screen, and its direction towards the sofa
POSITION_M, HEADING_DEG = (-0.2, 1.0, -0.6), -90
SENTENCE = "a corner reflector on the table turned by 90 degrees"
# coarse settings, with which the simulation of this room takes a third of the time: wider ray tubes, one reflection and diffraction fewer
COARSE = ("simulator.rays_per_wavelength2=0.25", "simulator.max_bounces=3", "simulator.diffractions=1")
STEPS = 5


@contextlib.contextmanager
def _step(number: int, work: str) -> Iterator[list[str]]:
    """Print one line: the number and the work of a step when it begins, its result and duration when it ends."""
    start, result = time.monotonic(), list[str]()
    print(f"[{number}/{STEPS}] {work}", end="", flush=True)
    try:
        yield result
        print(f": {result[0]} ({time.monotonic() - start:.0f} s)", end="")
    finally:
        print(flush=True)


def demo(output: Path) -> Path:
    """Run the demonstration into the folder `output`/demo, and return the path of its page. Raises OutputError."""
    folder = files.make_folder(files.check_folder(output) / "demo")
    files.sweep(folder)
    scene_folder, recording = folder / "scene", folder / "recordings" / "room"
    with compiling() as compiled:
        with _step(1, "reconstruct the phone scan of a furnished room as planes and objects") as result:
            result.append(plural(len(reconstruct(SCAN, scene_folder)), "surface"))
        with _step(2, "label the materials with the recorded answers of a vision-language model") as result:
            label_folder(scene_folder, LabelOptions(missing="uniform:plasterboard"))
            result.append(_largest(Scene.load(scene_folder)))
        with _step(3, f'place "{SENTENCE}" and simulate the radar (a first run compiles the simulator: one to two minutes)') as result:
            place = [path_override("scene.path", scene_folder), f'scene.sentence="{SENTENCE}"']
            radar = ["trajectory=static", f"trajectory.position_m={list(POSITION_M)}", f"trajectory.heading_deg={HEADING_DEG}"]
            config = compose(["scene=scan", *place, *radar, "trajectory.frames=1", *COARSE])
            compiled()
            setup = build_setup(config)
            simulated = simulate_setup(setup, config, config.scene.target, noise=True, out=recording)
            result.append(plural(len(simulated.iq), "frame"))
    with _step(4, "detect the echoes and find the thing from which each echo comes") as result:
        table = process_capture(recording, folder / "processed")
        columns = {name: table[name].to_numpy() for name in table}
        azimuth_rad, power = np.radians(columns["azimuth_deg"]), 10 ** (columns["power_db"] / 10)
        unknown = np.full(len(power), np.nan)  # peaks.csv has neither elevation nor noise
        peaks = Peaks(columns["range_m"], columns["doppler_mps"], azimuth_rad, unknown, power, unknown)
        scene, pose = simulated_parts(config.simulator, setup.room), setup.course.sensor_poses[0]
        tracer = simulator_options(config.simulator)["simulator"]
        paths = tracer.paths(scene, setup.radar, pose[None])  # the simulation left these paths in the memory of this process
        origins = echo_origins(scene, paths, setup.radar, pose, peaks.range_m, peaks.azimuth_rad)
        result.append(plural(len(peaks), "peak"))
    with _step(5, "write the pictures and the page") as result:
        page = write_page(folder, scene, Echoes(power_maps(simulated.iq, simulated.radar), peaks, origins, pose, scene))
        result.append(f"{page.stat().st_size / 1e6:.1f} MB")
    return page


def _largest(scene: Scene) -> str:
    """Return the largest things of a scene in words."""
    areas: Counter[str] = Counter()
    for surface, thing in zip(scene, things(scene), strict=True):
        areas[thing.category] += surface.mesh.area
    return ", ".join(category for category, _ in areas.most_common(8)) + " and more"
