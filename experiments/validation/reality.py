"""Compare RadarTwin with real measurements of others: every comparison whose data may be used, with source, licence and n.

The measured echo levels of two dihedrals are part of this repository (experiments/validation/measured). The captures and the scan lie in
../shared/data beside the checkout, because they are too large for the repository. A comparison whose data are absent gives one row without
a verdict. The limits are:

- dihedrals: the interval of near-field physical optics for the same aspects, with which that of the simulator must overlap;
- captures: one range bin, and one Doppler bin, around the values that the descriptions of the captures give;
- scan: the limits of the table `scan` for scans of procedural rooms.
"""

import csv
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from experiments import verdicts
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.scans import scan
from experiments.statistics import Estimate, exact, resampled
from experiments.validation.oracles.case import REFERENCE
from experiments.validation.oracles.nearfield import corner_quadrature
from experiments.validation.oracles.targets import corner_faces
from radartwin.builders.radar import named_radar
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.radar.process_capture import process_capture
from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.frames.layouts import load_frames
from radartwin.reconstruct.fusion.fusion import fuse
from radartwin.reconstruct.mesh_distance import Nearest, covered
from radartwin.reconstruct.scan_file import load_scan
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import look_at
from radartwin.simulation.rcs import rcs
from radartwin.simulation.simulate import simulate
from radartwin.store.digest import path_digest

TABLE = Table(
    name="reality",
    title="Comparison with real measurements",
    caption="Every comparison with measurements of real radars and scanners whose data may be used. The rows of the dihedrals compare the "
    "simulator with measured echo levels. The rows of the captures compare only the processing with the descriptions of the captures, "
    "because the scenes are not described well enough to simulate them. The rows of the scan compare the reconstruction with the "
    "mesh of the vendor's app. The value and its interval must not exceed the limit; the interval of a dihedral must overlap with that "
    "of physical optics. Three codes give the larger dihedral a similar offset: the simulation by the authors of the "
    "measurements +5.3 dB (HUSSAR, medians of the central 40 %), physical optics and this simulator about +4 dB. So it most likely lies "
    "in the rig. Intervals are bootstraps over blocks of neighbouring aspects. The mean level is free in each row of the dihedrals, so "
    "that no absolute level is compared. n counts the compared aspects, peaks or camera frames. Rows without a limit are controls.",
)
DOMAIN = "reality"
MEASURED = Path(__file__).with_name("measured") / "dihedral_77ghz.csv"
DATA = REFERENCE.parent / "data"  # beside the checkout
ROOM, WALK, CHAIR = (DATA / path for path in ("radar/iwr6843_static_room", "radar/openradar_77ghz_frame", "scans/arkit_lidar_chair_scan"))

SIDES_M = (0.05, 0.10)
DISTANCE_M, HEIGHT_M = 0.896, 0.067  # distance of the radar from the corner edge; height of the radar above the lower end of this edge
BINS = slice(17, 24)  # the level is the strongest of these range bins
CENTRE_HZ = 78.5e9
BLOCK = 8  # aspects in a bootstrap block; errors of neighbouring aspects have a correlation of 0.65 to 0.78
METHODS = OURS, OPTICS, FAR = "simulator", "physical optics", "far field"

# (peak ranges in m, strongest first, as the README of each capture lists them)
ROOM_PEAKS_M, ROOM_DOPPLER_BIN_MPS = (1.551, 1.052, 1.718, 1.370, 8.473, 2.257), 0.07
LEFT_OUT = "without the described peak at 6.23 m, in the last range bin, where the detector expects leakage of zero range"
WALK_PEAKS_M, WALKER_M = (5.208, 2.93, 4.39), 2.955
FRAME_PEAKS_M = (5.205, 1.981, 4.054)
WALKER_MPS = (0.56, -0.81)  # fastest receding and fastest approaching speed of the walker
WALK_DOPPLER_BIN_MPS = 0.081
SPACING_M = 0.04  # spacing of the points whose distance to a mesh is measured
SCALE_LIMIT = 0.01
NEAR_M = 0.05  # points farther from the other mesh do not count in the fit of the scale
ROUNDS = 20  # steps of this fit


@dataclass(frozen=True)
class Measurement:
    """A set of real measurements: its name in the table, its source and licence, and the folder or file that holds it."""

    name: str
    source: str
    licence: str
    path: Path


DIHEDRALS = Measurement("dihedrals", "github cg-saarland/hussar, a75bd59", "none stated; only levels are kept", MEASURED)
CAPTURE_ROOM = Measurement("static room, 60 GHz", "github shelta-zhao/mmwave-eyes, bf8d8db", "MIT", ROOM)
CAPTURE_WALK = Measurement("walker, 77 GHz", "github PreSenseRadar/OpenRadar, 65bcd62", "Apache-2.0", WALK)
SCAN = Measurement("chair scan", "github laanlabs/3dScannerApp_samples, 52afbc2", "MIT", CHAIR)


