"""Simulate the recordings of the testbed (virtual measurements): the true scene before receiver effects, and the receiver effects.

This module never imports the simulated scan, the material labels or the simulator settings of the scanned room. A clean recording (before
receiver effects) depends only on whether the option measured.gap.hardware is zero, so all values above zero give the same clean recording.
Unscanned echoes, noise, leakage and ADC effects are added when the recording is read, so all strengths of unscanned echoes share a clean
recording. The random seed of noise, leakage and ADC comes from the configured seed, the draw and the name of the recording, and that of the
unscanned echoes from the configured seed and the draw.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.campaign import tally
from experiments.campaign.cases import RAIL, ROVER, Case, Log, log, stand_top
from experiments.campaign.target import on_carriage, seen
from experiments.campaign.turned import Turned
from radartwin.builders.radar import build_radar
from radartwin.radar.antenna_errors import AntennaErrors
from radartwin.radar.chirp import Radar
from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene import rooms
from radartwin.scene.objects.assortment import every_object
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation.aspects import BATCH, SHADOW_ASPECTS, SHADOW_ROUND, Aspects, needed, over_room
from radartwin.simulation.backends.mitsuba import TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import simulate
from radartwin.store.recent import Recent
from radartwin.testbed import bystander, drift, fixtures, testbed, unscanned
from radartwin.testbed import motion_errors as errors
from radartwin.testbed.object_shape import as_made

if TYPE_CHECKING:
    from radartwin.config.config import Config

OFF_AXIS = 3.0  # the spacing of traced angles allows for errors of placement and wobble up to this number of standard deviations
# Gaps that change neither room nor stand; `contents` does not, because there is no vessel among them
OF_TARGET = ("trajectory", "placement", "contents", "object_shape", "object_material", "person")
RUNNING = ("turntable_motor", "turntable_gear")  # fixtures that warm up while the turntable turns
DRAW_STEP = 1000  # draw d of seed s has the seeds of draw 0 of seed s + 1000 d
PERSON_RAYS = 0.1  # ray tubes per square wavelength on the person


def gaps_of(config: Config) -> testbed.Gaps:
    """Return the strengths of the gaps (known differences between measurement and simulation) of the true scene and its radar."""
    return testbed.Gaps(**{k: v for k, v in asdict(config.measured.gap).items() if k not in ("geometry", "unscanned_echoes")})


def seed_of(case: Case, config: Config) -> int:
    """Return the random seed of one recording, computed from the configured seed, the draw and the recording's name."""
    return int(np.random.SeedSequence([root_of(case, config), *case.name.encode()]).generate_state(1)[0])


def root_of(case: Case, config: Config) -> int:
    """Return the random seed of everything that the recordings of one draw share: room, objects and radar board."""
    return config.seed + DRAW_STEP * case.draw


def specification(case: Case, config: Config) -> dict[str, Any]:
    """Return the specification of a clean recording (before receiver effects). The specification decides the recording's store key."""
    gap = {**asdict(gaps_of(config)), "hardware": config.measured.gap.hardware > 0}
    campaign = config.profile.campaign
    if case.motion == "turntable":
        course = {"turns": campaign.turns, "frames_per_turn": campaign.frames_per_turn}
    else:
        course = {"every": campaign.rover_every if case.motion in ROVER else campaign.rail_every}
    radar = build_radar(config.radar).to_dict()
    return {"case": asdict(case), "course": course, "gap": gap, "radar": radar, "seed": root_of(case, config)}


@dataclass(frozen=True, eq=False)
class _Place:
    """Conditions of one recording: the radar with its front end, the log, the gap strengths and the ray tracer's settings."""

    radar: Radar
    log: Log
    gaps: testbed.Gaps
    settings: TraceSettings


