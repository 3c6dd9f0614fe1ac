"""Compare the specular paths of RadarTwin's tracer with Sionna RT and with exact image sources, path by path, in procedural rooms.

The references treat every wall as an infinite mirror, so levels are judged only for paths with a clear first Fresnel zone. The image
sources are those of the room's six planes; paths into a corner, one for each order of its walls, are added before the comparison. Sionna RT
from a point back to the same point ("co-located") misses corners, whose mirror points lie on edges; with the receiver APART_M aside
("apart") it finds one order of walls, and the length is computed again for a single point. The tolerances of `path_match` are wider than
the errors of the methods and narrower than the differences between paths. Paths over small or curved surfaces, which RadarTwin traces by
ray tubes, are counted separately. Only paths within DYNAMIC_DB of the strongest count.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments import statistics, verdicts
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.validation.oracles.rooms import rotation
from experiments.validation.oracles.shells import Room
from experiments.validation.path_match import PathSet, partners, together
from radartwin.radar.chirp import Radar
from radartwin.runs import workers
from radartwin.scene import rooms
from radartwin.scene.scene import Scene
from radartwin.simulation import geometry, reflection_table
from radartwin.simulation.backends import sionna_scene
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.backends.sionna import SionnaBackend, SionnaSettings
from radartwin.simulation.backends.sionna_scene import quiet
from radartwin.simulation.backends.static_scene import small_faces
from radartwin.simulation.paths import Paths

TABLE = Table(
    name="backend_crosscheck",
    title="The same paths by three methods",
    caption="Specular paths of up to four bounces in the procedural rooms, down to 40 dB below the strongest path. Three methods are "
    "compared with this tracer's mirror paths: image sources of the room's six planes, Sionna RT with transmitter and receiver "
    "at one point, and Sionna RT with the receiver 3 cm aside. At one point Sionna RT misses the echoes of corners; with the "
    "receiver aside it finds one of the sequences in which a path can hit the walls of a corner. Paths are matched by length and by "
    "both directions. Levels are judged where the first Fresnel zone is clear, because an infinite mirror is wrong where an edge "
    "cuts the zone. n counts paths. Intervals are bootstraps over paths.",
)

ROOMS, DETAILS = ("lab", "atrium", "squash_court"), ("shell", "furnished")
REFERENCES = ("image sources", "Sionna, co-located", "Sionna, apart")
BOUNCES, DYNAMIC_DB = 4, 40.0
APART_M = 0.03
RADAR = Radar.iwr1843(element="isotropic")
SHARE, DELAY_MM, LEVEL_DB = 0.95, 0.1, 0.5  # limits of the claims; 0.1 mm is a fortieth of a wavelength
METRICS = ("matched share", "level error (dB)", "length error (mm)")
CLAIMS = {
    METRICS[0]: f"at least {SHARE:g} of the reference's paths are ours too",
    METRICS[2]: f"lengths agree to {DELAY_MM:g} mm in the mean",
    METRICS[1]: f"levels of clear paths agree to {LEVEL_DB:g} dB in the mean",
}


@dataclass(frozen=True)
class Compared:
    """The paths of one reference against ours at one position of the radar; only paths within DYNAMIC_DB of the strongest count."""

    matched: np.ndarray  # (N,) whether each strong path of the reference has a partner among RadarTwin's paths
    length_mm: np.ndarray  # (M,) length errors of the matched paths
    level_db: np.ndarray  # level errors of the matched paths with a clear first Fresnel zone
    cut_level_db: np.ndarray  # level errors of the matched paths without a clear first Fresnel zone
    simulated_matched: np.ndarray  # whether each of RadarTwin's strong paths has a partner in the reference
    small: int  # number of the reference's paths that reflect at small surfaces


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compare the paths at one radar position per room (profile=quick) or at `profile.repeats` positions."""
    places = 1 if config.profile.name == "quick" else config.profile.repeats
    compared: dict[tuple[str, str, str], list[Compared]] = {}
    by_room: dict[str, dict[str, PathSet]] = {}
    cases = [(room, detail, place, config.seed) for room in ROOMS for detail in DETAILS for place in range(places)]
    with progress.task("rooms", len(cases)) as done:
        paths = workers.each(_paths_in, cases, config.jobs, done)
    for (room, detail, *_), path_sets in zip(cases, paths, strict=True):
        by_room.setdefault(f"{room}, {detail}", path_sets)
        for name in REFERENCES:
            compared.setdefault((room, detail, name), []).append(compare(path_sets[name], path_sets["ours"]))
    rows = [row for key, each in compared.items() for row in _rows(key, each, config)]
    metrics = {
        f"{what} {name}".replace(",", ""): float(of([row["value"] for row in rows if row["metric"] == metric and row["reference"] == name]))
        for what, metric, of in (("least matched share", METRICS[0], min), ("worst mean level error dB", METRICS[1], max))
        for name in REFERENCES
    }
    return Result(TABLE.name, rows, {TABLE.name: lambda: _figure(by_room)}, metrics)


