"""The simulation methods compared in speed, accuracy and stability: RadarTwin's tracer at several settings, and other simulators.

RF-Genesis appears with the same synthesis of samples as all other methods, and (`published`) with the signal generator that its authors
released, which computes one sum over the echoes for each chirp, transmitter and receiver. As all sums take the same time, only one is
timed, and its time is multiplied by their number.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np

from experiments.speed.problems import OFFICE, Part, Problem
from experiments.validation.oracles import box, rooms
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation.backends import rfgenesis
from radartwin.simulation.backends.backend import backend
from radartwin.simulation.backends.mitsuba import MitsubaBackend
from radartwin.simulation.backends.sionna import RAYS, SionnaBackend
from radartwin.simulation.backends.sionna_scene import quiet
from radartwin.simulation.curved import tube_grid
from radartwin.simulation.paths import Paths

OURS, POINTS, RFGENESIS, SIONNA, IMAGES = "this tracer", "points", "RF-Genesis style", "Sionna RT", "image sources"
FAMILIES = (OURS, POINTS, RFGENESIS, SIONNA, IMAGES)
DEFAULT = "default"


@dataclass(frozen=True)
class Method:
    """A simulation method with one choice of settings."""

    family: str  # name of the method
    setting: str
    backend: str = "mitsuba"  # name of a simulator of radartwin; "" selects the exact image sources of a box (`ExactImages`)
    settings: tuple[tuple[str, Any], ...] = ()
    elements: str = "exact"  # as in `simulate`
    published: bool = False  # RF-Genesis's published signal generator computes the samples

    @property
    def name(self) -> str:
        return f"{self.family}, {self.setting}"

    @property
    def simulator(self) -> Any:
        return ExactImages() if not self.backend else backend(self.backend, **dict(self.settings))

    def iq(self, part: Part, frames: int, radar: Radar, aside_m: float = 0.0) -> np.ndarray:
        """Simulate the first `frames` frames of a recording and return their samples. `aside_m` shifts the radar in metres."""
        with quiet():
            return part.iq(frames, radar, self.simulator, self.elements, aside_m)


def tracer(setting: str, elements: str = "exact", **settings: Any) -> Method:
    """Return RadarTwin's tracer with the given settings, as a method whose name is `setting`."""
    return Method(OURS, setting, "mitsuba", tuple(settings.items()), elements)


def of_problem(problem: Problem, full: bool) -> list[Method]:
    """Return the methods that run on a test problem, RadarTwin's default first; if `full`, with all their settings."""
    images = [Method(IMAGES, "all of four bounces", "")] if problem.name == "empty room" else []
    return [tracer(DEFAULT), *(_room(problem, full) if problem.room else _targets(full)), *_peers(full), *images]


def _targets(full: bool) -> list[Method]:
    densities = (0.25, 4.0, 0.06, 16.0) if full else (0.25, 4.0)
    mine = [tracer(f"{n:g} tubes per square wavelength", rays_per_wavelength2=n) for n in densities]
    return [*mine, tracer("1 bounce", max_bounces=1), *([tracer("planar elements", "planar")] if full else [])]


def _room(problem: Problem, full: bool) -> list[Method]:
    mine = [tracer(f"{n} bounce{'s' * (n > 1)}", max_bounces=n) for n in ((1, 2, 3) if full else (2,))]
    if problem.name == "empty room":
        rays = (100_000, 300_000, 1_200_000, 2_900_000) if full else (300_000,)
        return mine + [tracer(f"tubes, {n / 1e6:g} million", room="tubes", rays=n) for n in rays]
    mine.append(tracer("planar elements", "planar"))
    mine.append(tracer("1 diffraction", diffractions=1))
    if full:
        mine += [*(tracer(f"pruned at {share:g}", prune=share) for share in (3e-4, 3e-3, 0.01, 0.03))]
        mine.append(tracer("1 diffraction, pruned at 0.003", diffractions=1, prune=3e-3))
    if problem.resting:
        densities = (0.25, 4.0) if full else (0.25,)
        mine += [tracer(f"{n:g} tubes per square wavelength", rays_per_wavelength2=n) for n in densities]
        mine.append(tracer("object and room uncoupled", coupling=False))
    if full:
        mine.append(tracer("room by tubes, by the width rule", room="tubes"))
    return mine


