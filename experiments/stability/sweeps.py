"""Sweeps that show where simulation methods fail, towards harder scenes, coarser settings, worse descriptions of the scene or more noise.

The true signal of each value is known: the mean power of a frame for a single object (closed forms, series, quadrature), and range profiles
in a room (`signal_error`). An error is at most DYNAMIC_DB, which is also that of a method without a signal. Methods without an absolute
level get the gain that makes their level of a metal sphere at 1 m correct.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import trimesh

from experiments.speed.methods import POINTS, RFGENESIS, SIONNA, Method, tracer
from experiments.speed.problems import OFFICE, OFFICE_SENSOR, office_images
from experiments.validation.oracles import fullwave, furnished_sweeps, rooms, stack, traced
from experiments.validation.oracles.iterative_optics import corner_echoes
from experiments.validation.oracles.point_source import cylinder_echo, sphere_echo
from radartwin.benchmark.signal_error import DYNAMIC_DB, compare
from radartwin.materials import Layered
from radartwin.radar.chirp import Radar
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends import rfgenesis
from radartwin.simulation.backends.backend import Backend, backend
from radartwin.simulation.backends.sionna_scene import quiet
from radartwin.simulation.simulate import simulate

RADAR = traced.MONOSTATIC
MIDDLE_HZ = RADAR.center_frequency_hz
WAVELENGTH_M = stack.SPEED_OF_LIGHT / MIDDLE_HZ
BALL_M = 0.05
BOARD_M = 0.0125
DRAWS = 64
METHODS = (
    tracer("default"),
    Method(POINTS, "far-field table", "points"),
    Method(RFGENESIS, "shipped", "rfgenesis"),
    Method(RFGENESIS, "corrected", "rfgenesis", (("version", "corrected"),)),
    Method(SIONNA, "3 cm apart", "sionna", (("separation_m", 0.03),)),
)


@dataclass(frozen=True)
class Sweep:
    """One sweep: a series of values of a scene property or setting, from easy to hard. Each sweep is one block of rows in the figure."""

    name: str
    title: str
    unit: str
    kind: str  # cause of the failure: "physical", "numerical", "a setting" or "knowledge" (of the scene)
    values: tuple[float, ...]  # values of the sweep, easiest first
    error_db: Callable[[Method, float], float]  # function (method, value) -> error in dB
    why: str  # reason of the failure, one sentence


def samples(method: Method, scene: Scene, pose: np.ndarray | None = None, motion: Any = None, **settings: Any) -> np.ndarray:
    """Simulate one frame with a method and simulator settings. Raises FloatingPointError if a sample is not finite."""
    simulator = backend(method.backend, **(dict(method.settings) | settings))
    with quiet():
        iq = simulate(scene, RADAR, np.eye(4)[None] if pose is None else pose[None], motion=motion, simulator=simulator).iq
    if not np.isfinite(iq).all():
        raise FloatingPointError(f"{method.name} returned samples that are not finite")
    return iq


def level_db(iq: np.ndarray) -> float:
    """Return the mean power of a frame's samples in dB. For a single echo, this power is the level of the echo."""
    return float(10 * np.log10(np.mean(np.abs(iq) ** 2) + 1e-30))


@cache
def gain_db(method: Method) -> float:
    """Return the gain in dB that makes a method's level of a metal sphere at 1 m correct; 0 for methods with an absolute level."""
    if method.backend != "rfgenesis":
        return 0.0
    return 20 * np.log10(abs(sphere_echo(BALL_M, 1.0, MIDDLE_HZ)[0])) - level_db(samples(method, *alone(objects.sphere(BALL_M, 4), 1.0)))


def off(method: Method, iq: np.ndarray, truth: complex | float) -> float:
    """Return the absolute level error of a frame in dB, at most DYNAMIC_DB. `truth` is the true amplitude."""
    return float(min(abs(level_db(iq) + gain_db(method) - 20 * np.log10(abs(truth))), DYNAMIC_DB))


def alone(mesh: trimesh.Trimesh, distance_m: float, turn_deg: float = 0.0, aside_m: float = 0.0) -> tuple[Any, ...]:
    """Return (scene, sensor poses, motion) of a metal object, turned by `turn_deg` from facing the radar and shifted by `aside_m`."""
    pose = trajectory.turntable([distance_m, aside_m, 0], 1, 10.0, 25.0, np.pi + np.radians(turn_deg))
    return Scene([Surface(mesh, "metal", "target", role="object")]), None, {"target": pose}


@cache
def facing(shape: str, size_m: float, distance_m: float, turn_deg: float = 0.0) -> complex:
    """Return the true echo amplitude of a plate or trihedral at the centre frequency of the frequency sweep."""
    turn_rad = np.radians(turn_deg)
    return complex(corner_echoes(shape, size_m, distance_m * np.array([np.cos(turn_rad), -np.sin(turn_rad), 0.0]), WAVELENGTH_M)[0])


