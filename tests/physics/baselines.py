"""Levels of targets for the tests of the baseline simulators, and the radar of the original RF-Genesis program."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import trimesh

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.backend import Backend, backend
from radartwin.simulation.simulate import simulate

SIZE_M = 0.1  # leg of the trihedral, radius of the sphere, and edge of the plate in metres
# cross-section of the trihedral, 4 pi a^4 / (3 lambda^2), over that of the sphere, pi r^2
CLOSED_FORM_RATIO_DB = 10 * math.log10(4 / 3 * SIZE_M**2 / (SPEED_OF_LIGHT / 77e9) ** 2)
TARGETS: dict[str, Callable[[], trimesh.Trimesh]] = {
    "trihedral": lambda: objects.trihedral(SIZE_M),
    "sphere": lambda: objects.sphere(SIZE_M),
    "plate": lambda: objects.plate(SIZE_M, SIZE_M),
}


def published_radar() -> Radar:
    """Return the radar in the configuration file TI1843_config.json of the original RF-Genesis program. The ADC of this radar starts 6 us
    after the start of the chirp.
    """
    half = SPEED_OF_LIGHT / 77e9 / 2
    slope = 60.012e12
    return Radar(
        name="rfgenesis", start_frequency_hz=77e9 + slope * 6e-6, slope_hz_per_s=slope, sample_rate_hz=4.4e6, num_samples=256,
        num_chirps=128, tx_positions_m=((0.0, 0.0, 0.0), (0.0, -4 * half, 0.0), (0.0, -2 * half, half)),
        rx_positions_m=tuple((0.0, n * half, 0.0) for n in (6, 5, 4, 3)), chirp_interval=72e-6, frame_rate_hz=10.0,
    )  # fmt: skip


def level_db(mesh: trimesh.Trimesh, distance_m: float, simulator: Backend) -> float:
    """Return the peak of the Hann-windowed range profile of a target on boresight, as received over transmitted power in dB."""
    radar = Radar.iwr1843(element="isotropic")
    facing = mesh.copy().apply_transform(np.diag([-1.0, -1.0, 1.0, 1.0]))
    motion = {"target": trajectory.pose([distance_m, 0.0, 0.0])[None]}
    iq = simulate(Scene([Surface(facing, "metal", "target")]), radar, np.eye(4)[None], motion=motion, simulator=simulator).iq
    window = np.hanning(radar.num_samples)
    profile = np.abs(np.fft.fft(iq[0, 0, 0, 0] * window, 8 * radar.num_samples)) / window.sum()
    return float(20 * np.log10(profile.max() + 1e-30))


def trihedral_over_sphere_db(simulator: Backend, distances_m: Iterable[float]) -> np.ndarray:
    """Return the ratio (n,) in dB of the trihedral's level to the sphere's level at each distance."""
    meshes = TARGETS["trihedral"](), TARGETS["sphere"]()
    return np.array([level_db(meshes[0], d, simulator) - level_db(meshes[1], d, simulator) for d in distances_m])


def range_exponents(simulator: Backend, distances_m: Sequence[float] | np.ndarray) -> dict[str, float]:
    """Return for each target the exponent n of a power law R^-n that is fitted to the levels at the given distances R."""
    decades = 10 * np.log10(distances_m)
    return {
        name: -float(np.polyfit(decades, [level_db(make(), d, simulator) for d in distances_m], 1)[0]) for name, make in TARGETS.items()
    }


def plate_levels_db(version: str, grids: Sequence[int]) -> list[float]:
    """Return the level in dB of the plate at 3 m for each number of pixels per side in `grids`."""
    return [level_db(TARGETS["plate"](), 3.0, backend("rfgenesis", version=version, grid=grid)) for grid in grids]
