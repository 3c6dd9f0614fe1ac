"""Errors of the simulator RF-Genesis: levels, range law, convergence, and measured target speed of each version of simulator=rfgenesis.

Each row has the value expected from physics, the result of the published RF-Genesis program for the same scene (column paper; versions
`shipped` and `columns`), and the result of RadarTwin's re-implementation. A claim holds if the published RF-Genesis program and
RadarTwin's re-implementation agree within a tolerance. Rows of the version `corrected` show what RF-Genesis returns after its errors are
corrected; the original RF-Genesis program has no value for these rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import trimesh
from scipy.special import fresnel

from radartwin.config.config import Config
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.runs.experiment import Result
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends import rfgenesis
from radartwin.simulation.backends.backend import Backend, backend
from radartwin.simulation.simulate import simulate
from radartwin.store.products import Store

SIZE_M = 0.1  # leg of the trihedral, radius of the sphere, and edge of the plate in metres
# cross-section of the trihedral, 4 pi a^4 / (3 lambda^2), over that of the sphere, pi r^2
CLOSED_FORM_RATIO_DB = 10 * math.log10(4 / 3 * SIZE_M**2 / (SPEED_OF_LIGHT / 77e9) ** 2)
SAME_DB = 6.0  # tolerance; a target covers about five pixel rows, and one row more or less changes the level by decibels
SAME_EXPONENT = 1.0
CLAIM = "the re-implementation returns what the published program does"
PUBLISHED = {  # metric: (result of the published program, tolerance)
    "trihedral over sphere at 2 m (dB)": (-11.6, SAME_DB),
    "plate at 3 m, 128^2 rays (dB)": (-143.0, SAME_DB),
    "plate at 3 m, 1024^2 rays (dB)": (-105.0, SAME_DB),
    "power of the number of rays the level grows with": (2.0, 0.2),
    "speed read of 0.2 m/s": (0.743, 0.005),
}
EXPONENTS = {"shipped": (3.0, 5.0), "columns": (9.0, 13.0)}  # smallest and largest exponent of the published range law over three targets
SPEED_MPS = 0.2
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


def plate_db(distance_m: float, frequency_hz: float = 78.72e9) -> float:
    """Return the level in dB of a plate that faces the radar, by physical optics.

    The level is the far-field value A^2/(4 pi R^2)^2 times the Fresnel integral over the square aperture.
    """
    wavelength = SPEED_OF_LIGHT / frequency_hz
    edge = SIZE_M * math.sqrt(1 / (wavelength * distance_m))  # k x^2/R = (pi/2) u^2 with u = 2 x/sqrt(lambda R)
    sine, cosine = fresnel(edge)
    aperture = abs(complex(cosine, sine) / edge) ** 2
    return 20 * math.log10(SIZE_M**2 / (4 * math.pi * distance_m**2) * aperture)


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


def speed_read_mps(simulator: Backend, radar: Radar, speed_mps: float = SPEED_MPS) -> float:
    """Return the Doppler speed in m/s of a receding plate, computed from a transmitter's chirps and the wavelength of 77 GHz."""
    poses = np.array([trajectory.pose([2 + speed_mps * frame / radar.frame_rate_hz, 0.0, 0.0]) for frame in range(3)])
    scene = Scene([Surface(TARGETS["plate"](), "metal", "plate")])
    iq = simulate(scene, radar, np.eye(4)[None], motion={"plate": poses}, simulator=simulator).iq[1, :, 0, 0]
    spectrum = np.fft.fft(iq * np.hanning(radar.num_samples), axis=1)
    chirps = spectrum[:, np.abs(spectrum).sum(axis=0).argmax()]
    doppler = np.abs(np.fft.fft(chirps * np.hanning(len(chirps)), 64 * len(chirps)))
    cycles = float(np.fft.fftfreq(len(doppler))[doppler.argmax()])
    return cycles * rfgenesis.LOSS_WAVELENGTH_M / 2 / radar.loop_interval_s


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the table. The results of single table rows are not stored, because computing each row takes a fraction of a second."""
    rows: list[dict] = []
    metrics: dict[str, float] = {}

    def add(metric: str, expected: str, values: Sequence[float] | np.ndarray, paper: str = "", agrees: bool | None = None) -> None:
        low, value, high = float(np.min(values)), float(np.median(values)), float(np.max(values))
        if version == "shipped" and metric in PUBLISHED:
            theirs, tolerance = PUBLISHED[metric]
            paper, agrees = f"{theirs:g}", low - tolerance <= theirs <= high + tolerance
        rows.append({
            "case": version, "expected": expected, "claim": "" if agrees is None else CLAIM, "metric": metric, "run_keys": "",
            "paper": paper, "value": value, "low": low, "high": high, "n": len(values), "domain": "simulation",
            "verdict": "untestable" if agrees is None else "holds" if agrees else "fails",
        })  # fmt: skip

    for version in progress.over(rfgenesis.VERSIONS, "versions of the naive tracer"):
        simulator = backend("rfgenesis", version=version)
        ratio = trihedral_over_sphere_db(simulator, np.linspace(1.9, 2.1, 11))
        add("trihedral over sphere at 2 m (dB)", f"{CLOSED_FORM_RATIO_DB:+.1f}", ratio)
        found = sorted(range_exponents(simulator, np.geomspace(1, 4, 9)).values())
        metric = "exponent n of the range law R^-n, of three targets"
        if version in EXPONENTS:
            least, most = EXPONENTS[version]
            add(metric, "4", found, f"{least:g} to {most:g}", least - SAME_EXPONENT <= found[0] and found[-1] <= most + SAME_EXPONENT)
        else:
            add(metric, "4", found)
        few, many = plate_levels_db(version, (128, 1024))
        for name, level in (("128", few), ("1024", many)):
            add(f"plate at 3 m, {name}^2 rays (dB)", f"{plate_db(3.0):.1f}", [level])
        growth = (many - few) / (10 * math.log10(64))
        add("power of the number of rays the level grows with", "0", [growth])
        speed = speed_read_mps(simulator, published_radar())
        add("speed read of 0.2 m/s", "0.2", [speed])
        metrics |= {
            f"trihedral_over_sphere_db_{version}": float(np.median(ratio)),
            f"range_exponent_least_{version}": found[0],
            f"range_exponent_most_{version}": found[-1],
            f"ray_growth_{version}": growth,
            f"speed_read_{version}": speed,
        }
    return Result("baselines", rows, {}, metrics)
