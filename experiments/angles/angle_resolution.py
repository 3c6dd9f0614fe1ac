"""Resolution of two targets at one range by Bartlett, Capon and MUSIC: probability over noise draws, and two traced spheres.

Each draw has K = 2 M snapshots of a uniform line of M antennas, half a wavelength apart. Both targets have equal power and independent
random phases; the signal-to-noise ratio is that of one target on one antenna in one snapshot. Separations are in Rayleigh widths lambda /
(M d) of sin(azimuth). Both targets are resolved if the two highest maxima are on different sides of the middle, each closer than half of
the separation to its target. MUSIC knows the number of targets. The echoes of the spheres at rest are coherent.
"""

from typing import Any

import numpy as np

from experiments import statistics
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure, legend_above
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.statistics import Estimate
from experiments.verdicts import BELOW, Claim, RowList
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.angles import METHODS, AngleMethod, azimuth_spectrum, spectrum
from radartwin.radar.cell_directions import maxima, standard_method
from radartwin.radar.chirp import Radar
from radartwin.radar.covariance import covariance
from radartwin.radar.detection import detect
from radartwin.radar.processing import range_fft, response
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.simulate import simulate

TABLE = Table(
    name="angle_resolution",
    title="Resolution of two targets in azimuth",
    caption="Probability that Bartlett, Capon and MUSIC resolve two uncorrelated targets of equal power in twice as many snapshots as "
    "antennas, over noise draws, and the separation at which the probability is one half. Separations are in Rayleigh widths. The "
    "signal-to-noise ratio is that of one target on one antenna in one snapshot. n counts draws. The last rows give the largest azimuth "
    "error of two traced metal spheres that are 0.7 Rayleigh widths apart.",
)

RADAR = Radar.iwr1843(element="isotropic")
SPACING_M = SPEED_OF_LIGHT / 77e9 / 2
SNR_DB = (0.0, 10.0, 20.0)
SEPARATIONS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5)
WINDOW, STEP = 2.0, 0.02  # half width and step of the azimuth search, in Rayleigh widths; the step is a fifth of the smallest separation
PROBABILITY, HALF, ERROR = "probability of resolution", "separation resolved in half of the draws (Rayleigh widths)", "azimuth error (deg)"
SPHERES, OFFSET_M, FRAMES = 0.7, 0.24e-3, 10  # separation (Rayleigh widths), difference of range (45 degrees of phase), frames of noise


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the draws and the traced spheres: 8 antennas, and with profile=paper also 86 antennas at one signal-to-noise ratio."""
    full = config.profile.name != "quick"
    rows, curves = RowList(config), {}
    cases = [(8, snr_db) for snr_db in SNR_DB] + ([(86, SNR_DB[1])] if full else [])
    for antennas, snr_db in progress.over(cases, "signal-to-noise ratios"):
        probabilities = {m: [] for m in METHODS}
        for separation in SEPARATIONS:
            draws = (400 if full else 100) if antennas == 8 else 50
            for method, count in resolved(antennas, snr_db, separation, draws, config.seed).items():
                probabilities[method].append(statistics.share(count, draws))
        bartlett = half_resolved(probabilities["bartlett"], config).value
        for method, estimates in probabilities.items():
            case = {"antennas": antennas, "snapshots": 2 * antennas, "snr_db": snr_db, "method": method}
            for separation, estimate in zip(SEPARATIONS, estimates, strict=True):
                rows.add({**case, "separation": separation}, PROBABILITY, estimate, [])
            claim = Claim("resolves closer targets than Bartlett does", bound=bartlett, direction=BELOW, limit=True)
            claim = Claim() if method == "bartlett" else claim
            rows.add({**case, "separation": None}, HALF, half_resolved(estimates, config), [], claim)
            curves[antennas, snr_db, method] = estimates
    recording, true_rad = spheres(config.seed)
    for method in METHODS:
        peaks_rad = detect(recording.iq, RADAR, angle=method).azimuth_rad
        worst_rad = np.abs(peaks_rad[:, None] - true_rad).min(axis=0).max()  # distance of the worse sphere from the nearest peak
        case = {"antennas": 8, "snapshots": FRAMES, "snr_db": None, "method": method, "separation": SPHERES}
        rows.add(case, ERROR, statistics.exact(float(np.degrees(worst_rad)), 1), [])
    for row in rows:
        row["domain"] = "simulation" if row["metric"] == ERROR else "noise draws"
    metrics = {f"half_{r['antennas']}_{r['snr_db']:g}_{r['method']}": r["value"] for r in rows if r["metric"] == HALF}
    return Result(TABLE.name, rows, {TABLE.name: lambda: drawing(curves, recording, true_rad)}, metrics)


def resolved(antennas: int, snr_db: float, separation: float, draws: int, seed: int) -> dict[str, int]:
    """Return for each method the number of draws in which it resolves two targets `separation` Rayleigh widths apart."""
    positions_m = np.column_stack([np.zeros(antennas), SPACING_M * np.arange(antennas), np.zeros(antennas)])
    frequency_hz, snapshots = RADAR.center_frequency_hz, 2 * antennas
    rayleigh = SPEED_OF_LIGHT / frequency_hz / (antennas * SPACING_M)
    rng = np.random.default_rng([seed, antennas, round(10 * snr_db), round(1000 * separation)])
    waves = response(positions_m, _horizontal(rayleigh * separation * np.array([-0.5, 0.5])), frequency_hz)
    signals = 10 ** (snr_db / 20) * np.exp(2j * np.pi * rng.random((draws, snapshots, 2))) @ waves.T
    noise = rng.standard_normal((draws, snapshots, antennas)) + 1j * rng.standard_normal((draws, snapshots, antennas))
    matrices = covariance(signals + noise / np.sqrt(2))
    offset, targets, out = np.arange(-WINDOW, WINDOW + STEP / 2, STEP), separation * np.array([-0.5, 0.5]), {}
    for method in METHODS:
        levels = spectrum(matrices, positions_m, frequency_hz, AngleMethod(method, sources=2))(_horizontal(rayleigh * offset))
        highest = [np.sort(offset[maxima(level)[:2]]) for level in levels]
        out[method] = sum(len(two) == 2 and bool((np.abs(two - targets) < separation / 2).all()) for two in highest)
    return out


def _horizontal(sine: np.ndarray) -> np.ndarray:
    return np.column_stack([np.sqrt(1 - sine**2), sine, np.zeros_like(sine)])


def half_resolved(estimates: list[Estimate], config: Config) -> Estimate:
    """Return the separation at which the probability reaches one half (NaN if it does not), with a parametric bootstrap over draws."""
    draws = estimates[0].n
    rng = np.random.default_rng([config.seed, draws])
    drawn = rng.binomial(draws, [estimate.value for estimate in estimates], size=(config.profile.resamples, len(estimates))) / draws
    return statistics.resampled(
        _crossing([estimate.value for estimate in estimates]), [_crossing(probability) for probability in drawn], draws
    )


def _crossing(probability: Any) -> float:
    above = np.flatnonzero(np.asarray(probability) >= 0.5)
    if not len(above):
        return float("nan")
    first = int(above[0])
    if first == 0:
        return SEPARATIONS[0]
    low, high = probability[first - 1], probability[first]
    share = (0.5 - low) / (high - low)
    return float(SEPARATIONS[first - 1] + share * (SEPARATIONS[first] - SEPARATIONS[first - 1]))


def spheres(seed: int) -> tuple[Any, np.ndarray]:
    """Simulate two metal spheres at 2 m with the receiver's noise; return the recording and the azimuths (2,) of the spheres in radians."""
    rayleigh = SPEED_OF_LIGHT / RADAR.center_frequency_hz / (8 * SPACING_M)
    azimuth_rad = np.arcsin(SPHERES * rayleigh * np.array([-0.5, 0.5]))
    ranges = 2.03 + np.array([0.0, OFFSET_M])
    places = np.stack([ranges * np.cos(azimuth_rad), ranges * np.sin(azimuth_rad), np.zeros(2)], axis=1)
    motion = {f"sphere{n}": np.repeat(trajectory.pose(place)[None], FRAMES, axis=0) for n, place in enumerate(places)}
    scene = Scene([Surface(objects.sphere(0.03), "metal", name) for name in motion])
    return simulate(scene, RADAR, np.eye(4), motion=motion, noise=True, seed=seed), azimuth_rad