def _paths_in(room: str, detail: str, place: int, seed: int) -> dict[str, PathSet]:
    """Return {name: paths} of RadarTwin and of each reference at one radar position in a room."""
    scene, pose = rooms.room(room, detail=detail), pose_in(room, place, seed)
    path_sets = {"ours": radartwin_paths(scene, pose)} | {name: reference(name, scene, pose) for name in REFERENCES}
    return {name: cleared(paths, path_sets["image sources"]) for name, paths in path_sets.items()}


def pose_in(room: str, place: int, seed: int) -> np.ndarray:
    """Return a pose (4, 4) near the rover's start, off all symmetry planes and tilted, so that no image lies on the antenna's axis."""
    pose = rooms.bench(room).sensor_pose.copy()
    draw = np.random.default_rng([seed, place])
    pose[:3, 3] += draw.uniform([0.05, 0.05, 0.02], [0.35, 0.35, 0.6])
    pose[:3, :3] = rotation()
    return pose


def radartwin_paths(scene: Scene, pose: np.ndarray) -> PathSet:
    """Return RadarTwin's paths that reflect at flat faces only, without diffraction at edges."""
    parts = MitsubaBackend(TraceSettings(room="panels", diffuse=False, max_bounces=BOUNCES)).paths(scene, RADAR, pose[None])
    return together(_of_paths(Paths.concatenate([part for part in parts if part.mirror is not None])))


def reference(name: str, scene: Scene, pose: np.ndarray) -> PathSet:
    """Return the paths of the reference method `name`, which must be in REFERENCES."""
    if name == "image sources":
        return _images(scene, pose)
    apart = name == "Sionna, apart"
    backend = SionnaBackend(SionnaSettings(max_bounces=BOUNCES, separation_m=APART_M if apart else 0.0))
    mesh = sionna_scene.convert(scene.surfaces, {}, RADAR)
    answer = backend.traced(mesh, pose[None])
    small = _small(scene, mesh, answer["face"])
    if not apart:
        return together(_of_answer(answer, mesh.frequencies_hz, small, pose))
    with quiet():  # the table shows which paths Sionna RT misses
        (paths,) = backend.paths(scene, RADAR, pose[None])
    return together(_of_paths(paths, small))


def _images(scene: Scene, pose: np.ndarray) -> PathSet:
    images = list(Room(scene, frequency_hz(scene)).images(pose[:3, 3], pose[:3, 2], BOUNCES))
    length, departure, arrival, amplitude, clear = (
        np.array([getattr(image, name) for image in images]) for name in ("length_m", "departure", "arrival", "amplitude", "clear")
    )
    return PathSet(length, departure @ pose[:3, :3], arrival @ pose[:3, :3], amplitude, np.zeros(len(images), bool), clear)


def _of_paths(paths: Paths, small: np.ndarray | None = None) -> PathSet:
    amplitude, unknown = _middle(paths.amplitude, paths.frequencies_hz), np.zeros(len(paths), bool)
    return PathSet(paths.length_m, paths.departure, paths.arrival, amplitude, unknown if small is None else small, unknown)


def _of_answer(answer: dict[str, np.ndarray], frequencies_hz: np.ndarray, small: np.ndarray, pose: np.ndarray) -> PathSet:
    """Return the paths that Sionna found, with the lengths and hit points that Sionna returns."""
    vertex, count = answer["vertex"], (answer["face"] >= 0).sum(axis=1)
    ends = (vertex[:, 0], vertex[np.arange(len(vertex)), count - 1])
    lines = [(end - pose[:3, 3]) @ pose[:3, :3] for end in ends]
    departure, arrival = (line / np.linalg.norm(line, axis=1, keepdims=True) for line in lines)
    amplitude = _middle(answer["amplitude"].conj(), frequencies_hz)
    return PathSet(answer["length_m"], departure, arrival, amplitude, small, np.zeros(len(vertex), bool))


