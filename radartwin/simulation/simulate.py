"""Simulate a radar recording: compute the IQ samples of a radar from a scene, a radar description and the poses of sensor and objects."""

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.scene.scene import Scene
from radartwin.simulation import poses as poses_module
from radartwin.simulation.backends.backend import Backend, resolve
from radartwin.simulation.backends.mitsuba import MitsubaBackend
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.checks import check_option, check_positive, check_whole
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import ELEMENTS, FRAMES_PER_BLOCK, received, thermal_noise

MAX_RAYS = 200_000_000  # largest number of ray tubes per sensor pose; tracing this number of tubes takes some minutes
MAX_DENSITY = 10_000  # largest number of ray tubes per square wavelength; this density gives seven million tubes on a 10 cm plate
MIN_AREA_M2 = 1e-14  # the simulation ignores a surface if the area of each of its faces is below this limit, in square metres


def simulate(
    scene: Scene,
    radar: Radar,
    sensor_poses: np.ndarray,
    *,
    motion: Mapping[str, np.ndarray] | None = None,
    max_bounces: int = 4,
    rays: int | None = None,
    noise: bool = False,
    seed: int = 0,
    rays_per_wavelength2: float = 1.0,
    variant: str = "auto",
    simulator: str | Backend = "mitsuba",
    elements: str = "exact",
) -> Recording:
    """Simulate the raw FMCW samples that a radar would record of a scene.

    Args:
        scene: surfaces in world coordinates. A surface whose name is a key of `motion` is in its own coordinate frame instead.
        radar: waveform, antenna array, element pattern and noise figure.
        sensor_poses: (F, 4, 4) transformations from the sensor frame to the world at the start of each frame, or one pose for all frames.
        motion: transformations (F, 4, 4) from a surface's own frame to the world, by surface name; None if no surface moves.
        max_bounces: largest number of reflections per path, at least 1.
        rays: number of ray tubes per sensor pose over all directions, or over the object if the scene has no room. None lets the tracer
            choose the number from the tube width that it needs.
        noise: whether to add thermal noise, whose power follows from the radar's noise figure and transmit power. If the radar has phase
            noise, `noise` also adds phase noise.
        seed: seed of the random noise; equal seeds give byte-identical samples.
        rays_per_wavelength2: number of ray tubes per square wavelength on objects.
        variant: Mitsuba variant that traces the tubes: "llvm" (CPU), "cuda" (GPU), or "auto" (GPU if the computer has one).
        simulator: the name of a simulator, or the result of `backend(name, ...)`. Only the simulator "mitsuba" reads max_bounces, rays,
            rays_per_wavelength2 and variant.
        elements: "exact" computes the path length to each antenna element. "planar" assumes plane waves across the antenna array. "auto"
            assumes plane waves if their phase error is small.
    Returns:
        A Recording with samples iq (F frames, chirps, transmitters, receivers, samples) in amplitude units.
    Raises:
        PoseError, SceneError, MaterialError, InputError, BackendError: an argument is wrong. The message names the argument and the remedy.

    >>> import trimesh
    >>> from radartwin.scene.scene import Surface
    >>> plate = trimesh.creation.box((0.001, 0.1, 0.1))
    >>> pose = np.eye(4)
    >>> pose[0, 3] = -1.0
    >>> simulate(Scene([Surface(plate, "metal", "plate")]), Radar.iwr1843(), pose[None]).iq.shape
    (1, 16, 2, 4, 256)
    """
    check_whole("seed", seed, 0)
    check_option("elements", elements, ELEMENTS)
    settings = TraceSettings(max_bounces, rays, rays_per_wavelength2, variant)
    tracer = resolve(simulator, settings)
    parts, sensor = trace_paths(scene, radar, sensor_poses, motion, settings, tracer)
    frames = len(sensor)
    oscillator = _generator(seed, b"oscillator noise") if noise else None
    iq = received(parts, radar, frames, elements=elements, oscillator=oscillator)
    if noise:
        receiver = _generator(seed, b"receiver noise")
        for start in range(0, frames, FRAMES_PER_BLOCK):
            block = iq[start : start + FRAMES_PER_BLOCK]
            block += thermal_noise(block.shape, radar, receiver)
    if radar.real_sampling:
        iq.imag = 0
    provenance = {
        "kind": "simulation", "simulator": tracer.name, **{k: v for k, v in asdict(tracer.settings).items() if k != "variant"},
        "elements": elements, "noise": noise, "seed": seed, "surfaces": list(scene.names),
    }  # fmt: skip
    return Recording(iq, radar, sensor, provenance=provenance)


def _generator(seed: int, name: bytes) -> np.random.Generator:
    """Return the random generator of the noise `name`."""
    return np.random.default_rng(np.random.SeedSequence([seed, *name]))


def trace_paths(
    scene: Scene,
    radar: Radar,
    sensor_poses: np.ndarray,
    motion: Mapping[str, np.ndarray] | None,
    settings: TraceSettings,
    tracer: Backend | None = None,
) -> tuple[list[Paths], np.ndarray]:
    """Check the arguments of `simulate` and trace the propagation paths.

    Args:
        scene, radar, sensor_poses, motion: as in `simulate`.
        settings: settings of the tracer on Mitsuba.
        tracer: simulator that traces the paths; None traces with Mitsuba and `settings`.
    Returns:
        A list of `Paths` objects, whose signals add up, and the sensor poses (F, 4, 4). Each `Paths` object has F poses, or one pose that
        is valid for all frames.
    """
    for name, value, kind in (("scene", scene, Scene), ("radar", radar, Radar)):
        if not isinstance(value, kind):
            raise InputError(f"{name} must be a radartwin.{kind.__name__}, not {type(value).__name__}")
    settings = tracer.settings if isinstance(tracer, MitsubaBackend) else settings
    check_whole("max_bounces", settings.max_bounces, 1)
    if settings.rays is not None:
        check_whole("rays", settings.rays, 1, MAX_RAYS)
    check_positive("rays_per_wavelength2", settings.rays_per_wavelength2, MAX_DENSITY)
    sensor = poses_module.check_poses(sensor_poses, "sensor_poses")
    moving, frames = poses_module.check_motion(motion, set(scene.names), len(sensor))
    sensor = poses_module.repeated(sensor, frames)
    Scene(s for s in scene.surfaces if s.name not in moving).check_sensor(np.unique(sensor[:, :3, 3], axis=0))
    for name, poses in moving.items():
        relative = (poses_module.inverse(poses) @ sensor)[:, :3, 3]
        Scene(s for s in scene.surfaces if s.name == name).check_sensor(relative)
    scene = Scene(s for s in scene.surfaces if (s.mesh.area_faces > MIN_AREA_M2).any())
    moving = {name: poses for name, poses in moving.items() if name in scene.names}
    return (tracer or MitsubaBackend(settings)).paths(scene, radar, sensor, moving), sensor