def _rays(method: Method, value: float) -> float:
    mesh, n = objects.trihedral(0.1), int(value)
    wide = {"mitsuba": {"rays": n}, "points": {"rays_per_wavelength2": n * WAVELENGTH_M**2 / 0.02}, "rfgenesis": {"grid": round(n**0.5)},
            "sionna": {"rays": n}}  # fmt: skip
    return off(method, samples(method, *alone(mesh, 1.0, 5.0), **wide[method.backend]), facing("trihedral", 0.1, 1.0, 5.0))


def _shift(method: Method, value: float) -> float:
    distance = np.hypot(1.0, value / 1e3)
    return off(method, samples(method, *alone(objects.sphere(0.033, 4), 1.0, 0.0, value / 1e3)), sphere_echo(0.033, distance, MIDDLE_HZ)[0])


def _facets(method: Method, value: float) -> float:
    mesh, truth = objects.cylinder(0.033, 0.12, int(value)), cylinder_echo(0.033, 0.12, 1.0, MIDDLE_HZ)[0]
    errors = [off(method, samples(method, *alone(mesh, 1.0, turn_deg)), truth) for turn_deg in np.array([0.1, 0.5, 0.8]) * 180 / value]
    return float(np.sqrt(np.mean(np.square(errors))))


def sheet(side_m: float, cells: int) -> trimesh.Trimesh:
    """Return a plate meshed as in a scan: `cells` x `cells` squares of two triangles each, without vertex normals."""
    across = np.linspace(-side_m / 2, side_m / 2, cells + 1)
    z, y = np.meshgrid(across, across, indexing="ij")
    vertices = np.stack([np.zeros(y.size), y.ravel(), z.ravel()], axis=1)
    low = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = np.concatenate([np.stack([low, low + 1, low + cells + 2], 1), np.stack([low, low + cells + 2, low + cells + 1], 1)])
    return trimesh.Trimesh(vertices, faces, process=False)


def _damaged(kind: str, method: Method, value: float) -> float:
    """Return the rms level error in dB of a scanned plate over three draws, with `value` % of its faces missing or `value` mm of noise."""
    errors = []
    for seed in range(3):
        mesh, rng = sheet(0.2, 20), np.random.default_rng(seed)
        if value and kind == "holes":
            mesh.update_faces(rng.random(len(mesh.faces)) >= value / 100)
        if value and kind == "noise":
            mesh = trimesh.Trimesh(mesh.vertices + rng.normal(size=mesh.vertices.shape) * [value / 1e3, 0, 0], mesh.faces, process=False)
        errors.append(off(method, samples(method, *alone(mesh, 2.0)), facing("plate", 0.2, 2.0)))
    return float(np.sqrt(np.mean(np.square(errors))))


def _near(method: Method, value: float) -> float:
    mesh = objects.trihedral(0.15)
    return off(method, samples(method, *alone(mesh, value, 5.0)), facing("trihedral", 0.15, value, 5.0))


def _office(method: Method, scene: Scene, bounces: int, **settings: Any) -> float:
    pose = traced.pose(OFFICE_SENSOR, rooms.rotation())
    comparison = compare([(samples(method, scene, pose, **settings), _images(bounces))], RADAR, gain_db(method))
    return min(comparison.profile_db, DYNAMIC_DB)


@cache
def _images(bounces: int) -> np.ndarray:
    return office_images(traced.pose(OFFICE_SENSOR, rooms.rotation()), bounces)[None]


def _room_rays(method: Method, value: float) -> float:
    n = int(value)
    wide: dict[str, dict[str, Any]] = {
        "mitsuba": {"room": "tubes", "rays": n}, "points": {}, "rfgenesis": {"grid": round(n**0.5)}, "sionna": {"rays": n},
    }  # fmt: skip
    return _office(method, rooms.room_scene(OFFICE, "concrete"), 4, **wide[method.backend])


def _bounces(method: Method, value: float) -> float:
    reads = method.backend in ("mitsuba", "sionna")
    return _office(method, rooms.room_scene(OFFICE, "concrete"), 5, **({"max_bounces": int(value)} if reads else {}))


