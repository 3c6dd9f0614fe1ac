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
    fine = gaps.solver > 0
    hardware = Hardware().scaled(gaps.hardware)
    actual = hardware.radar(radar) if gaps.hardware > 0 else radar
    recording = simulate(
        scene, actual, sensor_pose, motion=moved, noise=gaps.hardware > 0, seed=seed, variant=variant,
        max_bounces=TRUTH_BOUNCES if fine else 4,
        rays_per_wavelength2=TRUTH_RAYS_PER_WAVELENGTH2 if fine else 1.0,
    )  # fmt: skip
    iq = hardware.apply(recording.iq, radar) if gaps.hardware > 0 else recording.iq
    scale = hardware.scale if gaps.hardware > 0 else None
    return Recording(iq, radar, recording.sensor_poses, scale=scale, provenance={"kind": "testbed", "seed": seed})


def _rethickened(surface: Surface, rng: np.random.Generator, strength: float) -> Surface:
    """Layers 5 % thicker or thinner than nominal, at strength 1."""
    if not isinstance(surface.material, Layered) or strength == 0:
        return surface
    factors = np.exp(strength * THICKNESS_SIGMA * rng.standard_normal(len(surface.material.layers)))
    layers = [(name, thickness * float(f)) for (name, thickness), f in zip(surface.material.layers, factors, strict=True)]
    return surface.replaced(material=Layered(layers, backing=surface.material.backing))


def _roughened(surface: Surface, strength: float) -> Surface:
    if strength == 0 or surface.roughness_m:
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
