"""Environment ablation: is a range profile more like the measured one when the room is simulated too?

A corner reflector turns once in front of the radar at each distance. Measured: the testbed's room with its clutter, layers and imperfect
radar. Simulated twice: object and stand alone (void), and with the twin's room (as scanned, with the configured materials). Compared: mean
range profiles by Pearson correlation, and the share of energy that arrives from beyond the target. Paper: environment ablation, void
against reconstructed scene, -0.24 against +0.42 at 2 m and about 75 % of the energy beyond the target.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.statistics import bootstrap_mean
from radartwin.assemble import build_radar
from radartwin.config import Config
from radartwin.errors import ConfigError
from radartwin.experiment import Result
from radartwin.features.profile import FAR_M, NEAR_M, beyond_target_share, profile_correlation, range_time
from radartwin.label.sources import material_source
from radartwin.materials import Layered
from radartwin.measured import testbed
from radartwin.plotting import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.scene import objects, rooms, scan, trajectory
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation.simulate import simulate
from radartwin.store import Product, Store, save_arrays

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOTS = ["experiments.environment"]
TARGET = "corner_reflector"
PAPER = {("void", 2.0): "-0.24", ("room", 2.0): "+0.42"}
PAPER_SHARE = {2.0: "about 0.75"}
SCALES = ("amplitude", "db")
SCALE_NAMES = {"amplitude": "amplitude", "db": "decibels"}
KINDS = ("measured", "room", "void")
SCAN_OFFSET_M, SCAN_TILT_DEG = 0.01, 0.2


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Score the ablation at every distance; rows hold both scales of the correlation, and the energy shares."""
    _check(config)
    source = config.materials.source
    room = "void" if source == "void" else f"room ({source})"
    profiles: dict[tuple[str, float], list[np.ndarray]] = {}
    maps: dict[tuple[str, float], np.ndarray] = {}
    keys: list[str] = []
    axis = np.zeros(0)
    distances = config.experiment.distances_m
    repeats = {"measured": config.profile.repeats, "void": 1, "room": 1}
    cases = [(distance, kind, i) for distance in distances for kind in KINDS for i in range(repeats[kind])]
    for distance, kind, repeat in progress.over(cases, "environment recordings"):
        product = _fetch(config, store, kind, distance, repeat)
        arrays = product.arrays()
        keys.append(product.key)
        axis = arrays["range_m"]
        profiles.setdefault((kind, distance), []).append(arrays["power"].mean(axis=0))
        maps.setdefault((kind, distance), arrays["power"])
    rows = _rows(config, distances, profiles, axis, room, keys)
    figures: dict[str, Callable[[], Figure]] = {
        "environment_range_time": lambda: _triptych(maps, axis, distances[-1], room),
        "environment_correlation": lambda: _chart(rows, distances, room),
    }
    last = distances[-1]
    chosen = {(r["case"], r["scale"]): r for r in rows if r["distance_m"] == last}
    metrics = {
        f"correlation_{c.split()[0]}_{s}_{last:g}m": chosen[c, s]["value"] for c in ("void", room) for s in SCALES if (c, s) in chosen
    }
    return Result("environment", rows, figures, metrics, keys)


def _check(config: Config) -> None:
    if config.scene.name != "lab":
        raise ConfigError(f"experiment=environment is set in scene=lab, not scene={config.scene.name}")
    if config.measured.provider != "testbed":
        raise ConfigError("experiment=environment is scored against measured=testbed so far; recordings need an index of distances")
    if not config.experiment.distances_m:
        raise ConfigError("experiment.distances_m is empty; give at least one distance in metres")


