"""Simulate recordings in the digital twin, which is the radar simulation of a scanned room.

The room is a simulated phone scan whose surfaces have materials from the configured source. The radar and the target move in the
simulation exactly as in the log of the recording.
"""

import functools
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from experiments.campaign import tally
from experiments.campaign.cases import RAIL, ROVER, VOID, Case, Log, stand_top
from experiments.campaign.target import on_carriage, seen
from experiments.scans import virtual_scan
from radartwin.adaptive.limits import Limits
from radartwin.adaptive.probe import thinned
from radartwin.builders.radar import build_radar
from radartwin.builders.simulator import MOTION_FAMILIES, choose_simulator, families_of, simulated_parts, simulator_options
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig
from radartwin.config.simulator import AutoSimulator, MitsubaSimulator
from radartwin.config.study import FeaturesConfig
from radartwin.features.sets import feature_set
from radartwin.label.material_sources import material_source, without_fragments
from radartwin.radar.recording import Recording
from radartwin.scene import rooms
from radartwin.scene.objects.assortment import every_object
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.track_paths import Track, straight
from radartwin.simulation.signal.synthesis import received, thermal_noise
from radartwin.simulation.simulate import simulate
from radartwin.store.digest import spec_digest
from radartwin.store.products import Store
from radartwin.store.recent import Recent


def specification(case: Case, nominal: Log, config: Config, materials: MaterialsConfig, store: Store) -> dict[str, Any]:
    """Return the specification of a simulated recording. The specification decides the recording's store key."""
    spec: dict[str, Any] = {
        "case": asdict(case),
        "course": spec_digest({name: None if value is None else np.round(value, 9) for name, value in vars(nominal).items()}),
        "radar": config.radar,
        "simulator": config.simulator,
        "seed": config.seed,
    }
    if config.contents != "filled":
        spec["contents"] = config.contents
    if isinstance(config.simulator, AutoSimulator):
        spec |= {
            "families": _families(config, case),
            "limits": Limits.shipped(case.motion, case.object).of,
        }  # the choice of simulator=auto depends on families and limits
    if materials.source == VOID:
        return spec | {"materials": VOID}
    return spec | {"materials": materials, "scan": virtual_scan.key(config, store, case.room, config.measured.gap.geometry)}


def room_of(case: Case, config: Config, materials: MaterialsConfig, store: Store) -> Scene:
    """Return the scene of a scanned room with materials. Raises UserError if the store has no recorded answers for the room."""
    if materials.source == VOID:
        return rooms.void()
    scanned = virtual_scan.scene_of(virtual_scan.fetch(config, store, case.room, config.measured.gap.geometry))
    if materials.source in ("true", "random"):  # both use the true label of each scanned surface
        truth = rooms.room(case.room, detail="cluttered")
        scanned = material_source("true", scene=truth)(without_fragments(scanned, truth))
        if materials.source == "true":
            return scanned
    return material_source(materials.source, **materials.arguments(config.seed))(scanned)


def record(
    case: Case, nominal: Log, config: Config, materials: MaterialsConfig, store: Store, say: Callable[[str], None] = lambda line: None
) -> Recording:
    """Simulate the recording of a case along its logged motion, without noise. `say` prints which settings simulator=auto chose."""
    radar = replace(build_radar(config.radar), frame_rate_hz=nominal.frame_rate_hz)
    room = room_of(case, config, materials, store)
    stand = _stand(stand_top(nominal).tobytes())
    target = list(every_object()[case.object].surfaces(contents=config.contents))
    motion = {case.object: np.repeat(nominal.target_poses, nominal.frames // len(nominal.target_poses), axis=0)}
    simulator = config.simulator
    if isinstance(simulator, AutoSimulator):
        families = _families(config, case)
        probe = thinned(room, stand + Scene(target), radar, nominal.sensor_poses, motion, nominal, families, simulator.variant)
        simulator = choose_simulator(simulator, probe, Limits.shipped(case.motion, case.object), store, say)
    provenance = {"kind": "simulation", "model": asdict(simulator)}
    room = simulated_parts(simulator, room)
    options = simulator_options(simulator)
    if not isinstance(simulator, MitsubaSimulator) or not straight(nominal.sensor_poses):
        made = simulate(room + stand + Scene(target), radar, nominal.sensor_poses, motion=motion, **options)
        return replace(made, provenance=provenance)
    known = str((materials, config.seed, config.measured.gap.geometry, simulator.parts))
    drives = _track(case, room, options["simulator"].settings, radar, nominal, known)
    disc, post = ([s for s in stand if s.name == name] for name in ("turntable", "stand"))
    if case.motion in RAIL:
        parts = on_carriage(drives, nominal.sensor_poses, target, nominal.target_poses, nominal.target_poses[0], disc, post)
    else:
        parts = seen(drives, nominal.sensor_poses, nominal.frame_rate_hz, target, nominal.target_poses, disc, post)
    iq = received(parts, radar, nominal.frames, elements=options["elements"], oscillator=None)
    iq = iq + drives.room_samples(nominal.sensor_poses, options["elements"])
    return Recording(iq, radar, None, provenance=provenance)


def noisy(clean: Recording, case: Case, config: Config) -> Recording:
    """Add thermal noise according to the radar's noise figure. The random seed comes from the configured seed and the recording's name."""
    rng = np.random.default_rng(np.random.SeedSequence([config.seed, *b"twin noise", *case.name.encode()]))
    return Recording(clean.iq + thermal_noise(clean.iq.shape, clean.radar, rng), clean.radar, None, provenance=clean.provenance)


@functools.lru_cache(maxsize=4)
def _stand(top: bytes) -> Scene:
    """Return the target's stand whose top has the position with the bytes `top` (3,). Its materials are known to the user."""
    return rooms.support(np.frombuffer(top))


def _families(config: Config, case: Case) -> tuple[str, ...]:
    """Return the feature families that simulator=auto must preserve: the configured ones if the motion has all of them, else all."""
    fit = set(feature_set(config.features.name)) <= set(MOTION_FAMILIES[case.motion])
    return families_of(config.features if fit else FeaturesConfig(), case.motion)


_tracks: Recent[Track] = Recent(2)  # simulator=auto can choose other settings for another object


def _track(case: Case, room: Scene, settings: Any, radar: Any, nominal: Log, known: str) -> Track:
    """Return the traced track of a case; the last ones are cached. The text `known` lists all settings that change the room's model."""
    motion = case.motion if case.motion in ROVER else "bench"
    key = f"{case.room} {motion} {known} {settings} {radar} {nominal.sensor_poses.tobytes().hex()}"

    def build() -> Track:
        tally.count(tally.SETUPS)
        return Track.of_drives(list(room), radar, nominal.sensor_poses, settings)

    return _tracks.get(key, 1, build)