def record(case: Case, config: Config) -> Recording | Turned:
    """Simulate the clean recording of a case, that is, the output of an ideal receiver behind the IF filter.

    A turntable recording with more frames than traced target angles is returned as `Turned`, which interpolates its frames between the
    traced angles.
    """
    gaps = gaps_of(config)
    nominal = log(case, config.profile.campaign, measured=True)
    radar = replace(build_radar(config.radar), frame_rate_hz=nominal.frame_rate_hz)
    fine = gaps.solver > 0
    settings = TraceSettings(
        max_bounces=testbed.TRUTH_BOUNCES if fine else 4,
        # drives keep one tube per square wavelength, because moving paths along the track (simulation/backends/track_paths.py) has a larger
        # error than the one that finer tubes would remove
        rays_per_wavelength2=testbed.TRUTH_RAYS_PER_WAVELENGTH2 if fine and case.motion not in ROVER else 1.0,
        coupled_rays_per_wavelength2=0.5 if fine else 1.0,  # docs/decisions/017-run-time-of-tables.md has the errors
        variant=config.simulator.variant,
    )
    place = _Place(_front_end(radar, case, gaps), nominal, gaps, settings)
    seed, root = seed_of(case, config), root_of(case, config)
    filtered = Hardware(board=case.draw).scaled(gaps.hardware).if_filter
    if_filter = None if filtered is None else asdict(filtered)
    provenance = {"kind": "testbed, clean", "if_filter": if_filter}
    creep = _creep(case, place, seed, root) if case.motion == "turntable" else None
    person = _person(case, place, seed, root)
    turning = _Turning(case, place, seed, root) if case.motion == "turntable" and nominal.frames > shadows(case.object) else None
    if turning is not None and nominal.frames > aspects(case.object, gaps):
        return Turned(turning.traced(), turning.angles(), radar, creep, person, provenance)
    iq = _moved(case, place, seed, root, shadow=turning is None)
    if turning is not None:
        iq += turning.shadow().at(turning.angles())
    if creep is not None:
        creep.add_to(iq)
    if person is not None:
        person.add_to(iq, radar)
    return Recording(iq, radar, None, provenance=provenance)


def _front_end(radar: Radar, case: Case, gaps: testbed.Gaps) -> Radar:
    """Return the radar with the line losses, the IF filter and the antennas of the board of a draw."""
    hardware = Hardware(board=case.draw).scaled(gaps.hardware)
    antennas = AntennaErrors(board=hardware.board).scaled(gaps.antenna) or radar.antenna_errors
    return replace(hardware.front_end(radar), antenna_errors=antennas)


@functools.cache
def aspects(target: str, gaps: testbed.Gaps) -> int:
    """Return the number of target angles (aspects) to trace per revolution; a recording with more frames is interpolated between them."""
    entry = every_object()[target]
    surfaces = entry.surfaces()
    tilt = np.radians(errors.TurntableErrors().wobble_deg) * gaps.trajectory
    height = max(float(s.mesh.bounds[1, 2]) for s in surfaces) + errors.TurntableErrors().pivot_m
    beyond = OFF_AXIS * float(np.hypot(errors.PlacementErrors().eccentric_m * gaps.placement, tilt * height))
    return needed(surfaces, beyond, entry.outline_m is not None, gaps.object_shape > 0)


def shadows(target: str) -> int:
    """Return the number of target angles per revolution at which to compute the target's shadow, if a recording has more frames."""
    return SHADOW_ASPECTS if every_object()[target].outline_m is None else SHADOW_ROUND


def receive(clean: Recording, case: Case, config: Config) -> Recording:
    """Add unscanned echoes, and the receiver effects (noise, leakage, ADC) of this repetition, to a clean recording."""
    gaps = gaps_of(config)
    if strength := config.measured.gap.unscanned_echoes:
        nominal, radar = log(case, config.profile.campaign, measured=True), _front_end(clean.radar, case, gaps)
        clean = unscanned.added(clean, radar, nominal.sensor_poses, nominal.distance_m, strength, root_of(case, config))
    return testbed.received(clean, Hardware(board=case.draw).scaled(gaps.hardware), seed_of(case, config))


@functools.lru_cache(maxsize=4)
def _target(name: str, gaps: testbed.Gaps, seed: int) -> Scene:
    """Return the true surfaces of an object in its own frame. All repetitions of a recording use the same object."""
    object_seed = int(np.random.SeedSequence([seed, *name.encode()]).generate_state(1)[0])
    made = as_made(every_object()[name], gaps.object_shape, np.random.default_rng(object_seed))
    return testbed.truth(Scene(made), gaps, object_seed, target=True)