def _peers(full: bool) -> list[Method]:
    peers = [Method(POINTS, "far-field table", "points")]
    if full:
        peers.append(Method(POINTS, "sphere", "points", (("cross_section", "sphere"),)))
    for version in ("shipped", "corrected"):
        for grid in (128, 512) if full else (128,):
            peers.append(Method(RFGENESIS, f"{version}, {grid} x {grid}", "rfgenesis", (("version", version), ("grid", grid))))
    peers.append(Method(RFGENESIS, "as published", "rfgenesis", (("version", "shipped"), ("grid", 128)), published=True))
    peers.append(Method(SIONNA, "3 cm apart", "sionna", (("separation_m", 0.03),)))  # Sionna RT finds the most paths at this separation
    if full:
        peers.append(Method(SIONNA, "in one place", "sionna"))
    return peers


@dataclass(frozen=True)
class ExactImages:
    """A simulator that returns the exact image sources of the empty office, whatever the scene."""

    bounces: int = 4
    name = "images"

    @property
    def settings(self) -> Any:
        return self

    def paths(self, scene: Any, radar: Radar, sensor_poses: np.ndarray, motion: Any = None, track: Any = None) -> list[Paths]:
        """Return the paths between isotropic antennas. The synthesis of samples applies the radar's antenna pattern later."""
        reflection, frequency = rooms.wall_reflection("concrete"), radar.center_frequency_hz
        rows: list[tuple[int, complex, float, np.ndarray, np.ndarray, int]] = []
        for number, pose in enumerate(sensor_poses):
            sensor = pose[:3, 3]
            listed = zip(
                box.images(np.array(OFFICE), sensor, self.bounces),
                box.image_paths(np.array(OFFICE), sensor, pose[:3, 2], reflection, self.bounces),
                strict=True,
            )
            for (index, place, _), (gain, length, order) in listed:
                out = (place - sensor) / length
                level = gain * SPEED_OF_LIGHT / (4 * np.pi * frequency * length)
                rows.append((number, level, length, out @ pose[:3, :3], (-out * (-1.0) ** index) @ pose[:3, :3], order))
        pose, level, length, departure, arrival, order = (np.array(column) for column in zip(*rows, strict=True))
        ends = length / 2, length / 2
        return [Paths(len(sensor_poses), pose, order, level[:, None], np.array([frequency]), *ends, departure, arrival, 0 * length)]


@contextmanager
def counted_rays() -> Iterator[list[int]]:
    """Yield a list that records the number of ray tubes of every ray grid that is launched inside the `with` block."""
    counts: list[int] = []

    def counted(launch: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            made = launch(*arguments, **options)
            grids = [made] if isinstance(made, tube_grid.TubeGrid) else list(made or [])
            counts.extend(grid.per_pose * grid.poses for grid in grids)
            return made if isinstance(made, tube_grid.TubeGrid) or made is None else grids

        return call

    with mock.patch.multiple(tube_grid, towards=counted(tube_grid.towards), all_around=counted(tube_grid.all_around)):
        yield counts


def rays_of(simulator: Any) -> int | None:
    """Return the rays per frame in the settings of another simulator; None for RadarTwin's tracer, whose rays `counted_rays` counts."""
    if isinstance(simulator, rfgenesis.RFGenesisBackend):
        return simulator.settings.grid**2
    if isinstance(simulator, SionnaBackend):
        return simulator.settings.rays or RAYS
    return None if isinstance(simulator, MitsubaBackend) else 0