def _missing(method: Method, value: float) -> float:
    """Return the profile error in dB if the room lacks its first `value` surfaces: high x, ceiling, low y, low x, floor."""
    mesh = rooms.room_scene(OFFICE, "concrete").surfaces[0].mesh
    centre, size = mesh.triangles_center, np.array(OFFICE)
    gone = [
        centre[:, axis] > size[axis] - 1e-6 if high else centre[:, axis] < 1e-6 for axis, high in ((0, 1), (2, 1), (1, 0), (0, 0), (2, 0))
    ]
    keep = ~np.any([np.zeros(len(centre), bool), *gone[: int(value)]], axis=0)
    kept = trimesh.Trimesh(mesh.vertices, mesh.faces[keep], process=False)
    return _office(method, Scene([Surface(kept, "concrete", "walls", role="room")]), 4)


def _far(method: Method, value: float) -> float:
    """Return the level error in dB of a metal ball; DYNAMIC_DB beyond the unambiguous range, where no range bin holds the ball."""
    if value > RADAR.unambiguous_range_m:
        return DYNAMIC_DB
    return off(method, samples(method, *alone(objects.sphere(BALL_M, 4), value)), sphere_echo(BALL_M, value, MIDDLE_HZ)[0])


def speed_read_mps(simulator: Backend, radar: Radar, speed_mps: float) -> float:
    """Return the Doppler speed in m/s of a receding plate, computed from a transmitter's chirps and the wavelength of 77 GHz."""
    poses = np.array([trajectory.pose([2 + speed_mps * frame / radar.frame_rate_hz, 0.0, 0.0]) for frame in range(3)])
    scene = Scene([Surface(objects.plate(0.1, 0.1), "metal", "plate")])
    iq = simulate(scene, radar, np.eye(4)[None], motion={"plate": poses}, simulator=simulator).iq[1, :, 0, 0]
    spectrum = np.fft.fft(iq * np.hanning(radar.num_samples), axis=1)
    chirps = spectrum[:, np.abs(spectrum).sum(axis=0).argmax()]
    doppler = np.abs(np.fft.fft(chirps * np.hanning(len(chirps)), 64 * len(chirps)))
    cycles = float(np.fft.fftfreq(len(doppler))[doppler.argmax()])
    return cycles * rfgenesis.LOSS_WAVELENGTH_M / 2 / radar.loop_interval_s


def _speed(method: Method, value: float) -> float:
    with quiet():
        read = speed_read_mps(method.simulator, Radar.iwr1843(element="isotropic"), value)
    return float(min(abs(20 * np.log10(max(read / value, 1e-2))), DYNAMIC_DB))


def _thickness(method: Method, value: float) -> float:
    """Return the level error in dB of a plasterboard wall that is simulated too thick by `value` millimetres."""
    te, _ = stack.stack([("plasterboard", BOARD_M)], "air", 0.0, MIDDLE_HZ)
    wall = objects.plate(6.0, 6.0).apply_translation((1.5, 0, 0))
    scene = Scene([Surface(wall, Layered([("plasterboard", BOARD_M + value / 1e3)]), "wall", role="room")])
    start = (RADAR.num_samples - 8) / 2 / RADAR.sample_rate_hz
    radar = replace(RADAR, num_samples=8, start_frequency_hz=RADAR.start_frequency_hz + RADAR.slope_hz_per_s * start)
    with quiet():
        iq = simulate(scene, radar, np.eye(4)[None], simulator=method.simulator).iq
    return off(method, iq, WAVELENGTH_M / (8 * np.pi * 1.5) * abs(te))


def _gap(method: Method, value: float) -> float:
    """Return the level error in dB of a concrete plate if a metal plate is hidden `value` millimetres behind it."""
    front, behind = objects.plate(0.2, 0.2), objects.plate(0.2, 0.2).apply_translation((-value / 1e3, 0, 0))
    scene = Scene([Surface(front, "concrete", "front", role="object"), Surface(behind, "metal", "behind", role="object")])
    pose = alone(front, 2.0)[2]["target"]
    te, _ = stack.fresnel(stack.permittivity("concrete", MIDDLE_HZ), 1.0)
    return off(method, samples(method, scene, None, {"front": pose, "behind": pose}), abs(facing("plate", 0.2, 2.0)) * float(abs(te)))


def _snr(method: Method, value: float) -> float:
    """Return the error in dB of the mean power in the target's range bin, with receiver noise `value` dB below the true echo."""
    level = np.abs(samples(method, *alone(objects.sphere(BALL_M, 4), 1.0))).mean() * 10 ** (gain_db(method) / 20)
    truth = abs(sphere_echo(BALL_M, 1.0, MIDDLE_HZ)[0])
    noise = np.random.default_rng(1).normal(size=(DRAWS, 2)) @ [1, 1j] * truth * 10 ** (-value / 20) / np.sqrt(2)
    return float(min(abs(10 * np.log10(np.mean(np.abs(level + noise) ** 2) / truth**2)), DYNAMIC_DB))


