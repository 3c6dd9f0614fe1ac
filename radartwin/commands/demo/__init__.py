"""Implement `radartwin demo`: turn a shipped phone scan into a labelled scene, a recording, its peaks and a page, with the functions of the
verbs reconstruct, label, simulate, process and view.

The scan is in the folder `scan` beside this file, with its source and licence. A second run computes and replaces all files again.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radartwin.builders.recording import build_setup, simulate_setup
from radartwin.builders.simulator import simulated_parts, simulator_options
from radartwin.commands.demo.demo_page import Picture, draw_strip, write_page
from radartwin.config.compose import compose, path_override
from radartwin.io import files
from radartwin.io.one_line import plural
from radartwin.label.labelling import LabelOptions, label_folder
from radartwin.label.z_buffer import Camera
from radartwin.radar.detection import Peaks
from radartwin.radar.power_maps import power_maps
from radartwin.radar.process_capture import process_capture
from radartwin.reconstruct.build import reconstruct
from radartwin.scene.scene import Scene
from radartwin.scene.viewer.page import view
from radartwin.simulation.compile_ahead import compiling
from radartwin.simulation.origins import echo_origins

SCAN = Path(__file__).resolve().parent / "scan" / "chair.obj.gz"
# position of the radar in the scan's coordinates: 1.5 m in front of the chair, at the height of the chair's back
POSITION_M = (-1.5, -0.5, 0.6)
STRIP = "strip.png"  # scan, materials and echoes side by side: the picture of README.md
EYE_M = np.array([-0.4, 0.0, 0.8])  # position of the strip's camera relative to the radar: behind it and above it
PIXELS, FIELD_DEG = 500, 62.0  # width and height of the camera's pictures, and their field of view
STEPS = 6


@dataclass
class _Steps:
    """Print one line per step: its number and its work when it begins, its result and duration when it ends."""

    done: int = 0

    @contextlib.contextmanager
    def step(self, work: str) -> Iterator[list[str]]:
        self.done += 1
        start, result = time.monotonic(), list[str]()
        print(f"[{self.done}/{STEPS}] {work}", end="", flush=True)
        try:
            yield result
            print(f": {result[0]} ({time.monotonic() - start:.0f} s)", end="")
        finally:
            print(flush=True)


def demo(output: Path) -> Path:
    """Run the demonstration into the folder `output`/demo, and return the path of its page.

    Args:
        output: root folder of all written files.
    Raises:
        OutputError: the folder cannot be created or written.
    """
    folder = files.make_folder(files.check_folder(output) / "demo")
    files.sweep(folder)
    scan, scene_folder, recording = folder / "chair.obj", folder / "scene", folder / "recordings" / "chair"
    steps = _Steps()
    with compiling() as compiled:
        with steps.step("unpack the phone scan of a patio with a chair") as result:
            files.write_atomically(scan, gzip.decompress(SCAN.read_bytes()))
            result.append(str(scan))
        with steps.step("reconstruct the scan as planes and objects") as result:
            result.append(plural(len(reconstruct(scan, scene_folder)), "surface"))
        with steps.step("label the materials with the recorded answers of a vision-language model") as result:
            result.append(label_folder(scene_folder, LabelOptions())[-1].split(",")[0])
        with steps.step("simulate a radar recording (a first run compiles the simulator: about a minute)") as result:
            place = [path_override("scene.path", scene_folder), f"trajectory.position_m={list(POSITION_M)}"]
            config = compose(["scene=scan", "scene.target=none", "trajectory=static", *place])
            compiled()
            setup = build_setup(config.radar, config.scene, config.materials, config.trajectory, config.seed, config.contents)
            simulated = simulate_setup(setup, config, config.scene.target, noise=True, out=recording)
            result.append(plural(len(simulated.iq), "frame"))
    with steps.step("detect the peaks and find the surface of each peak") as result:
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
    with steps.step("write the page") as result:
        room = view(Scene.load(scene_folder), scene_folder / "view.html", pose, title="The scan, coloured by material")
        picture = Picture(power_maps(simulated.iq, simulated.radar), peaks, origins)
        page = write_page(folder / "index.html", room.read_text(encoding="utf-8"), scene, picture)
        camera = Camera.looking(pose[:3, 3] + EYE_M, pose[:3, 3] + 1.2 * pose[:3, 0] - 0.2 * pose[:3, 2], FIELD_DEG, PIXELS)
        drawing = io.BytesIO()
        draw_strip(scene, picture, camera).savefig(drawing, format="png", dpi=110, metadata={"Software": None})
        files.write_atomically(folder / STRIP, drawing.getvalue())
        result.append(f"{page.stat().st_size / 1e3:.0f} kB")
    return page