def _around(case: Case, nominal: Log, gaps: testbed.Gaps, seed: int) -> Scene:
    """Return the surroundings of the target: the room, its clutter, and, for a radar at rest, the rig that holds the radar."""
    return _true_room(case.room, b"" if case.motion in ROVER else nominal.sensor_poses[0].tobytes(), _of_room(gaps), seed)


@functools.lru_cache(maxsize=4)
def _true_room(room: str, sensor: bytes, gaps: testbed.Gaps, seed: int) -> Scene:
    """Return the true room. For a radar at rest, `sensor` holds the bytes of its pose (4, 4); for a rover, `sensor` is empty."""
    scene = rooms.room(room, detail="cluttered")
    if sensor:
        scene = scene + fixtures.radar_rig(np.frombuffer(sensor).reshape(4, 4))
    return testbed.truth(scene, gaps, seed, _small(room))


def _of_room(gaps: testbed.Gaps) -> testbed.Gaps:
    """Return the strengths, with zero for gaps that change neither room nor stand. More recordings then share cached rooms and stands."""
    return replace(gaps, hardware=0.0, **dict.fromkeys(OF_TARGET, 0.0))


@functools.cache
def _small(room: str) -> frozenset[str]:
    """Return the names of the small objects (clutter) in a room."""
    full, bare = (rooms.room(room, detail=detail).names for detail in ("cluttered", "furnished"))
    return frozenset(full) - frozenset(bare)


def _below(case: Case, nominal: Log, gaps: testbed.Gaps, seed: int) -> tuple[list[Surface], list[Surface]]:
    """Return (disc, other parts) of the target's true stand, whose other parts on a turntable include a motor, a gear and a cable."""
    sensor = nominal.sensor_poses[0].tobytes() if case.motion == "turntable" else b""
    true = _true_stand(sensor, stand_top(nominal).tobytes(), _of_room(gaps), seed)
    return [s for s in true if s.name == "turntable"], [s for s in true if s.name != "turntable"]


@functools.lru_cache(maxsize=4)
def _true_stand(sensor: bytes, top: bytes, gaps: testbed.Gaps, seed: int) -> Scene:
    """Return the true stand whose top has the position with the bytes `top` (3,), with the parts of a turntable if `sensor` is given."""
    at = np.frombuffer(top)
    parts = rooms.support(at)
    if sensor:
        parts = parts + fixtures.target_rig(np.frombuffer(sensor).reshape(4, 4), at)
    return testbed.truth(parts, gaps, seed)


def _seen(case: Case, place: _Place, root: int, there: testbed.Actual, shadow: bool = True, coupled: bool = True) -> np.ndarray:
    """Simulate the received signal (F, C, T, R, N) of the whole scene at the actual poses of radar and target; `shadow` and `coupled` as in
    `seen`.
    """
    drives, radar = _drives(case, place, root), place.radar
    poses = there.motion[case.object]
    disc, apart = _below(case, place.log, place.gaps, root)
    aside = poses[0, :3, 3] - place.log.target_poses[0, :3, 3]
    if case.motion in ROVER:  # the placement error moves target and stand together
        off = poses[0] @ np.linalg.inv(place.log.target_poses[0])
        disc, apart = ([s.moved(off) for s in surfaces] for surfaces in (disc, apart))
    target = list(_target(case.object, place.gaps, root))
    if case.motion in RAIL:
        parts = on_carriage(drives, there.sensor_poses, target, poses, place.log.target_poses[0], disc, apart)
    else:
        parts = seen(drives, there.sensor_poses, radar.frame_rate_hz, target, poses, disc, apart, aside, shadow, coupled)
    iq = received(parts, radar, max(len(there.sensor_poses), len(poses)), elements="exact", oscillator=None)
    return iq + drives.room_samples(there.sensor_poses)