def _full_wave(sweep: str, method: Method, value: float) -> float:
    """Return the range-profile error in dB of a metal scene of furnished_sweeps, whose full-wave field is stored."""
    name = furnished_sweeps.name(sweep, value)
    iq = samples(method, fullwave.scene(furnished_sweeps.FOLDER, name))[0, 0, 0, 0] * 10 ** (gain_db(method) / 20)
    return min(fullwave.compare(furnished_sweeps.FOLDER, name, iq).profile_db, DYNAMIC_DB)


def _values(sweep: str) -> tuple[float, ...]:
    return furnished_sweeps.SWEEPS[sweep][1]


SWEEPS = (
    Sweep("rays", "rays on an object (10 cm trihedral, 1 m)", "rays a frame", "numerical", (65536, 16384, 4096, 1024, 256, 64), _rays,
          "too few ray tubes do not resolve the faces, and the pixels of a camera miss the corner"),
    Sweep("room rays", "rays in a room (bare office, tubes)", "rays a frame", "numerical", (3e5, 1e5, 3e4, 1e4, 1e3), _room_rays,
          "the ray tubes are wider than the default rule; the default traces flat rooms by faces with edges, without rays"),
    Sweep("grid", "place of the grid (sphere moved sideways)", "mm", "numerical", (0.0, 0.5, 1.0, 1.5, 2.0, 2.5), _shift,
          "regular ray tubes cover the wavefront at any position of the grid, but the points of a camera do not"),
    Sweep("facets", "sides of a can's mesh", "sides", "numerical", (128, 64, 32, 16, 12, 8, 6), _facets,
          "vertex normals make the sides round, but the outline stays a polygon"),
    Sweep("holes", "holes in a scanned plate", "% of faces", "knowledge", (0, 1, 2, 5, 10, 20, 40), partial(_damaged, "holes"),
          "missing faces return no echo, so the level falls by 20 lg of the remaining share of the area"),
    Sweep("noise", "height noise of a scanned plate", "mm rms", "physical",
          (0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6), partial(_damaged, "noise"),
          "a height noise of a tenth of the wavelength destroys the specular echo of a plate, as in reality; fitted planes average it"),
    Sweep("near", "distance of a 15 cm trihedral", "m", "physical", (8.0, 4.0, 2.0, 1.0, 0.5, 0.3), _near,
          "a far-field cross-section holds beyond 2 D^2/lambda = 24 m"),
    Sweep("bounces", "bounces traced (bare office)", "bounces", "a setting", (5, 4, 3, 2, 1), _bounces,
          "each bounce that is left out removes the echoes in its range bins"),
    Sweep("fold", "range of a ball", "m", "physical", (2.0, 4.0, 8.0, 10.0, 12.0, 16.0), _far,
          "beyond 11.16 m the beat frequency aliases, in every method and in the sensor"),
    Sweep("speed", "speed of a plate", "m/s", "physical", (0.2, 1.0, 3.0, 6.0, 7.0, 8.0, 12.0), _speed,
          "beyond 7.4 m/s the Doppler frequency aliases, in every method and in the sensor"),
    Sweep("thickness", "error of a board's thickness", "mm", "knowledge", (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.2), _thickness,
          "front and back of a board interfere, so that half a millimetre changes the echo by decibels"),
    Sweep("gap", "gap before a hidden plate", "mm", "numerical", (100.0, 10.0, 1.0, 0.3, 0.1, 0.03), _gap,
          "rays start at a small distance from the surface that they leave, and miss a surface within this distance"),
    Sweep("missing", "surfaces missing (bare office)", "of 6", "knowledge", (0, 1, 2, 3, 5), _missing,
          "a wall that is missing in the scan returns no echo"),
    Sweep("snr", "echo over receiver noise", "dB", "physical", (40, 30, 20, 10, 5, 0, -5), _snr,
          "below 0 dB a bin holds more noise than echo"),
    Sweep("obstacle", "side of a metal box before a wall", "mm", "physical", _values("obstacle"), partial(_full_wave, "obstacle"),
          "waves diffract around a box that is narrower than the Fresnel zone of 4 cm"),
    Sweep("opening", "width of an opening before a wall", "mm", "physical", _values("opening"), partial(_full_wave, "opening"),
          "an opening narrower than the Fresnel zone of 4 cm spreads the wave over all angles"),
    Sweep("panel", "tilt of a 15 cm panel, full wave", "deg", "physical", _values("panel"), partial(_full_wave, "panel"),
          "a panel turned away from its mirror direction returns only the waves from its edges"),
    Sweep("edge", "mirror point to the edge of a panel", "mm", "physical", _values("edge"), partial(_full_wave, "edge"),
          "near the edge of a panel the wave from the edge is as strong as the mirror image"),
)  # fmt: skip
