"""Test problems on which simulation methods are compared: scene, motion, and an exact or converged reference signal.

The problems are metal targets (`canonical`, `near`), an empty office (`empty room`), a turning box in an alcove (`object in room`) and a
drive through furnished metal rooms (`furnished drive`). Errors are computed with a single isotropic element, run times with the whole
array. The full-wave fields are those of two-dimensional scenes at every fourth sample; their conversion to three dimensions has a signal
error of 0.004, and they lack the waves from top and bottom edges (0.02 for the box).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np
import trimesh
from scipy.interpolate import BarycentricInterpolator

from experiments.validation.oracles import box, fullwave, furnished, furnished_motions, rooms, traced
from experiments.validation.oracles.furnished import box as box_strips
from experiments.validation.oracles.iterative_optics import corner_echoes
from experiments.validation.oracles.point_source import cylinder_echo, sphere_echo
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.simulate import simulate

RADAR = Radar.iwr1843()
TURN, DRIVE = 250, 50  # number of frames of a revolution, and of a drive
CANONICAL_M, NEAR_M = 1.0, 0.5  # distance of the targets in the test problems `canonical` and `near`
NODES = 9  # number of frequencies at which an echo is integrated; between them, a polynomial interpolates it without the path's phase
OFFICE, OFFICE_SENSOR = rooms.ROOMS["office"][1], np.array(rooms.ROOMS["office"][2])
EVERY = fullwave.EVERY
# The radar of the full-wave fields: every fourth sample of a chirp.
FULL_WAVE = replace(
    traced.MONOSTATIC, num_samples=traced.MONOSTATIC.num_samples // EVERY, sample_rate_hz=traced.MONOSTATIC.sample_rate_hz / EVERY
)
BOX_HALF_HEIGHT_M = 0.4  # a higher box would contain the radar in its bounding sphere, and would need millions of ray tubes
MOMENTS = "full-wave field, method of moments in two dimensions"


@dataclass(frozen=True)
class Part:
    """One recording of a test problem: its scene, its motion and its reference signal."""

    name: str
    scene: Scene  # scene, sensor and motion are arguments of `simulate`, for every frame that may be timed
    sensor: np.ndarray
    motion: Mapping[str, np.ndarray]
    scored: int  # number of frames, from the first, that are compared with the reference
    radar: Radar  # the radar of the comparison
    reference: Callable[[], np.ndarray]  # reference samples (scored, chirps, tx, rx, samples) for the radar `radar`

    def iq(self, frames: int, radar: Radar, simulator: object, elements: str = "exact", aside_m: float = 0.0) -> np.ndarray:
        """Simulate the first `frames` frames and return their samples. `aside_m` shifts the radar in metres to avoid cached paths."""
        sensor = self.sensor[: frames if len(self.sensor) > 1 else 1].copy()
        sensor[:, 1, 3] += aside_m
        motion = {name: poses[:frames] for name, poses in self.motion.items()}
        return simulate(self.scene, radar, sensor, motion=motion, simulator=simulator, elements=elements).iq  # type: ignore[arg-type]


@dataclass(frozen=True)
class Problem:
    """One test problem: a group of recordings whose errors are averaged."""

    name: str
    title: str
    truth: str  # description of the reference
    parts: Sequence[Part]
    frames: int  # number of frames of a whole recording
    resting: bool  # the radar does not move, so a room is traced once for all frames
    room: bool  # the scene has a room
    cache: dict[str, np.ndarray] = field(default_factory=dict)

    def reference(self, part: Part) -> np.ndarray:
        """Return the reference samples of a recording. The reference samples are computed at the first call and then kept."""
        if part.name not in self.cache:
            self.cache[part.name] = part.reference()
        return self.cache[part.name]


def swept(echo: Callable[[np.ndarray], np.ndarray], distance_m: float) -> np.ndarray:
    """Return samples (..., 1, 1, 1, samples) of an echo, a function of frequencies (F,) to (F, ...), at about `distance_m`."""
    frequencies = traced.frequencies(traced.MONOSTATIC)
    middle, half = frequencies.mean(), (frequencies[-1] - frequencies[0]) / 2
    nodes = middle + half * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)

    def phasor(f: np.ndarray) -> np.ndarray:
        return np.exp(4j * np.pi * f / SPEED_OF_LIGHT * distance_m)

    smooth = BarycentricInterpolator(nodes, echo(nodes).T / phasor(nodes), axis=-1)
    return (np.asarray(smooth(frequencies)) * phasor(frequencies))[..., None, None, None, :]


def corner_echo(shape: str, size_m: float, poses: np.ndarray) -> np.ndarray:
    """Return the reference samples of a plate or upright trihedral at poses (S, 4, 4), seen by an antenna at the origin."""
    here = -np.einsum("sji,sj->si", poses[:, :3, :3], poses[:, :3, 3])
    return swept(
        lambda f: np.stack([corner_echoes(shape, size_m, here, SPEED_OF_LIGHT / frequency) for frequency in f]),
        float(np.linalg.norm(poses[0, :3, 3])),
    )


def same_echo(echo: Callable[[np.ndarray], np.ndarray], poses: np.ndarray) -> np.ndarray:
    """Return the reference samples of a body of revolution at CANONICAL_M, which are the same at all poses (S, 4, 4)."""
    return np.repeat(swept(echo, CANONICAL_M)[None], len(poses), axis=0)


def turntable_poses(distance_m: float, frames: int, start_deg: float) -> np.ndarray:
    """Return the poses (F, 4, 4) of an object on a turntable whose axis is `distance_m` in front of the radar."""
    return trajectory.turntable([distance_m, 0, 0], frames, RADAR.frame_rate_hz, 25.0, np.pi + np.radians(start_deg))


@cache
def canonical(frames: int, scored: int) -> Problem:
    """Return the problem of four metal targets: a plate and a trihedral that turn, and a sphere and a cylinder."""
    poses = {name: turntable_poses(CANONICAL_M, frames, start_deg) for name, start_deg in (("plate", 0.0), ("trihedral", 5.0))}
    sphere, cylinder = partial(sphere_echo, 0.033, CANONICAL_M), partial(cylinder_echo, 0.033, 0.12, CANONICAL_M)
    parts = [
        _part("plate", objects.plate(0.1, 0.1), poses["plate"], scored, partial(corner_echo, "plate", 0.1)),
        _part("trihedral", objects.trihedral(0.1), poses["trihedral"], scored, partial(corner_echo, "trihedral", 0.1)),
        _part("sphere", objects.sphere(0.033, 4), poses["plate"], scored, partial(same_echo, sphere)),
        _part("cylinder", objects.cylinder(0.033, 0.12, 64), poses["plate"], scored, partial(same_echo, cylinder)),
    ]
    truth = "near-field quadrature (plate), iterative physical optics (trihedral); series (sphere, cylinder)"
    return Problem("canonical", f"canonical targets at {CANONICAL_M:g} m", truth, parts, TURN, True, False)


@cache
def near(frames: int, scored: int) -> Problem:
    """Return the test problem of a large metal trihedral in the near field of the radar."""
    poses, echo = turntable_poses(NEAR_M, frames, 5.0), partial(corner_echo, "trihedral", 0.15)
    part = _part("trihedral 15 cm", objects.trihedral(0.15), poses, scored, echo)
    title = f"15 cm reflector in the near field, {NEAR_M:g} m"
    return Problem("near", title, "iterative physical optics", [part], TURN, True, False)


def _part(name: str, mesh: trimesh.Trimesh, poses: np.ndarray, scored: int, echo: Callable[[np.ndarray], np.ndarray]) -> Part:
    """Return the recording of a metal target alone. `echo` gives its reference samples (S, 1, 1, 1, samples) at poses (S, 4, 4)."""
    scene = Scene([Surface(mesh, "metal", "target", role="object")])
    return Part(name, scene, np.eye(4)[None], {"target": poses}, scored, traced.MONOSTATIC, lambda: echo(poses[:scored]))


@cache
def empty_room(frames: int, scored: int, bounces: int = 4) -> Problem:
    """Return the problem of an empty office with a radar that moves 2 cm per frame, tilted so that no image lies on its axis."""
    poses = np.stack([traced.pose(OFFICE_SENSOR + np.array([0.02 * n, 0, 0]), rooms.rotation()) for n in range(frames)])
    part = Part(
        "office", rooms.room_scene(OFFICE, "concrete"), poses, {}, scored, traced.MONOSTATIC,
        lambda: np.stack([office_images(pose, bounces) for pose in poses[:scored]]),
    )  # fmt: skip
    truth = f"all image sources of up to {bounces} bounces"
    return Problem("empty room", "bare concrete office, moving radar", truth, [part], DRIVE, False, True)


def office_images(pose: np.ndarray, bounces: int = 4) -> np.ndarray:
    """Return the reference samples (1, 1, 1, samples) of the empty office, as the sum of its image sources."""
    reflection = rooms.wall_reflection("concrete")
    frequencies = traced.frequencies(traced.MONOSTATIC)
    return box.image_sum(np.array(OFFICE), pose[:3, 3], pose[:3, 2], reflection, bounces, frequencies)[None, None, None]


@cache
def object_in_room(frames: int, scored: int) -> Problem:
    """Return the test problem of a metal box that turns before a metal alcove."""
    turned = Surface(fullwave.extruded(box_strips(*furnished_motions.BOX_M), BOX_HALF_HEIGHT_M), "metal", "box", role="object")
    walls = [Surface(fullwave.extruded(lines), "metal", part, role="room") for part, lines in furnished_motions.walls().items()]
    motion = {"box": furnished_motions.turning(frames)}
    part = Part("box", Scene([*walls, turned]), np.eye(4)[None], motion, scored, FULL_WAVE, partial(full_wave, "box", scored))
    return Problem("object in room", "turning box in a metal alcove", MOMENTS, [part], TURN, True, True)


@cache
def furnished_drive(frames: int, scored: int) -> Problem:
    """Return the test problem of a radar that drives through furnished metal rooms."""
    poses = furnished_motions.drive(frames)
    parts = [
        Part(name, fullwave.scene(furnished.ROOMS, name), poses, {}, scored, FULL_WAVE, partial(full_wave, name, scored))
        for name in furnished_motions.DRIVEN
    ]
    return Problem("furnished drive", "drive through furnished metal rooms", MOMENTS, parts, DRIVE, False, True)


def full_wave(recording: str, scored: int) -> np.ndarray:
    """Return the reference samples (scored, 1, 1, 1, samples) of a recording from its stored full-wave fields."""
    names = [furnished_motions.name(recording, frame) for frame in range(scored)]
    return np.stack([fullwave.to_points(*fullwave.field(furnished_motions.FOLDER, name)) for name in names])[:, None, None, None]


def problems(full: bool) -> tuple[Problem, ...]:
    """Return all test problems in the order of the chart. If `full` is true, they have more frames for run times and errors."""
    turning, driven, exact, room = (30, 25, 11, 3) if full else (16, 6, 2, 2)
    return (
        canonical(turning, exact), near(turning, exact), empty_room(driven, room), object_in_room(turning, room),
        furnished_drive(driven, room),
    )  # fmt: skip
