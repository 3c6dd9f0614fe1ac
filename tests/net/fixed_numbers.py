"""Fixed simulations, and the rows of tables over one fixed frame of readings: what no change of structure may change.

`python tests/net/fixed_numbers.py` stores the present numbers, after a change of results that CHANGELOG.md names.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fake_campaign import FakeCampaign, config, frame_of

from experiments.campaign.cases import Motion
from experiments.campaign.frame import Frame, read
from experiments.recognition import corner_reflector_calibration
from experiments.rover import point_clouds, rover_disentangle, rover_fidelity
from experiments.turntable import environment, linear_rail, turntable_material, turntable_shape, turntable_size
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.io.progress import Progress
from radartwin.materials.layers import Layered
from radartwin.radar.chirp import Radar
from radartwin.scene.objects import shapes
from radartwin.scene.objects.catalogue import make
from radartwin.scene.rooms import room
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.backend import backend

SAMPLES, ROWS = Path(__file__).with_name("samples.npz"), Path(__file__).with_name("rows.json")
NODES = 16
REST = trajectory.pose([0.0, 0.0, 1.0])[None]
DRIVE = np.array([trajectory.pose([0.0, y, 1.0]) for y in (0.0, 0.02, 0.04)])
PLACE = trajectory.pose([1.4, 0.05, 0.92])
TURNS = trajectory.turntable(PLACE[:3, 3], frames=3, frame_rate_hz=1.0)
SLABS = Layered([("plasterboard", 0.0125)], backing="concrete")

SPHERE = Surface(shapes.sphere(0.1, 3), "metal", "sphere")
PLATE = Surface(shapes.plate(0.2, 0.3), "glass", "plate")
BOX = Surface(shapes.box((-0.1, -0.1, -0.1), (0.1, 0.15, 0.1)), "wood", "crate")
MUG, CAN, REFLECTOR = make("mug"), make("can_211_300"), make("corner_reflector")


def walls(material: str | Layered = "concrete", **settings: Any) -> list[Surface]:
    """Return a wall and a floor that touch."""
    corners = {"wall": ((2.5, -1.5, 0.0), (2.6, 1.5, 2.5)), "floor": ((-0.5, -1.5, -0.1), (2.6, 1.5, 0.0))}
    return [Surface(shapes.box(*ends), material, name, **settings) for name, ends in corners.items()]


def channel(surfaces: Any, sensor: np.ndarray, moving: Any = (), poses: np.ndarray = TURNS, simulator: str = "mitsuba") -> np.ndarray:
    """Return the transfer functions (3, NODES) between isotropic antennas in three frames, over the band of a chirp."""
    motion = {surface.name: poses for surface in moving}
    radar = Radar.iwr1843()
    sensor = np.broadcast_to(sensor, (3, 4, 4))
    total = np.zeros((3, NODES), complex)
    for part in backend(simulator).paths(Scene([*surfaces, *moving]), radar, sensor, motion):
        node = np.arange(NODES) * len(part.frequencies_hz) // NODES
        phase = 2 * np.pi * part.frequencies_hz[node] * part.length_m[:, None] / SPEED_OF_LIGHT
        fields = np.zeros((part.poses, NODES), complex)
        np.add.at(fields, part.pose, part.amplitude[:, node] * np.exp(1j * phase))
        total += fields
    return total


HELD = np.repeat(PLACE[None], 3, axis=0)
SIMULATIONS: dict[str, Callable[[], np.ndarray]] = {
    "a sphere alone": partial(channel, [], REST, [SPHERE], HELD),
    "a plate alone": partial(channel, [], REST, [PLATE]),
    "a turning reflector alone": partial(channel, [], REST, REFLECTOR),
    "a turning mug alone": partial(channel, [], REST, MUG),
    "a can before a wall": partial(channel, walls(), REST, CAN),
    "a crate before a wall": partial(channel, walls(), REST, [BOX]),
    "a drive past a can": partial(channel, walls(), DRIVE, CAN, HELD),
    "a drive past a crate that stands in the room": partial(channel, [*walls(), BOX.moved(PLACE)], DRIVE),
    "a rough wall": partial(channel, walls(roughness_m=0.001), REST),
    "walls of slabs": partial(channel, walls(SLABS), DRIVE),
    "the bare laboratory": partial(channel, room("lab", detail="shell").surfaces, REST),
    "points": partial(channel, walls(), REST, CAN, simulator="points"),
    "RF-Genesis": partial(channel, walls(), REST, CAN, simulator="rfgenesis"),
}


DRIVES = ("depth", "lateral")
TABLES: dict[str, tuple[Any, tuple[Motion, ...]]] = {
    "corner_reflector_calibration": (corner_reflector_calibration.score, ("turntable",)),
    "environment": (environment.score, ()),
    "linear_rail": (linear_rail.score, linear_rail.MOTIONS),
    "point_clouds": (point_clouds.score, DRIVES),
    "rover_disentangle": (rover_disentangle.score, DRIVES),
    "rover_fidelity": (rover_fidelity.score, DRIVES),
    "turntable_material": (turntable_material.score, ("turntable",)),
    "turntable_shape": (turntable_shape.score, ("turntable",)),
    "turntable_size": (turntable_size.score, ("turntable",)),
}
TEXTS = {"claim", "family", "test", "unit", "run_keys", "paper", "reason", "domain", "seed", "interval_scale", "direction", "level"}


def campaign(motions: tuple[Motion, ...], distances: tuple[float, ...] = (0.5, 1.0)) -> Any:
    """Return a campaign that needs no simulator."""
    rooms = ("lab",) if motions == ("turntable",) else ("squash_court",)
    return FakeCampaign(motions, rooms, distances, repetitions=2, frames=24, gap=0.05)


@cache
def frame(motions: tuple[Motion, ...]) -> Frame:
    """Return the readings of a campaign; without motions, those of the table `environment`."""
    if motions:
        return frame_of(campaign(motions), *motions)
    sides = environment.sources(campaign(("turntable",), (0.5, 1.0, 1.5, 2.0)))
    return environment.read(config("environment"), sides, partial(read, progress=Progress(quiet=True)))


def rows(name: str) -> list[dict[str, Any]]:
    """Return the rows of a results table over the fixed readings as JSON values, without texts that every row repeats."""
    score, motions = TABLES[name]
    of_table = score(config(name), frame(motions)).rows
    kept = [{key: value for key, value in row.items() if value not in (None, "") and key not in TEXTS} for row in of_table]
    return json.loads(json.dumps(kept, default=float))


def main() -> None:
    samples: dict[str, Any] = {name: simulate() for name, simulate in SIMULATIONS.items()}
    np.savez_compressed(SAMPLES, **samples)
    lines = (f'"{name}": [\n' + ",\n".join(json.dumps(row) for row in rows(name)) + "\n]" for name in TABLES)
    ROWS.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