def _fetch(config: Config, store: Store, kind: str, distance: float, repeat: int) -> Product:
    """The range-time map of one recording, and the recording itself, from the store or computed now."""
    spec: dict = {
        "kind": kind, "distance_m": distance, "repeat": repeat, "frames": config.profile.frames, "seed": config.seed,
        "radar": asdict(config.radar), "trajectory": asdict(config.trajectory), "leg_m": config.scene.target_size_m,
    }  # fmt: skip
    if kind == "measured":
        spec["gap"] = asdict(config.measured.gap)
    else:
        spec["simulator"] = {k: v for k, v in asdict(config.simulator).items() if k != "variant"}
        spec["materials"] = asdict(config.materials) if kind == "room" else None
        spec["scan"] = config.measured.gap.geometry if kind == "room" else None
        material_source(config.materials.source)  # an unknown one stops here, not in the middle of a simulation

    def build(folder: Path) -> None:
        recording = _measure(config, distance, repeat) if kind == "measured" else _simulate(config, kind, distance)
        recording.save(folder / "recording")
        power, range_m = range_time(Recording.load(folder / "recording"))
        save_arrays(folder, {"power": power, "range_m": range_m})

    return store.fetch("recording", spec, ROOTS, build)


def _radar(config: Config) -> Radar:
    """The configured radar, its frames spread evenly over one revolution."""
    return replace(build_radar(config.radar), frame_rate_hz=config.profile.frames / config.trajectory.period_s)


def _target(config: Config, distance: float) -> tuple[Scene, dict[str, np.ndarray], np.ndarray]:
    """Reflector and stand, their nominal motion, and the sensor's pose: what experimenter and twin agree on."""
    bench = rooms.lab_bench(config.trajectory.height_m)
    leg = config.scene.target_size_m
    position = bench.target_position(distance)
    reflector = Surface(objects.trihedral(leg), "metal", TARGET, role="object")
    stand = rooms.support(position - [0, 0, leg / np.sqrt(6) + rooms.GAP])
    turning = trajectory.turntable(position, config.profile.frames, _radar(config).frame_rate_hz, config.trajectory.period_s)
    motion = {TARGET: turning, **{name: np.eye(4)[None] for name in stand.names}}
    return Scene([reflector]) + stand, motion, bench.sensor_pose


def _measure(config: Config, distance: float, repeat: int) -> Recording:
    gap = config.measured.gap
    gaps = testbed.Gaps(gap.materials, gap.roughness, gap.clutter, gap.hardware, gap.trajectory, gap.solver)
    target, motion, pose = _target(config, distance)
    lab = testbed.truth(rooms.lab(detail="cluttered") + target, gaps, config.seed, frozenset(rooms.CLUTTER))
    seed = int(np.random.SeedSequence([config.seed, repeat, round(1000 * distance)]).generate_state(1)[0])
    return testbed.record(lab, _radar(config), pose, motion, gaps, seed, config.simulator.variant)


def _simulate(config: Config, kind: str, distance: float) -> Recording:
    target, motion, pose = _target(config, distance)
    if kind == "room":
        strength = config.measured.gap.geometry
        rng = np.random.default_rng(np.random.SeedSequence([config.seed, *b"scan of the lab"]))
        lab = scan.as_scanned(rooms.lab(detail="cluttered"), rng, strength * SCAN_OFFSET_M, strength * SCAN_TILT_DEG)
        options = {"material": config.materials.material} if config.materials.source == "uniform" else {}
        target = material_source(config.materials.source, **options)(lab + _halfspaces(target))
    settings = config.simulator
    return simulate(
        target if kind == "room" else _halfspaces(target), _radar(config), pose, motion=motion, noise=True, seed=config.seed,
        max_bounces=settings.max_bounces, rays=settings.rays, rays_per_wavelength2=settings.rays_per_wavelength2, variant=settings.variant,
    )  # fmt: skip


def _halfspaces(scene: Scene) -> Scene:
    """The twin takes the stand's outermost material without its thickness."""
    return Scene((s.replaced(material=s.material.layers[0][0]) if isinstance(s.material, Layered) else s for s in scene), scene.provenance)