@dataclass(frozen=True)
class Compared:
    """One comparison: the compared quantity with its unit, the method, the estimate, the claim, and its limit (None for a control). The
    whole interval must not exceed the limit; if `overlaps` is true, the limit is the upper end of another interval, with which it must
    overlap.
    """

    quantity: str
    method: str
    estimate: Estimate
    claim: str = ""
    limit: float | None = None
    note: str = ""
    overlaps: bool = False


def identity() -> dict[str, Any]:
    """Return the digests of the real data, so that the key of a stored result changes if the data beside the checkout change."""
    return {"measurements": {m.name: path_digest(m.path) if m.path.exists() else "" for m, _ in COMPARISONS}}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Make every comparison whose data are present."""
    rows = [line for m, compare in progress.over(COMPARISONS, "measurements") for line in rows_of(m, compare, config)]
    figures = {"reality_dihedrals": _dihedral_figure}
    metrics = {f"{verdict}_rows": float(sum(row["verdict"] == verdict for row in rows)) for verdict in (verdicts.HOLDS, verdicts.MISSES)}
    return Result(TABLE.name, rows, figures, metrics)


def rows_of(measurement: Measurement, compare: Callable[[Config], Iterator[Compared]], config: Config) -> list[dict[str, Any]]:
    """Return the rows of one set of measurements, or one row without a verdict if the data are absent."""
    if not measurement.path.exists():
        reason = f"not available: {measurement.path.parent.name}/{measurement.path.name} is not in ../shared/data"
        return [_row(measurement, Compared("", "", exact(np.nan, 0), note=reason))]
    return [_row(measurement, compared) for compared in compare(config)]


def _row(measurement: Measurement, compared: Compared) -> dict[str, Any]:
    estimate, limit = compared.estimate, compared.limit
    end = estimate.low if compared.overlaps else estimate.high
    holds = None if limit is None else (end if np.isfinite(end) else estimate.value) <= limit
    return {
        "measurement": measurement.name, "method": compared.method, "claim": compared.claim,
        "limit": f"low <= {limit:.3g}" if compared.overlaps and limit else limit, "note": compared.note,
        "source": measurement.source, "licence": measurement.licence, **verdicts.score_columns(compared.quantity, estimate, DOMAIN, holds),
    }  # fmt: skip


@cache
def measured_levels() -> tuple[np.ndarray, Mapping[float, np.ndarray]]:
    """Return the aspects (n,) in degrees, and the measured levels (n,) in dB of each dihedral by the side of its faces in metres."""
    rows = list(csv.DictReader(MEASURED.read_text(encoding="utf-8").splitlines()))
    aspects = np.array([float(row["aspect_deg"]) for row in rows])
    return aspects, {side: np.array([float(row[f"level_{100 * side:.0f}cm_db"]) for row in rows]) for side in SIDES_M}


@cache
def dihedral_levels(side_m: float, method: str) -> np.ndarray:
    """Return the levels (n,) in dB of a dihedral with faces of `side_m` at the measured aspects, with an unknown constant offset.

    The method "simulator" gives the strongest of the range bins BINS of a simulated recording with a Hann window, "physical optics" the
    near-field quadrature of all reflections at CENTRE_HZ, and "far field" the radar cross-section in the horizontal plane.
    """
    angles, height = np.radians(measured_levels()[0]), HEIGHT_M - side_m / 2
    mesh, over = objects.dihedral(side_m, side_m), np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    places = DISTANCE_M * over + [0, 0, height]
    if method == FAR:
        return 10 * np.log10([rcs(mesh, direction, frequency=CENTRE_HZ) for direction in over])
    if method == OPTICS:
        faces = corner_faces(mesh)
        return 20 * np.log10([abs(corner_quadrature(faces, place, SPEED_OF_LIGHT / CENTRE_HZ)) for place in places])
    radar = Radar(
        name="awr1243", start_frequency_hz=77e9, slope_hz_per_s=60e12, sample_rate_hz=5e6, num_samples=256, num_chirps=1,
        tx_positions_m=((0.0, 0.0, 0.0),), rx_positions_m=((0.0, 0.0, 0.0),), chirp_interval=1e-4, frame_rate_hz=10.0,
    )  # fmt: skip
    scene, poses = Scene([Surface(mesh, "metal", "dihedral")]), [look_at(place, np.array([0.0, 0.0, height])) for place in places]
    iq = np.stack([simulate(scene, radar, pose[None]).iq[0, 0, 0, 0] for pose in poses])
    return 20 * np.log10(np.abs(np.fft.fft(iq * np.hanning(radar.num_samples), axis=1))[:, BINS].max(axis=1))


def compare_dihedrals(config: Config) -> Iterator[Compared]:
    """Yield the standard deviation of simulated minus measured level for each size and method, and over both sizes."""
    _, measured = measured_levels()
    errors = {method: np.array([dihedral_levels(side, method) - measured[side] for side in SIDES_M]) for method in METHODS}
    blocks = _blocks(len(measured[SIDES_M[0]]), config.profile.resamples, np.random.default_rng(config.seed))
    parts = {f"{100 * side:.0f} cm": slice(k, k + 1) for k, side in enumerate(SIDES_M)} | {"both sizes, one offset": slice(None)}
    for method in METHODS:
        for name, part in parts.items():
            estimate, optics = (
                resampled(float(of.std()), np.swapaxes(of[:, blocks], 0, 1).reshape(len(blocks), -1).std(axis=1), of.size)
                for of in (errors[method][part], errors[OPTICS][part])
            )
            limit = optics.high if method == OURS else None
            claim = "not farther from the measured levels than physical optics is" if limit else ""
            note = "" if limit else "whose interval is the limit" if method == OPTICS else "control without near field"
            yield Compared(f"{name}: std of level difference (dB)", method, estimate, claim, limit, note, overlaps=True)
        means = errors[method][:, blocks].mean(axis=2)
        estimate = resampled(float(np.diff(errors[method].mean(axis=1))[0]), np.diff(means, axis=0)[0], errors[method].shape[1])
        yield Compared("offset of 10 cm minus offset of 5 cm (dB)", method, estimate, note="mean of computed minus measured level")


def _blocks(count: int, resamples: int, rng: np.random.Generator) -> np.ndarray:
    """Return bootstrap samples (resamples, count) of blocks of neighbouring aspects, because these have similar errors."""
    starts = rng.integers(count, size=(resamples, -(-count // BLOCK)))
    return ((starts[..., None] + np.arange(BLOCK)) % count).reshape(resamples, -1)[:, :count]


def compare_room(config: Config) -> Iterator[Compared]:
    """Yield the range error of the peaks of a static room at 60 GHz, and the largest measured speed of a peak."""
    capture = ROOM / "iwr6843_frame_adc_data.bin"
    table = process_capture(capture)
    bin_m = Radar.from_file(ROOM / "iwr6843_mmwaveDevice.mmwave.json").range_resolution_m
    yield _peaks(table["range_m"].to_numpy(), ROOM_PEAKS_M, bin_m, "static echoes")
    speed = float(np.abs(table["doppler_mps"].to_numpy()).max())
    yield Compared("largest speed of a peak (m/s)", "processing", exact(speed, len(table)), "nothing moves", ROOM_DOPPLER_BIN_MPS)


def compare_walk(config: Config) -> Iterator[Compared]:
    """Yield the range errors of static echoes in two frames, and the errors of range and speed of a walking person."""
    radar = named_radar("openradar_77ghz")
    table = process_capture(WALK / "doppler_example_1.npy", radar=radar)
    bin_m = radar.range_resolution_m
    still = table["range_m"].to_numpy()[np.abs(table["doppler_mps"].to_numpy()) < WALK_DOPPLER_BIN_MPS]
    yield _peaks(still, WALK_PEAKS_M, bin_m, "static echoes, frame with Doppler", LEFT_OUT)
    single = process_capture(WALK / "simple_frame_1.npy", radar=radar)["range_m"].to_numpy()
    yield _peaks(single, FRAME_PEAKS_M, bin_m, "static echoes, frame of one channel", LEFT_OUT)
    moving = process_capture(WALK / "doppler_example_1.npy", radar=radar, static_removed=True)
    ranges, speeds = moving["range_m"].to_numpy(), moving["doppler_mps"].to_numpy()
    off = abs(float(ranges[0]) - WALKER_M)
    yield Compared("walker: range error (m)", "processing", exact(off, 1), "strongest moving echo at the described range", bin_m)
    body = speeds[np.abs(ranges - WALKER_M) < 2 * bin_m]
    for limb, speed, processed_mps in (("receding", WALKER_MPS[0], body.max()), ("approaching", WALKER_MPS[1], body.min())):
        claim = "radial speed of the description, within a Doppler bin"
        yield Compared(
            f"walker, {limb}: speed error (m/s)", "processing", exact(abs(float(processed_mps) - speed), 1), claim, WALK_DOPPLER_BIN_MPS
        )


def _peaks(ranges_m: np.ndarray, described_m: Sequence[float], bin_m: float, where: str, note: str = "") -> Compared:
    """Return the largest distance from a described peak to the nearest detected peak, with a note."""
    off = np.abs(np.array(described_m)[:, None] - ranges_m).min(axis=1)
    missed = ", ".join(f"{at:g}" for at, error_m in zip(described_m, off, strict=True) if error_m > bin_m)
    note = f"no peak within a range bin of {missed} m" if missed else note
    claim = "every described peak is found within a range bin"
    return Compared(f"{where}: largest range error (m)", "processing", exact(float(off.max()), len(off)), claim, bin_m, note)


def compare_scan(config: Config) -> Iterator[Compared]:
    """Yield distances and scale error between our mesh of the camera frames and the vendor's mesh, and from this mesh to our scene."""
    frames = load_frames(CHAIR)
    vendor, fused = load_scan(CHAIR / "export.obj", up="y")[0], fuse(frames)[0]
    distances = [_distances(fused, [vendor]), _distances(vendor, [fused])]
    count = len(frames)
    claim, limit, _ = scan.TARGETS["median_mm"]
    claim_95, limit_95, _ = scan.TARGETS["p95_mm"]
    chamfer = 1e3 * float(np.mean([d.mean() for d in distances]))
    yield Compared("Chamfer distance, mean of both directions (mm)", "frames to mesh", exact(chamfer, count))
    for name, part in (("ours to vendor's", distances[0]), ("vendor's to ours", distances[1])):
        yield Compared(f"{name}: median (mm)", "frames to mesh", exact(1e3 * float(np.median(part)), count), claim, limit)
        yield Compared(f"{name}: 95 % (mm)", "frames to mesh", exact(1e3 * float(np.quantile(part, 0.95)), count), claim_95, limit_95)
    scale = abs(float(np.sqrt(fitted_scale(fused, vendor) / fitted_scale(vendor, fused))) - 1)
    yield Compared("scale error (1)", "frames to mesh", exact(scale, count), "the scale of both meshes agrees within 1 %", SCALE_LIMIT)
    with tempfile.TemporaryDirectory() as folder:
        scene = reconstruct(CHAIR / "export.obj", folder, material="concrete")
    estimate = exact(1e3 * float(np.median(_distances(vendor, [surface.mesh for surface in scene]))), count)
    yield Compared("vendor's mesh to surfaces of the scene: median (mm)", "mesh to scene", estimate, claim, limit)


