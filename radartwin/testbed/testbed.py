"""The virtual testbed: a measurement campaign that differs from the twin on purpose.

The truth is the exact scene with its own materials, roughness and contents (radartwin.testbed.variation), its clutter and its equipment
(radartwin.testbed.fixtures). It is simulated with more rays and one bounce more than the twin, through an imperfect radar
(radartwin.radar.hardware), and rover, turntable and target deviate from the log (radartwin.testbed.motion_errors). The testbed is not
reality: tables scored against it test the method and each named gap. It never uses the twin's scan, labels or settings. Every gap has a
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

CLUTTER_SHIFT_M = 0.02  # standard deviation of small objects since the scan, along x and y; an order of magnitude for a room in use
TRUTH_RAYS_PER_WAVELENGTH2 = 4.0
TRUTH_BOUNCES = 5


@dataclass(frozen=True)
class Gaps:
    """Strengths of the testbed's gaps; the field names are those of the configuration's `measured.gap`.

    Attributes:
        materials: thickness and permittivity of layers.
        roughness: roughness heights.
        clutter: presence and position of small objects and equipment that the scan does not contain; below 1 some are missing.
        hardware: imperfections of the radar.
        trajectory: motion of rover, rail and turntable, and frame times.
        solver: finer simulation, on or off.
        placement: position of the target.
        contents: contents of vessels.
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
    """The true scene.

    Args:
        scene: with all clutter and equipment, and nominal materials and roughness.
        seed: of the campaign. A surface with the same name and the same room (provenance) is equal in all its recordings.
        clutter: names of surfaces that a scan does not contain; surfaces of radartwin.testbed.fixtures are marked by their provenance.
    """
    surfaces, room = [], str(scene.provenance.get("room", ""))
    repeats: Counter[str] = Counter()
    for surface in scene:
        own = np.random.SeedSequence([seed, *b"testbed truth", *room.encode(), 0, *surface.name.encode(), repeats[surface.name]])
        repeats[surface.name] += 1
        rng, presence, shift = (np.random.default_rng(s) for s in own.spawn(3))
        if surface.name in clutter or surface.provenance.get("fixture"):
            if presence.random() >= gaps.clutter:
                continue
            if surface.name in clutter:
                surface = surface.moved(pose(gaps.clutter * CLUTTER_SHIFT_M * np.append(shift.standard_normal(2), 0.0)))
        rough = own_roughness(own_material(surface, gaps.materials, rng), gaps.roughness, rng)
        surfaces += own_contents(rough, gaps.contents, rng)
    return Scene(surfaces, {**scene.provenance, "testbed": "truth"})


@dataclass(frozen=True)
class Actual:
    """True poses at the frames of one recording: of the sensor, (F, 4, 4) or (1, 4, 4), and of objects by name."""

    sensor_poses: np.ndarray
    motion: dict[str, np.ndarray]


def actual(sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray], rate_hz: float, gaps: Gaps, seed: int) -> Actual:
    """The true poses for the nominal poses of one recording.

    A moving sensor is on a rover. A rotating object is on a turntable, and an object that moves without rotating is on a rail. Objects at
    rest only have placement errors.

    Args:
        sensor_poses: nominal, (F, 4, 4), (1, 4, 4) or (4, 4).
        motion: nominal poses (F, 4, 4) or (1, 4, 4) by name.
        rate_hz: frame rate.
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
        # All moving objects share one turntable and one carriage.
        table.bit_generator.state, carriage.bit_generator.state = table_state, carriage_state
        if len(poses) > 1:
            at_frames = errors.at_times(poses, rate_hz, times)
            if errors.turns(poses):
                poses = errors.turntable(at_frames, errors.TurntableErrors().scaled(strength), table)
            else:
                poses = errors.rail(at_frames, errors.RailErrors().scaled(strength), carriage)
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
    """One recording of the truth, with its own motion errors, placement and noise, and the nominal poses of the log.

    Args:
        scene: from `truth`.
        sensor_poses, motion: nominal, as for `actual`.
        seed: of this repetition.
    """
    true = actual(sensor_poses, motion, radar.frame_rate_hz, gaps, seed)
    recording = clean(scene, radar, true.sensor_poses, true.motion, gaps, variant)
    out = received(recording, Hardware().scaled(gaps.hardware), seed)
    logged = np.asarray(sensor_poses, float).reshape(-1, 4, 4)
    out.sensor_poses = np.repeat(logged, len(out.iq), axis=0) if len(logged) == 1 else logged
    return out


def clean(
    scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None, gaps: Gaps, variant: str = "auto"
) -> Recording:
    """The recording of an ideal receiver behind the IF filter, without noise, leakage and other effects of a single repetition.

    It depends on the hardware gap only through the presence of the filter, so one clean recording serves all strengths above 0, all boards
    and all seeds.

    Args:
        scene: from `truth`.
        sensor_poses, motion: true poses, as in `simulate`.
    Returns:
        A Recording of the nominal radar; its provenance describes the filter.
    """
    fine = gaps.solver > 0
    hardware = Hardware().scaled(gaps.hardware)
    recording = simulate(
        scene, hardware.front_end(radar), sensor_poses, motion=motion, variant=variant,
        max_bounces=TRUTH_BOUNCES if fine else 4,
        rays_per_wavelength2=TRUTH_RAYS_PER_WAVELENGTH2 if fine else 1.0,
    )  # fmt: skip
    if_filter = None if hardware.if_filter is None else hardware.if_filter.to_dict()
    return Recording(recording.iq, radar, recording.sensor_poses, provenance={"kind": "testbed, clean", "if_filter": if_filter})


def received(recording: Recording, hardware: Hardware, seed: int, first_frame: int = 0) -> Recording:
    """Apply phase noise, leakage, thermal noise and the ADC of one repetition to a clean recording.

    Each frame has its own random generator from the seed and the frame's number, so a part of the frames gives the same samples as the
    whole recording.

    Args:
        recording: from `clean`, or some of its frames.
        hardware: at strength 0 the samples stay unchanged, also without noise.
        seed: of the repetition.
        first_frame: number of the first frame in the whole recording.
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