@dataclass(frozen=True, eq=False)
class _Turning:
    """Trace a turning target at chosen angles of its turntable instead of at each frame."""

    case: Case
    place: _Place
    seed: int
    root: int

    def traced(self) -> Aspects:
        """Return the radar signals at the traced target angles of a revolution."""
        short, count = replace(self.place, radar=replace(self.place.radar, num_chirps=1)), aspects(self.case.object, self.place.gaps)

        def direct(angles: np.ndarray) -> np.ndarray:
            there = testbed.Actual(self.place.log.sensor_poses, {self.case.object: self._poses(angles)})
            return _seen(self.case, short, self.root, there, shadow=False, coupled=False)[:, 0]

        over = functools.partial(_drives(self.case, self.place, self.root).moving, shadow=False, direct=False)
        coarse = self._target(over_room(count), over), self.shadow()
        return Aspects(Aspects.traced(direct, count).signals + sum(part.refined(count).signals for part in coarse))

    def shadow(self) -> Aspects:
        """Return the change of the radar signals by the target's shadow on the paths of the room."""
        return self._target(shadows(self.case.object), _drives(self.case, self.place, self.root).shadow)

    def _target(self, count: int, trace: Callable[..., list[Paths]]) -> Aspects:
        """Return the signals of the paths that `trace` finds, for the target's surfaces, the radar's pose and poses of the target."""
        target, radar = list(_target(self.case.object, self.place.gaps, self.root)), replace(self.place.radar, num_chirps=1)

        def chirp(angles: np.ndarray) -> np.ndarray:
            parts = trace(target, self.place.log.sensor_poses, self._poses(angles))
            return received(parts, radar, len(angles), elements="exact", oscillator=None)[:, 0]

        return Aspects.traced(chirp, count)

    def angles(self) -> np.ndarray:
        """Return the turntable's angle (F, C, T) in radians at each chirp."""
        nominal, (clock, table, _) = self.place.log, self._generators()
        times = Hardware().scaled(self.place.gaps.trajectory).frame_times(nominal.frames, nominal.frame_rate_hz, clock)
        assert nominal.angle_rad is not None
        speed = float(nominal.angle_rad[1] - nominal.angle_rad[0]) * nominal.frame_rate_hz
        angle = speed * (times[:, None, None] + self.place.radar.chirp_times()[None])
        more = errors.turntable_angles(angle[:, 0, 0], errors.TurntableErrors().scaled(self.place.gaps.trajectory), table)
        return angle + more[:, None, None]

    def _poses(self, angles: np.ndarray) -> np.ndarray:
        """Return the target's poses (A, 4, 4) at angles (A,) of the turntable, with the same wobble and placement error at every angle."""
        gaps, (_, table, placing) = self.place.gaps, self._generators()
        first = self.place.log.target_poses[:1]
        poses = np.repeat(first, len(angles), axis=0)
        poses[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix() @ first[0, :3, :3]
        wobbling = replace(errors.TurntableErrors().scaled(gaps.trajectory), start_deg=0.0, rate=0.0, ripple_deg=0.0)
        there = {self.case.object: errors.turntable(poses, wobbling, table)}
        return errors.placed(there, errors.PlacementErrors().scaled(gaps.placement), placing)[self.case.object]

    def _generators(self) -> tuple[np.random.Generator, np.random.Generator, np.random.Generator]:
        """Return new random generators for the errors of clock, turntable and placement."""
        clock, table, placing = (
            np.random.default_rng(np.random.SeedSequence([self.seed, *n])) for n in (b"clock", b"turntable", b"placement")
        )
        return clock, table, placing


def _creep(case: Case, place: _Place, seed: int, root: int) -> drift.Drift | None:
    """Return the slow drift of surroundings and stand while the turntable turns. All recordings in a room share the drift of the room."""
    creeps, nominal = drift.DriftErrors().scaled(place.gaps.clutter), place.log
    if not creeps.creep_m:
        return None
    around, small = list(_around(case, nominal, place.gaps, root)), _small(case.room)
    below = [s for s in _below(case, nominal, place.gaps, root)[1] if s.name in RUNNING]
    # Only the change of the signal is used, so three bounces are enough. The error is 0.09 of the root mean square of the change, and lies
    # at ranges beyond 5.2 m.
    settings = replace(place.settings, rays_per_wavelength2=1.0, max_bounces=min(3, place.settings.max_bounces))
    short, sensor = replace(place.radar, num_chirps=1), nominal.sensor_poses

    def room(state: float) -> np.ndarray:
        shifted = drift.shifted(around, small, state, creeps, root)
        return Track.of_drives(shifted, short, sensor, settings, searched=_drives(case, place, root).searched).room_samples(sensor)[0, 0]

    def room_states() -> np.ndarray:
        tally.count(tally.SETUPS)
        return drift.traced(room, creeps)

    def running() -> np.ndarray:
        states, parts = drift.nodes(creeps), []
        for surface in below:  # all states have the same tubes, in the surface's own frame
            poses = np.stack([drift.shift(surface.name, state, creeps, root) for state in states])
            parts += _drives(case, place, root).moving([surface], sensor, poses, False)
        return received(parts, short, len(states), elements="exact", oscillator=None)[:, 0]

    key = f"{case.room} {root} {_of_room(place.gaps)} {settings} {short}"
    states = _creeping.get(key, 1, room_states)
    key = f"{key} {stand_top(nominal).tobytes().hex()}"
    stand_states = _running.get(key, 1, running)
    times = np.arange(nominal.frames) / nominal.frame_rate_hz
    return drift.Drift(states + stand_states, drift.course(times, creeps, seed))


def _person(case: Case, place: _Place, seed: int, root: int) -> bystander.Echo | None:
    """Return the echo of the person who stands in the room during this recording."""
    strength, nominal = place.gaps.person, place.log
    if not strength:
        return None
    standing, swaying = (np.random.default_rng(np.random.SeedSequence([seed, *name])) for name in (b"person", b"sway"))
    room = _around(case, nominal, place.gaps, root)
    body = bystander.body().moved(bystander.place(room, nominal.sensor_poses, nominal.target_poses[0, :3, 3], standing))
    still = simulate(Scene([body]), place.radar, nominal.sensor_poses, variant=place.settings.variant, rays_per_wavelength2=PERSON_RAYS).iq
    if len(nominal.sensor_poses) == 1:
        still = still[:, :1]
    times = np.arange(nominal.frames) / nominal.frame_rate_hz
    return bystander.Echo(np.float32(strength) * still, bystander.sway(times, strength, swaying))


def _moved(case: Case, place: _Place, seed: int, root: int, shadow: bool = True) -> np.ndarray:
    """Trace every frame with target and radar at their actual poses. Returns the received signal (F, C, T, R, N)."""
    nominal = place.log
    there = testbed.actual(nominal.sensor_poses, {case.object: nominal.target_poses}, nominal.frame_rate_hz, place.gaps, seed)
    if case.motion != "turntable":
        iq = _seen(case, place, root, there, shadow)
        return iq + _carrier(place, root) if case.motion in ROVER else iq
    poses, signals = there.motion[case.object], []
    for block in np.array_split(np.arange(len(poses)), -(-len(poses) // BATCH)):
        following = poses[block[0] : block[-1] + 2]  # the motion in a frame follows from the next one
        signals.append(_seen(case, place, root, replace(there, motion={case.object: following}), shadow)[: len(block)])
    return np.concatenate(signals)


def _carrier(place: _Place, root: int) -> np.ndarray | float:
    """Simulate the echo of the rover's own body below the radar. The echo of the rover's body is equal in every frame."""
    body = testbed.truth(fixtures.rover(rooms.ROVER_HEIGHT_M), place.gaps, root)
    if not len(body):
        return 0.0
    settings = place.settings
    return simulate(
        body, place.radar, np.eye(4)[None], variant=settings.variant, max_bounces=settings.max_bounces,
        rays_per_wavelength2=settings.rays_per_wavelength2,
    ).iq  # fmt: skip


_creeping: Recent[np.ndarray] = Recent(1)  # the signals of the last room in the states of its drift
_running: Recent[np.ndarray] = Recent(1)  # the signals of the last stand's motor and gear in the states of their drift
_tracks: Recent[Track] = Recent(1)


def _drives(case: Case, place: _Place, root: int) -> Track:
    """Return the traced track (path of the radar in a room) of a case. The last one is cached, because several objects share a track."""
    motion = case.motion if case.motion in ROVER else "bench"
    radar = place.radar if case.motion in ROVER else replace(place.radar, num_chirps=1)  # all chirps of a resting radar are equal
    key = f"{case.room} {motion} {root} {_of_room(place.gaps)} {place.settings} {radar} {place.log.sensor_poses.tobytes().hex()}"

    def build() -> Track:
        tally.count(tally.SETUPS)
        around = list(_around(case, place.log, place.gaps, root))
        return Track.of_drives(around, radar, place.log.sensor_poses, place.settings, offset=0.5 if place.gaps.solver else 0.0)

    return _tracks.get(key, 1, build)