def drawing(curves: dict, recording: Any, true_rad: np.ndarray) -> Figure:
    """Draw probability against separation for each number of antennas, and the spectra of the traced spheres."""
    counts = sorted({antennas for antennas, _, _ in curves})
    drawn, axes = figure(1, len(counts) + 1, width_in=PAGE_WIDTH_IN, height_in=2.6)
    for antennas, panel in zip(counts, axes, strict=False):
        for number, method in enumerate(METHODS):
            for snr_db, line in zip(SNR_DB, (":", "--", "-"), strict=False):
                if (estimates := curves.get((antennas, snr_db, method))) is None:
                    continue
                panel.plot(
                    SEPARATIONS, [estimate.value for estimate in estimates], line, color=PALETTE[number], label=f"{method}, {snr_db:g} dB"
                )
                panel.fill_between(
                    SEPARATIONS, [e.low for e in estimates], [e.high for e in estimates], color=PALETTE[number], alpha=0.12, lw=0
                )
        panel.set(title=f"{antennas} antennas", xlabel="separation (Rayleigh widths)", ylabel=PROBABILITY, ylim=(-0.02, 1.02))
    legend_above(drawn, axes[0], 5)
    profiles, range_m = range_fft(recording.iq, RADAR)
    snapshots = profiles[..., np.argmin(np.abs(range_m - 2.0))].mean(axis=1)  # mean over chirps, because the spheres are at rest
    grid = np.radians(np.arange(-30, 30.1, 0.1))
    for number, method in enumerate(METHODS):
        level = azimuth_spectrum(snapshots, RADAR, grid, standard_method(method, RADAR.virtual_positions))
        axes[-1].plot(np.degrees(grid), 10 * np.log10(level / level.max()), color=PALETTE[number], label=method)
    for azimuth in np.degrees(true_rad):
        axes[-1].axvline(azimuth, color="0.6", lw=0.8, ls=":")
    axes[-1].set(title="two traced spheres", xlabel="azimuth (deg), left positive", ylabel="spectrum (dB)", ylim=(-40, 2), xlim=(30, -30))
    return drawn