def _small(scene: Scene, mesh: sionna_scene.SionnaScene, face: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of the paths that reflect at a surface for which RadarTwin's tracer uses ray tubes."""
    built = geometry.build([s.mesh for s in scene])
    surfaces = np.unique(built.surface[small_faces(scene.surfaces, built)])
    return np.any(np.isin(mesh.surface[face], surfaces) & (face >= 0), axis=1)


def _middle(amplitude: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
    return amplitude[:, np.abs(frequencies_hz - RADAR.center_frequency_hz).argmin()]


def frequency_hz(scene: Scene) -> float:
    """Return the frequency near the middle of the sweep at which the tracer computes amplitudes without interpolation."""
    high = RADAR.start_frequency_hz + RADAR.sampled_bandwidth_hz
    nodes = reflection_table.build([(s.material, s.roughness_m) for s in scene], RADAR.start_frequency_hz, high).frequencies_hz
    return float(_middle(nodes[None], nodes)[0])


def cleared(paths: PathSet, images: PathSet) -> PathSet:
    """Return the paths with `clear` taken from the matching image source; a path over furniture has none, and is not clear."""
    index = partners(paths, images)
    return replace(paths, clear=np.where(index >= 0, images.clear[index], False))


def compare(reference_paths: PathSet, simulated: PathSet) -> Compared:
    """Match the strong paths of a reference with all paths of RadarTwin, and RadarTwin's strong paths with all paths of the reference."""
    every = reference_paths.strong(DYNAMIC_DB)
    strong = every.where(~every.small)
    index = partners(strong, simulated)
    there = index >= 0
    matched, partner = strong.where(there), simulated.where(index[there])
    level_db = matched.level_db - partner.level_db
    return Compared(
        there,
        1e3 * (matched.length_m - partner.length_m),
        level_db[matched.clear],
        level_db[~matched.clear],
        partners(simulated.strong(DYNAMIC_DB), reference_paths) >= 0,
        int(every.small.sum()),
    )


def _rows(key: tuple[str, str, str], each: list[Compared], config: Config) -> list[dict[str, Any]]:
    """Return the table rows of one room and reference: shares of matched paths, and mean absolute errors over paths."""
    room, detail, name = key

    def row(
        metric: str, samples: np.ndarray, holds: Callable[[float, float], bool] | None, limits: tuple[float, float] = statistics.POSITIVE
    ) -> dict[str, Any]:
        case = {"room": room, "detail": detail, "reference": name, "claim": CLAIMS[metric] if holds else ""}
        estimate = statistics.mean(samples, config.profile.resamples, config.seed, limits) if len(samples) else statistics.exact(np.nan, 0)
        return case | verdicts.score_columns(metric, estimate, "simulation", holds(estimate.low, estimate.high) if holds else None)

    def joined(field: str) -> np.ndarray:
        return np.concatenate([getattr(comparison, field) for comparison in each]).astype(float)

    rows = [
        row("matched share", joined("matched"), lambda low, _: low >= SHARE, statistics.SHARE),
        row("share of ours it has", joined("simulated_matched"), None, statistics.SHARE),
        row("level error (dB)", np.abs(joined("level_db")), lambda _, high: high <= LEVEL_DB),
        row("level difference where an edge cuts the zone (dB)", np.abs(joined("cut_level_db")), None),
    ]
    if name != "Sionna, apart":
        rows.insert(2, row("length error (mm)", np.abs(joined("length_mm")), lambda _, high: high <= DELAY_MM))
    if (small := np.array([float(comparison.small) for comparison in each])).any():
        rows.append(row("paths over small things", small, None))
    return [line for line in rows if line["n"]]


def _figure(by_room: dict[str, dict[str, PathSet]]) -> Figure:
    """Draw the level of each path against half of the path's length, with one panel per room."""
    drawing, panels = figure(len(ROOMS), len(DETAILS), width_in=PAGE_WIDTH_IN, height_in=6.4, sharex=True, sharey=True)
    looks = {
        "ours": ("o", "none", PALETTE[0], 6.0), "image sources": ("+", PALETTE[1], PALETTE[1], 5.0),
        "Sionna, co-located": ("x", PALETTE[2], PALETTE[2], 4.0), "Sionna, apart": (".", PALETTE[3], PALETTE[3], 4.0),
    }  # fmt: skip
    for panel, (title, path_sets) in zip(panels.flat, by_room.items(), strict=True):
        for name, images in path_sets.items():
            marker, face, edge, size = looks[name]
            strong = images.strong(DYNAMIC_DB)
            label = "this tracer" if name == "ours" else name
            panel.plot(strong.length_m / 2, strong.level_db, marker, ms=size, mfc=face, mec=edge, mew=0.8, label=label)
        panel.set(title=title.replace("_", " "))
    for panel in panels[-1]:
        panel.set_xlabel("half the path's length (m)")
    for panel in panels[:, 0]:
        panel.set_ylabel("received / transmitted (dB)")
    panels[0, 0].legend(loc="upper right")
    return drawing
