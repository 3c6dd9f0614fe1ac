"""The twin's side of a campaign: the room as a phone scanned it, labelled by the configured source, and objects and courses as logged."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from experiments.campaign import tally
from experiments.campaign.cases import RAIL, ROVER, Case, Log, stand_top
from experiments.campaign.target import on_carriage, seen
from experiments.scans import virtual_scan
from radartwin.adaptive.limits import Limits
from radartwin.adaptive.probe import thinned
from radartwin.build import auto
from radartwin.build.radar import build_radar
from radartwin.build.simulator import simulated_parts, simulator_options
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig
from radartwin.config.simulator import AutoSimulator, MitsubaSimulator
from radartwin.config.study import FeaturesConfig
from radartwin.features.families import SETS
from radartwin.label.sources import material_source, without_fragments
from radartwin.materials import Layered
from radartwin.radar.recording import Recording
from radartwin.scene import rooms
from radartwin.scene.objects.catalogue import catalogue
from radartwin.scene.scene import Scene
from radartwin.simulation.drives import Drives, straight
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import simulate
from radartwin.store.digest import spec_digest
from radartwin.store.products import Store

KEPT = 2  # tracks with what was scouted along them
VOID = "void"


def specification(case: Case, nominal: Log, config: Config, materials: MaterialsConfig, store: Store) -> dict[str, Any]:
    """What decides a simulated recording."""
    spec: dict[str, Any] = {
        "case": asdict(case),
        "course": spec_digest({name: None if value is None else np.round(value, 9) for name, value in vars(nominal).items()}),
        "radar": config.radar,
        "simulator": config.simulator,
        "seed": config.seed,
    }
    if isinstance(config.simulator, AutoSimulator):
        spec |= {"families": _families(config, case), "limits": Limits.shipped(case.motion, case.object).of}  # decide what is chosen
    if materials.source == VOID:
        return spec | {"materials": VOID}
    return spec | {"materials": materials, "scan": virtual_scan.key(config, store, case.room, config.measured.gap.geometry)}


def room_of(case: Case, config: Config, materials: MaterialsConfig, store: Store) -> Scene:
    """What the twin knows of a room.

    Raises:
        UserError: the source has no answers for it.
    """
    if materials.source == VOID:
        return rooms.void()
    scanned = virtual_scan.scene_of(virtual_scan.fetch(config, store, case.room, config.measured.gap.geometry))
    if materials.source in ("true", "random"):  # they are told what nobody with a scan alone could know
        truth = rooms.room(case.room, detail="cluttered")
        scanned = material_source("true", scene=truth)(without_fragments(scanned, truth))
        if materials.source == "true":
            return scanned
    return material_source(materials.source, **materials.arguments(config.seed))(scanned)


def record(
    case: Case, nominal: Log, config: Config, materials: MaterialsConfig, store: Store, say: Callable[[str], None] = lambda line: None
) -> Recording:
    """The simulated recording of a case along its logged course, without noise; `say` hears what simulator=auto chose."""
    radar = replace(build_radar(config.radar), frame_rate_hz=nominal.frame_rate_hz)
    room = room_of(case, config, materials, store)
    stand = rooms.support(stand_top(nominal))
    if materials.source not in ("true", "random"):  # who is told true materials, or some wrong ones, has the stand's layers told too
        stand = _outermost(stand)
    target = list(catalogue()[case.object].surfaces())
    motion = {case.object: np.repeat(nominal.target_poses, nominal.frames // len(nominal.target_poses), axis=0)}
    simulator = config.simulator
    if isinstance(simulator, AutoSimulator):
        families = _families(config, case)
        probe = thinned(room, stand + Scene(target), radar, nominal.sensor_poses, motion, nominal, families, simulator.variant)
        simulator = auto.choose_simulator(simulator, probe, Limits.shipped(case.motion, case.object), store, say)
    told = {"kind": "simulation", "model": asdict(simulator)}
    room = simulated_parts(simulator, room)
    options = simulator_options(simulator)
    if not isinstance(simulator, MitsubaSimulator) or not straight(nominal.sensor_poses):
        made = simulate(room + stand + Scene(target), radar, nominal.sensor_poses, motion=motion, **options)
        return replace(made, provenance=told)
    known = str((materials, config.seed, config.measured.gap.geometry, options["elements"], simulator.parts))
    drives, around = _track(case, room, options["simulator"].settings, radar, nominal, known, options["elements"])
    disc, post = ([s for s in stand if s.name == name] for name in ("turntable", "stand"))
    if case.motion in RAIL:
        parts = on_carriage(drives, nominal.sensor_poses, target, nominal.target_poses, nominal.target_poses[0], disc, post)
    else:
        parts = seen(drives, nominal.sensor_poses, nominal.frame_rate_hz, target, nominal.target_poses, disc, post)
    iq = received(parts, radar, nominal.frames, elements=options["elements"], oscillator=None) + around
    return Recording(iq, radar, None, provenance=told)


def noisy(clean: Recording, case: Case, config: Config) -> Recording:
    """With the thermal noise of the radar's noise figure, seeded by the recording."""
    from radartwin.simulation.signal.synthesis import thermal_noise

    rng = np.random.default_rng(np.random.SeedSequence([config.seed, *b"twin noise", *case.name.encode()]))
    return Recording(clean.iq + thermal_noise(clean.iq.shape, clean.radar, rng), clean.radar, None, provenance=clean.provenance)


def _outermost(scene: Scene) -> Scene:
    """The twin takes the stand's outermost material without its thickness."""
    return Scene((s.replaced(material=s.material.layers[0][0]) if isinstance(s.material, Layered) else s for s in scene), scene.provenance)


def _families(config: Config, case: Case) -> tuple[str, ...]:
    """What simulator=auto must keep: of the configured features, or all that a motion exposes where it has not those."""
    fit = set(SETS[config.features.name]) <= set(auto.MOTION_FAMILIES[case.motion])
    return auto.families_of(config.features if fit else FeaturesConfig(), case.motion)


_tracks: OrderedDict[str, tuple[Drives, np.ndarray]] = OrderedDict()


def _track(case: Case, room: Scene, settings: Any, radar: Any, nominal: Log, known: str, elements: str) -> tuple[Drives, np.ndarray]:
    """What a case is driven along, and what the room alone returns there, (F or 1, C, T, R, N): the twin drives as logged, whatever is
    measured. The last few are kept, so that objects share them. `known`: what decides the room beside its name."""
    motion = case.motion if case.motion in ROVER else "bench"
    key = f"{case.room} {motion} {known} {settings} {radar} {nominal.sensor_poses.tobytes().hex()}"
    if key not in _tracks:
        tally.count(tally.SETUPS)
        drives = Drives(list(room), radar, nominal.sensor_poses, settings)
        parts = drives.room(nominal.sensor_poses)
        _tracks[key] = drives, received(parts, radar, len(nominal.sensor_poses), elements=elements, oscillator=None)
        while len(_tracks) > KEPT:
            _tracks.popitem(last=False)
    _tracks.move_to_end(key)
    return _tracks[key]
