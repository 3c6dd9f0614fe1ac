"""The turntable campaign in the lab: one recording per domain, distance and repetition, made once and kept.

Domains: `measured` (the testbed), `room` (the twin with its scanned room and the configured materials) and `void` (the twin's object and
stand alone). What experimenter and twin agree on is the log: which object, where, how fast it turns, where the radar is. Scoring lives
elsewhere, so that a change of score records nothing again.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from radartwin.assemble import build_radar, simulator_options
from radartwin.config import Config
from radartwin.errors import ConfigError
from radartwin.label.sources import material_source
from radartwin.materials import Layered
from radartwin.measured import testbed
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.scene import objects, rooms, scan, trajectory
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation.simulate import simulate
from radartwin.store import Product, Store

ROOTS = ["experiments.turntable"]
DOMAINS = ("measured", "room", "void")
TARGET = "corner_reflector"
WALL_M = 0.3  # the stand keeps this far from the wall behind it
SCAN_OFFSET_M, SCAN_TILT_DEG = 0.01, 0.2  # of the twin's scan at strength 1 of the geometry gap; sources in radartwin/scene/scan.py


def check(config: Config) -> None:
    """Refuse what this campaign cannot do, before anything is simulated."""
    if config.scene.name != "lab":
        raise ConfigError(f"the turntable stands in scene=lab, not scene={config.scene.name}")
    if config.scene.target != TARGET:
        raise ConfigError(f"the turntable carries scene.target={TARGET}, not {config.scene.target}")
    if config.measured.provider != "testbed":
        raise ConfigError("the turntable campaign is scored against measured=testbed; measured=recordings is not read by it")
    if not config.experiment.distances_m:
        raise ConfigError("experiment.distances_m is empty; give at least one distance in metres")
    course = config.trajectory
    if course.kind != "turntable":
        raise ConfigError(f"the turntable campaign turns: trajectory={course.kind} cannot be recorded in it")
    if course.position_m is not None or course.heading_deg or course.frames is not None:
        raise ConfigError(
            "the turntable stands on the lab's bench: trajectory.position_m, heading_deg and frames (see profile.frames) are not read"
        )
    room = twin_room(config)
    farthest = rooms.lab_bench().target_position(max(config.experiment.distances_m))[0]
    wall = rooms.lab().bounds[1, 0]
    if not farthest < wall - WALL_M:
        raise ConfigError(
            f"experiment.distances_m: {max(config.experiment.distances_m):g} m is not inside the lab, whose wall is {wall - 1:g} m away"
        )
    room.check_sensor(rooms.lab_bench(course.height_m).sensor_pose[:3, 3])


def fetch(config: Config, store: Store, domain: str, distance_m: float, repeat: int = 0) -> tuple[Product, Recording]:
    """One recording, from the store or made now."""
    spec: dict = {
        "domain": domain, "distance_m": distance_m, "repeat": repeat, "frames": config.profile.frames, "seed": config.seed,
        "radar": config.radar, "height_m": config.trajectory.height_m, "period_s": config.trajectory.period_s,
        "leg_m": config.scene.target_size_m,
    }  # fmt: skip
    if domain == "measured":
        spec["gap"] = {k: v for k, v in asdict(config.measured.gap).items() if k != "geometry"}  # the scan's, not the truth's
    else:
        spec["simulator"] = config.simulator
    if domain == "room":
        spec |= {"materials": config.materials, "scan": config.measured.gap.geometry}

    def build(folder: Path) -> None:
        recording = _measure(config, distance_m, repeat) if domain == "measured" else _simulate(config, domain, distance_m)
        recording.save(folder / "recording")

    product = store.fetch("recording", spec, ROOTS, build)
    return product, Recording.load(product.path / "recording")


def twin_room(config: Config) -> Scene:
    """What the twin knows of the lab: the truth as a scan shows it, labelled by the configured source.

    Raises:
        UserError: the source has no answers for it.
    """
    strength = config.measured.gap.geometry
    rng = np.random.default_rng(np.random.SeedSequence([config.seed, *b"scan of the lab"]))
    lab = scan.as_scanned(rooms.lab(detail="cluttered"), rng, strength * SCAN_OFFSET_M, strength * SCAN_TILT_DEG)
    return material_source(config.materials.source, **config.materials.options(config.seed))(lab)


def _radar(config: Config) -> Radar:
    """The configured radar, its frames spread evenly over one revolution."""
    return replace(build_radar(config.radar), frame_rate_hz=config.profile.frames / config.trajectory.period_s)


def _log(config: Config, distance_m: float) -> tuple[Scene, dict[str, np.ndarray], np.ndarray]:
    """Reflector and stand, their nominal motion, and the sensor's pose."""
    bench = rooms.lab_bench(config.trajectory.height_m)
    leg = config.scene.target_size_m
    position = bench.target_position(distance_m)
    reflector = Surface(objects.trihedral(leg), "metal", TARGET, role="object")
    stand = rooms.support(position - [0, 0, leg / np.sqrt(6) + rooms.GAP])
    turning = trajectory.turntable(position, config.profile.frames, _radar(config).frame_rate_hz, config.trajectory.period_s)
    motion = {TARGET: turning, **{name: np.eye(4)[None] for name in stand.names}}
    return Scene([reflector]) + stand, motion, bench.sensor_pose


def _measure(config: Config, distance_m: float, repeat: int) -> Recording:
    gap = config.measured.gap
    gaps = testbed.Gaps(**{k: v for k, v in asdict(gap).items() if k != "geometry"})
    target, motion, pose = _log(config, distance_m)
    lab = testbed.truth(rooms.lab(detail="cluttered") + target, gaps, config.seed, frozenset(rooms.CLUTTER))
    seed = int(np.random.SeedSequence([config.seed, repeat, round(1000 * distance_m)]).generate_state(1)[0])
    return testbed.record(lab, _radar(config), pose, motion, gaps, seed, config.simulator.variant)


def _simulate(config: Config, domain: str, distance_m: float) -> Recording:
    target, motion, pose = _log(config, distance_m)
    scene = _halfspaces(target)
    if domain == "room":
        scene = twin_room(config) + scene
    return simulate(scene, _radar(config), pose, motion=motion, noise=True, seed=config.seed, **simulator_options(config.simulator))


def _halfspaces(scene: Scene) -> Scene:
    """The twin takes the stand's outermost material without its thickness."""
    return Scene((s.replaced(material=s.material.layers[0][0]) if isinstance(s.material, Layered) else s for s in scene), scene.provenance)