def _distances(mesh: trimesh.Trimesh, others: Sequence[trimesh.Trimesh]) -> np.ndarray:
    """Return the distances (N,) in metres from points spread on a mesh to the nearest of other meshes."""
    return Nearest(others)(covered(np.asarray(mesh.triangles), SPACING_M)[0])[0]


def fitted_scale(mesh: trimesh.Trimesh, other: trimesh.Trimesh) -> float:
    """Return the factor that scales a mesh to another, fitted with rotation and translation to point-to-plane distances. Noise makes it
    too small, as it does in the other direction, so that the square root of the ratio of both factors has no such error.
    """
    from scipy.spatial.transform import Rotation

    points, near, scale = covered(np.asarray(mesh.triangles), SPACING_M)[0], Nearest([other]), 1.0
    centre = points.mean(axis=0)
    for _ in range(ROUNDS):
        distance, face = near(points)
        kept = distance < NEAR_M
        normal, local = np.asarray(other.face_normals)[face[kept]], points[kept] - centre
        away = ((other.triangles[face[kept], 0] - points[kept]) * normal).sum(axis=1)
        system = np.column_stack([np.cross(local, normal), normal, (local * normal).sum(axis=1)])
        step = np.linalg.lstsq(system, away, rcond=None)[0]
        points = centre + (1 + step[6]) * Rotation.from_rotvec(step[:3]).apply(points - centre) + step[3:6]
        scale *= 1 + step[6]
    return float(scale)


COMPARISONS: tuple[tuple[Measurement, Callable[[Config], Iterator[Compared]]], ...] = (
    (DIHEDRALS, compare_dihedrals),
    (CAPTURE_WALK, compare_walk),
    (CAPTURE_ROOM, compare_room),
    (SCAN, compare_scan),
)


def _dihedral_figure() -> Figure:
    """Draw measured and computed levels of both dihedrals, each method with the one offset that fits both sizes best."""
    aspects, measured = measured_levels()
    drawing, axes = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6)
    for method, colour in zip(METHODS, PALETTE, strict=False):
        offset = np.mean([measured[side] - dihedral_levels(side, method) for side in SIDES_M])
        for panel, side in zip(axes, SIDES_M, strict=True):
            panel.plot(aspects, dihedral_levels(side, method) + offset, color=colour, lw=1, label=method)
    for panel, side in zip(axes, SIDES_M, strict=True):
        panel.plot(aspects, measured[side], "k.", ms=4, label="measured")
        panel.set(title=f"dihedral, {100 * side:.0f} cm, 0.9 m", xlabel="aspect (deg)", ylabel="level (dB)")
    axes[0].legend(loc="lower center")
    return drawing