def _rows(config: Config, distances: list[float], profiles: dict, axis: np.ndarray, room: str, keys: list[str]) -> list[dict]:
    """Table rows: per distance and scale void, room and their difference; per distance the energy share in each domain."""
    rows: list[dict] = []
    with_room = config.materials.source != "void"
    run_keys = " ".join(key[:8] for key in keys)

    def add(
        distance: float, case: str, scale: str, metric: str, samples: Any, *, paper: str = "", claim: str = "", above: float = 0.0
    ) -> None:
        low, value, high = bootstrap_mean(np.asarray(samples), config.profile.resamples, config.seed)
        verdict = "untestable" if not claim else "holds" if low > above else "fails"
        rows.append({
            "distance_m": distance, "case": case, "scale": scale, "claim": claim, "metric": metric, "paper": paper, "value": value,
            "low": low, "high": high, "n": len(samples), "domain": "testbed", "verdict": verdict, "run_keys": run_keys,
        })  # fmt: skip

    for distance in distances:
        measured = profiles["measured", distance]
        for scale in SCALES:
            void, full = (
                [profile_correlation(profiles[case, distance][0], one, axis, scale) for one in measured] for case in ("void", "room")
            )
            add(distance, "void", scale, "profile correlation", void, paper=PAPER.get(("void", distance), ""))
            if with_room:
                add(distance, room, scale, "profile correlation", full, paper=PAPER.get(("room", distance), ""))
                gain, claim = np.subtract(full, void), "the room brings the profile closer to the measured one"
                add(distance, f"{room} - void", scale, "gain in correlation", gain, paper="above 0", claim=claim)
        shares = [beyond_target_share(one, axis, distance) for one in measured]
        paper = PAPER_SHARE.get(distance, "")
        claim = "most of the energy arrives from beyond the target" if paper else ""
        add(distance, "measured", "power", "energy share beyond the target", shares, paper=paper, claim=claim, above=0.5)
        for case, label in (("room", room), ("void", "void"))[0 if with_room else 1 :]:
            share = [beyond_target_share(profiles[case, distance][0], axis, distance)]
            add(distance, label, "power", "energy share beyond the target", share)
    return rows


def _triptych(maps: dict, axis: np.ndarray, distance: float, room: str) -> Figure:
    """Range-time maps at one distance: measured, room, void, on one scale."""
    drawing, panels = figure(1, 3, width_in=PAGE_WIDTH_IN, height_in=2.8, sharey=True, sharex=True)
    inside = (axis >= NEAR_M) & (axis <= FAR_M)
    top = max(10 * np.log10(maps[kind, distance][:, inside].max()) for kind in KINDS)
    image = None
    for panel, kind, title in zip(panels, KINDS, ("measured (testbed)", f"simulated, {room}", "simulated, void"), strict=True):
        power = 10 * np.log10(np.maximum(maps[kind, distance][:, inside], 1e-30))
        extent = (0, 360, float(axis[inside][0]), float(axis[inside][-1]))
        image = panel.imshow(power.T, origin="lower", aspect="auto", extent=extent, vmin=top - 70, vmax=top, interpolation="nearest")
        panel.set(title=title, xlabel="turntable angle (deg)", xticks=[0, 90, 180, 270, 360])
    panels[0].set_ylabel("range (m)")
    panels[0].annotate(
        "reflector", (15, distance), (25, distance - 0.6), color="white", fontsize=7, arrowprops={"arrowstyle": "-", "color": "white"}
    )
    drawing.colorbar(image, ax=panels, label="received / transmitted power (dB)", pad=0.01)
    return drawing


def _chart(rows: list[dict], distances: list[float], room: str) -> Figure:
    """Correlation against distance, void and room, one panel per scale."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6, sharey=True)
    for panel, scale in zip(panels, SCALES, strict=True):
        for case, colour, marker in (("void", PALETTE[1], "s"), (room, PALETTE[0], "o")):
            chosen = [next(r for r in rows if r["case"] == case and r["scale"] == scale and r["distance_m"] == d) for d in distances]
            value = np.array([r["value"] for r in chosen])
            spread = [value - [r["low"] for r in chosen], np.array([r["high"] for r in chosen]) - value]
            panel.errorbar(distances, value, yerr=spread, color=colour, marker=marker, capsize=2, label=case)
        panel.axhline(0, color="0.6", lw=0.6)
        panel.set(title=f"profiles in {SCALE_NAMES[scale]}", xlabel="distance of the reflector (m)", ylim=(-0.5, 1.05))
    panels[0].set_ylabel("correlation with measured profile")
    panels[0].legend(loc="lower left")
    return drawing
