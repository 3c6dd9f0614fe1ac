"""The virtual testbed: a measurement campaign that is deliberately not the twin.

Truth is the exact scene, its layered and rough materials, its clutter and its stand, solved more finely and with one bounce more than
the twin takes, through an imperfect radar, with the target not quite where the log says. It is not reality: tables scored against it
test the method and each named gap. It never sees the twin's scan, labels or settings. Every gap has a strength: 1 as committed, 0 off,
2 doubled.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from radartwin.materials import Layered
from radartwin.radar.chirp import Radar
from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation.simulate import simulate
from radartwin.simulation.synthesis import thermal_noise

# Root-mean-square heights: the paper's own calibration (implementation section), metal 0.1 mm and the smoothest of "0.3-3 mm" dielectrics.
ROUGHNESS_M = {"metal": 0.1e-3}
ROUGHNESS_OTHER_M = 0.3e-3
THICKNESS_SIGMA = 0.05  # relative spread of layer thickness; 12.5 mm board is sold to +-0.5 mm (EN 520, 4 %)
PLACEMENT_SIGMA_M = 0.005  # of the target on its turntable, each horizontal axis; a mark on tape is read to half a centimetre
RATE_SIGMA = 0.01  # relative error of the turntable's speed
TRUTH_RAYS_PER_WAVELENGTH2 = 4.0
TRUTH_BOUNCES = 5


@dataclass(frozen=True)
class Gaps:
    """Strengths of the testbed's gaps; the field names are those of the configuration's `measured.gap`."""

    materials: float = 1.0
    roughness: float = 1.0
    clutter: float = 1.0
    hardware: float = 1.0
    trajectory: float = 1.0
    solver: float = 1.0


def truth(scene: Scene, gaps: Gaps, seed: int, clutter: frozenset[str]) -> Scene:
    """The scene as it really is: layers of their own thickness, rough surfaces, clutter present or not."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, *b"testbed truth"]))
    surfaces = []
    for surface, child in zip(scene, rng.spawn(len(scene)), strict=True):
        if surface.name in clutter and gaps.clutter == 0:
            continue
        surfaces.append(_roughened(_rethickened(surface, child, gaps.materials), gaps.roughness))
    return Scene(surfaces, {**scene.provenance, "testbed": "truth"})


def record(
    scene: Scene,
    radar: Radar,
    sensor_pose: np.ndarray,
    motion: Mapping[str, np.ndarray],
    gaps: Gaps,
    seed: int,
    variant: str = "auto",
) -> Recording:
    """One recording of the truth, with its own placement, turntable and noise.

    Args:
        scene: from `truth`.
        motion: nominal object poses (F, 4, 4) by surface name; what a log would hold.
        seed: of this repetition.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, *b"testbed recording"]))
    moved = _misplaced(motion, gaps.trajectory, rng)
    return received(clean(scene, radar, sensor_pose, moved, gaps, variant), Hardware().scaled(gaps.hardware), seed)


def clean(
    scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None, gaps: Gaps, variant: str = "auto"
) -> Recording:
    """What an ideal receiver behind the IF filter would record: no noise, no leakage, nothing of one repetition alone.

    It depends on the hardware gap only in whether there is one, so one clean recording serves every strength, board and seed.

    Args:
        scene: from `truth`.
        sensor_poses, motion: where things really are (radartwin.measured.motion_errors), as in `simulate`.
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


def _rethickened(surface: Surface, rng: np.random.Generator, strength: float) -> Surface:
    """Layers 5 % thicker or thinner than nominal, at strength 1."""
    if not isinstance(surface.material, Layered) or strength == 0:
        return surface
    factors = np.exp(strength * THICKNESS_SIGMA * rng.standard_normal(len(surface.material.layers)))
    layers = [(name, thickness * float(f)) for (name, thickness), f in zip(surface.material.layers, factors, strict=True)]
    return surface.replaced(material=Layered(layers, backing=surface.material.backing))


def _roughened(surface: Surface, strength: float) -> Surface:
    """As rough as the testbed says, whatever the class of the surface says; at strength 0 as the scene has it."""
    if strength == 0:
        return surface
    height = ROUGHNESS_M.get(surface.material, ROUGHNESS_OTHER_M) if isinstance(surface.material, str) else ROUGHNESS_OTHER_M
    return surface.replaced(roughness_m=strength * height)


def _misplaced(motion: Mapping[str, np.ndarray], strength: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Everything on the turntable stands a little off, and what turns starts elsewhere and turns at its own speed."""
    offset = strength * PLACEMENT_SIGMA_M * np.append(rng.standard_normal(2), 0.0)
    start = strength * rng.uniform(0, 2 * np.pi)
    rate = strength * RATE_SIGMA * rng.standard_normal()
    out = {}
    for name, poses in motion.items():
        changed = poses.copy()
        if len(poses) > 1:
            angle = start + rate * np.linspace(0, 2 * np.pi, len(poses))
            turn = np.tile(np.eye(3), (len(poses), 1, 1))
            turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
            turn[:, 1, 0], turn[:, 0, 1] = np.sin(angle), -np.sin(angle)
            changed[:, :3, :3] = turn @ poses[:, :3, :3]
        changed[:, :3, 3] += offset
        out[name] = changed
    return out
