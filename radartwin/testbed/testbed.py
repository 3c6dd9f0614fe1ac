"""The virtual testbed: a measurement campaign that is deliberately not the twin.

Truth is the exact scene, with materials, roughness and contents of its own (radartwin.testbed.variation), its clutter and its fixtures
(radartwin.testbed.fixtures), solved more finely and with one bounce more than the twin takes, through an imperfect radar
(radartwin.radar.hardware), with rover, turntable and target not quite where the log says (radartwin.testbed.motion_errors). It is not
reality: tables scored against it test the method and each named gap. It never sees the twin's scan, labels or settings. Every gap has a
strength: 1 as committed, 0 off, 2 doubled.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from radartwin.radar.chirp import Radar
from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import pose
from radartwin.simulation.signal.synthesis import thermal_noise
from radartwin.simulation.simulate import simulate
from radartwin.testbed import motion_errors as errors
from radartwin.testbed.variation import own_contents, own_material, own_roughness

CLUTTER_SHIFT_M = 0.02  # of each small thing since the scan, each level axis: somebody worked in the room; an order of magnitude
TRUTH_RAYS_PER_WAVELENGTH2 = 4.0
TRUTH_BOUNCES = 5


@dataclass(frozen=True)
class Gaps:
    """Strengths of the testbed's gaps; the field names are those of the configuration's `measured.gap`.

    Attributes:
        materials: thickness and permittivity of layers. roughness: heights. clutter: small things and fixtures that the scan has not, and
            where they stand; below 1 some are missing. hardware: the radar. trajectory: rover, turntable, times of frames. solver: on or
            off. placement: of the target. contents: of vessels.
    """

    materials: float = 1.0
    roughness: float = 1.0
    clutter: float = 1.0
    hardware: float = 1.0
    trajectory: float = 1.0
    solver: float = 1.0
    placement: float = 1.0
    contents: float = 1.0


OFF = Gaps(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def truth(scene: Scene, gaps: Gaps, seed: int, clutter: Collection[str] = ()) -> Scene:
    """The scene as it really is.

    Args:
        scene: with all its clutter and fixtures, materials and roughness as they nominally are.
        seed: of the campaign; what has the same name in the same room (provenance) is the same in all its recordings.
        clutter: names that a scan does not have; surfaces of radartwin.testbed.fixtures are known by their provenance.
    """
    surfaces, room = [], str(scene.provenance.get("room", ""))
    before: Counter[str] = Counter()
    for surface in scene:
        own = np.random.SeedSequence([seed, *b"testbed truth", *room.encode(), 0, *surface.name.encode(), before[surface.name]])
        before[surface.name] += 1
        rng, stays, shift = (np.random.default_rng(s) for s in own.spawn(3))
        if surface.name in clutter or surface.provenance.get("fixture"):
            if stays.random() >= gaps.clutter:
                continue
            if surface.name in clutter:
                surface = surface.moved(pose(gaps.clutter * CLUTTER_SHIFT_M * np.append(shift.standard_normal(2), 0.0)))
        rough = own_roughness(own_material(surface, gaps.materials, rng), gaps.roughness, rng)
        surfaces += own_contents(rough, gaps.contents, rng)
    return Scene(surfaces, {**scene.provenance, "testbed": "truth"})


@dataclass(frozen=True)
class Actual:
    """Where things really are at the frames of one recording: sensor poses (F, 4, 4) or (1, 4, 4), object poses by name."""

    sensor_poses: np.ndarray
    motion: dict[str, np.ndarray]


def actual(sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray], rate_hz: float, gaps: Gaps, seed: int) -> Actual:
    """From the log of one recording to where its sensor and objects were.

    A sensor that moves is a rover's, an object that turns stands on a table, one that moves without turning on a rail's carriage; what
    rests was put where it is.

    Args:
        sensor_poses: nominal, (F, 4, 4), (1, 4, 4) or (4, 4). motion: nominal poses (F, 4, 4) or (1, 4, 4) by name.
        rate_hz: of the frames.
        seed: of this repetition.
    """
    sensor = np.asarray(sensor_poses, float).reshape(-1, 4, 4)
    clock, wheels, table, carriage, placing = (
        np.random.default_rng(np.random.SeedSequence([seed, *name])) for name in (b"clock", b"rover", b"turntable", b"rail", b"placement")
    )
    frames = max([len(sensor), *(len(poses) for poses in motion.values())])
    times = Hardware().scaled(gaps.trajectory).frame_times(frames, rate_hz, clock)
    strength = gaps.trajectory
    table_state, carriage_state = table.bit_generator.state, carriage.bit_generator.state
    moved = {}
    for name, poses in motion.items():
        table.bit_generator.state, carriage.bit_generator.state = table_state, carriage_state  # all that moves is on one table or carriage
        if len(poses) > 1:
            there = errors.at_times(poses, rate_hz, times)
            if errors.turns(poses):
                poses = errors.turntable(there, errors.TurntableErrors().scaled(strength), table)
            else:
                poses = errors.rail(there, errors.RailErrors().scaled(strength), carriage)
        moved[name] = poses
    if len(sensor) > 1:
        sensor = errors.rover(errors.at_times(sensor, rate_hz, times), errors.RoverErrors().scaled(gaps.trajectory), wheels)
    return Actual(sensor, errors.placed(moved, errors.PlacementErrors().scaled(gaps.placement), placing))


def record(
    scene: Scene,
    radar: Radar,
    sensor_poses: np.ndarray,
    motion: Mapping[str, np.ndarray],
    gaps: Gaps,
    seed: int,
    variant: str = "auto",
) -> Recording:
    """One recording of the truth, with its own course, placement and noise; its poses are the log's.

    Args:
        scene: from `truth`.
        sensor_poses, motion: nominal, as for `actual`; what a log holds.
        seed: of this repetition.
    """
    there = actual(sensor_poses, motion, radar.frame_rate_hz, gaps, seed)
    recording = clean(scene, radar, there.sensor_poses, there.motion, gaps, variant)
    out = received(recording, Hardware().scaled(gaps.hardware), seed)
    logged = np.asarray(sensor_poses, float).reshape(-1, 4, 4)
    out.sensor_poses = np.repeat(logged, len(out.iq), axis=0) if len(logged) == 1 else logged
    return out


def clean(
    scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None, gaps: Gaps, variant: str = "auto"
) -> Recording:
    """What an ideal receiver behind the IF filter would record: no noise, no leakage, nothing of one repetition alone.

    It depends on the hardware gap only in whether there is one, so one clean recording serves every strength, board and seed.

    Args:
        scene: from `truth`.
        sensor_poses, motion: where things really are (radartwin.testbed.motion_errors), as in `simulate`.
    Returns:
        A Recording of the nominal radar; its provenance names the filter.
    """
    fine = gaps.solver > 0
    hardware = Hardware().scaled(gaps.hardware)
    recording = simulate(
        scene, hardware.front_end(radar), sensor_poses, motion=motion, variant=variant,
        max_bounces=TRUTH_BOUNCES if fine else 4,
        rays_per_wavelength2=TRUTH_RAYS_PER_WAVELENGTH2 if fine else 1.0,
    )  # fmt: skip
    passes = None if hardware.if_filter is None else hardware.if_filter.to_dict()
    return Recording(recording.iq, radar, recording.sensor_poses, provenance={"kind": "testbed, clean", "if_filter": passes})


def received(recording: Recording, hardware: Hardware, seed: int, first_frame: int = 0) -> Recording:
    """A clean recording as one repetition with this hardware gives it: phase noise, leakage, thermal noise, ADC.

    Every frame has its own random numbers, from the seed and its place in the recording: some of the frames are received alike alone.

    Args:
        recording: from `clean`, or frames out of it.
        hardware: without any imperfection (strength 0) there is no noise either, and the samples stay as they are.
        seed: of the repetition.
        first_frame: place of the first frame in the whole recording.
    """
    radar = recording.radar
    provenance = {"kind": "testbed", "seed": seed}
    if hardware == hardware.scaled(0):
        return Recording(recording.iq, radar, recording.sensor_poses, provenance=provenance)
    iq, saturated = np.empty_like(recording.iq), 0
    for frame in range(len(iq)):
        oscillator, receiver = (
            np.random.default_rng(np.random.SeedSequence([seed, *name, first_frame + frame]))
            for name in (b"oscillator noise", b"receiver noise")
        )
        samples = hardware.leaked(hardware.echoes(recording.iq[frame : frame + 1], radar, oscillator), radar)
        samples += thermal_noise(samples.shape, radar, receiver)
        if radar.real_sampling:
            samples.imag = 0
        iq[frame : frame + 1], clipped = hardware.digitised(samples, radar)
        saturated += clipped
    return Recording(iq, radar, recording.sensor_poses, scale=hardware.scale, saturated=saturated, provenance=provenance)
