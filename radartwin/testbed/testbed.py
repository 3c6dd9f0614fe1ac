"""The virtual testbed: a virtual measurement campaign that differs on purpose from the simulation it is compared with.

The scene that the testbed measures is called the true scene; it has the exact geometry. The materials, roughness and contents of the true
scene deviate from the nominal values (radartwin.testbed.variation). The true scene also contains clutter and measurement equipment
(radartwin.testbed.fixtures). The testbed traces more rays and one more reflection order than the simulation it is compared with. An
imperfect radar (radartwin.radar.hardware) records the result with antennas that deviate from the nominal pattern
(radartwin.radar.antenna_errors). Rover, turntable and target deviate from their logged poses (radartwin.testbed.motion_errors).

Each kind of difference between the testbed and the simulation of the scanned room is called a gap. A gap has a strength: 0 removes the
difference, 1 is the default size, 2 doubles the default size. The testbed is not reality, so a table computed with it only tests the method
and shows the effect of each known difference. The testbed never uses the scan, the material labels or the simulator settings of the
simulation it is compared with.
"""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import pose
from radartwin.simulation.signal.synthesis import thermal_noise
from radartwin.testbed import motion_errors as errors
from radartwin.testbed.variation import vary_contents, vary_material, vary_roughness

CLUTTER_SHIFT_M = 0.02  # shift of small objects since the scan: standard deviation along x and along y, in metres; order of magnitude
TRUTH_RAYS_PER_WAVELENGTH2 = 4.0
TRUTH_BOUNCES = 5


@dataclass(frozen=True)
class Gaps:
    """Strengths of the known differences between the testbed and the simulation of the scanned room, called gaps; 1 is the default size.

    The configuration's `measured.gap` has the same field names.

    Attributes:
        materials: strength of the deviations of layer thickness and permittivity of everything but the target.
        roughness: strength of the deviations of the roughness heights of surfaces.
        clutter: strength of the difference in small objects and equipment, which the scan lacks; below 1, some of these objects are also
            missing in the testbed.
        hardware: strength of the imperfections of the radar.
        trajectory: strength of the motion errors of rover, rail and turntable, and of errors of the frame times.
        solver: above 0, the testbed traces more rays and one more reflection order than the simulation of the scanned room.
        placement: strength of the errors of the target's position and yaw.
        contents: strength of the deviations of the contents of vessels.
        object_shape: strength of the deviations of the target's shape from its drawing.
        object_material: strength of the deviations of wall thickness and permittivity of the target.
        antenna: strength of side lobes, back lobe and ripples of the antennas, which the nominal pattern lacks.
        person: amplitude of the echo, and of the sway, of a person who stands in the room.
    """

    materials: float = 1.0
    roughness: float = 1.0
    clutter: float = 1.0
    hardware: float = 1.0
    trajectory: float = 1.0
    solver: float = 1.0
    placement: float = 1.0
    contents: float = 1.0
    object_shape: float = 1.0
    object_material: float = 1.0
    person: float = 1.0
    antenna: float = 1.0


def truth(scene: Scene, gaps: Gaps, seed: int, clutter: Collection[str] = (), target: bool = False) -> Scene:
    """Return the true scene that the testbed measures: the given scene with deviating materials, roughness, contents and clutter.

    Args:
        scene: the scene with all clutter and equipment, and nominal materials and roughness.
        seed: seed of the virtual measurement campaign. A surface with a given name and room (from the scene's provenance) is equal in
            all recordings of the campaign.
        clutter: names of surfaces that a scan does not contain; surfaces of radartwin.testbed.fixtures need no entry, because their
            provenance marks them.
        target: whether the scene is the target, whose walls deviate by the gap `object_material` instead of `materials`.
    """
    surfaces, room = [], str(scene.provenance.get("room", ""))
    repeats: Counter[str] = Counter()
    for surface in scene:
        seeds = np.random.SeedSequence([seed, *b"testbed truth", *room.encode(), 0, *surface.name.encode(), repeats[surface.name]])
        repeats[surface.name] += 1
        rng, presence, shift = (np.random.default_rng(s) for s in seeds.spawn(3))
        if surface.name in clutter or surface.provenance.get("fixture"):
            if presence.random() >= gaps.clutter:
                continue
            if surface.name in clutter:
                surface = surface.moved(pose(gaps.clutter * CLUTTER_SHIFT_M * np.append(shift.standard_normal(2), 0.0)))
        varied = vary_material(surface, gaps.object_material if target else gaps.materials, rng)
        rough = vary_roughness(varied, gaps.roughness, rng)
        surfaces += vary_contents(rough, gaps.contents, rng)
    return Scene(surfaces, {**scene.provenance, "testbed": "truth"})


@dataclass(frozen=True)
class Actual:
    """True poses at the frames of one recording: poses of the sensor, (F, 4, 4) or (1, 4, 4), and poses of the objects, by object name."""

    sensor_poses: np.ndarray
    motion: dict[str, np.ndarray]


def actual(sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray], rate_hz: float, gaps: Gaps, seed: int) -> Actual:
    """Draw the true poses of one recording from its nominal poses.

    A moving sensor is assumed to be on a rover. A rotating object is assumed to be on a turntable, and an object that moves without
    rotating is assumed to be on a rail. Objects at rest only have placement errors.

    Args:
        sensor_poses: nominal poses of the sensor, (F, 4, 4), (1, 4, 4) or (4, 4).
        motion: nominal poses of objects by object name, each (F, 4, 4) or (1, 4, 4).
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
        # All rotating objects share one turntable, and all objects that move without rotating share one carriage.
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


def received(recording: Recording, hardware: Hardware, seed: int) -> Recording:
    """Add the radar's phase noise, leakage, thermal noise and ADC to a recording that so far contains only the radar's IF filter.

    Args:
        recording: recording of an ideal receiver, see `Hardware.front_end`.
        hardware: imperfections of the radar; at strength 0 the samples stay unchanged, without any noise.
        seed: seed of this repetition of the recording. The random numbers of each frame depend only on this seed and the frame number.
    """
    radar = recording.radar
    provenance = {"kind": "testbed", "seed": seed}
    if hardware == hardware.scaled(0):
        return Recording(recording.iq, radar, recording.sensor_poses, provenance=provenance)
    iq, saturated = np.empty_like(recording.iq), 0
    for frame in range(len(iq)):
        oscillator, receiver = (
            np.random.default_rng(np.random.SeedSequence([seed, *name, frame])) for name in (b"oscillator noise", b"receiver noise")
        )
        samples = hardware.leaked(hardware.echoes(recording.iq[frame : frame + 1], radar, oscillator), radar)
        samples += thermal_noise(samples.shape, hardware.front_end(radar), receiver)
        if radar.real_sampling:
            samples.imag = 0
        iq[frame : frame + 1], clipped = hardware.digitised(samples, radar)
        saturated += clipped
    return Recording(iq, radar, recording.sensor_poses, scale=hardware.scale, saturated=saturated, provenance=provenance)
