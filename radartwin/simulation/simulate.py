"""Simulate a radar recording: compute the IQ samples of a radar from a scene, a radar description and the poses of sensor and objects.

Frames are traced and synthesised in blocks, so that the paths of a recording need memory that does not grow with its number of frames. The
first block has at most FIRST_FRAMES frames. Each next block has as many frames as fit into BLOCK_BYTES of paths and samples, but at least
FEWEST_FRAMES and at most MOST_FRAMES. The blocks depend only on the arguments of `simulate`, not on the computer.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import InputError
from radartwin.io import files
from radartwin.io.scratch import ScratchArray
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import frame_bytes, frame_shape
from radartwin.radar.recording import Recording, recording_files
from radartwin.scene.scene import Scene
from radartwin.simulation import poses as poses_module
from radartwin.simulation.argument_checks import check_option, check_whole
from radartwin.simulation.backends.backend import Backend, paths_of_frames, resolve
from radartwin.simulation.backends.mitsuba import MitsubaBackend
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.geometry import MIN_AREA_M2
from radartwin.simulation.paths import Paths
from radartwin.simulation.poses import ObjectPoses
from radartwin.simulation.signal.synthesis import ELEMENTS, received, thermal_noise

FIRST_FRAMES = 8  # largest number of frames of the first block
FEWEST_FRAMES, MOST_FRAMES = 8, 128  # limits of the number of frames of the other blocks
BLOCK_BYTES = 100_000_000  # size of the paths and samples of a block; tracing needs about three times this memory


def simulate(
    scene: Scene,
    radar: Radar,
    sensor_poses: np.ndarray,
    *,
    motion: ObjectPoses | None = None,
    max_bounces: int = 4,
    rays: int | None = None,
    noise: bool = False,
    seed: int = 0,
    rays_per_wavelength2: float = 1.0,
    variant: str = "auto",
    simulator: str | Backend = "mitsuba",
    elements: str = "exact",
    out: str | Path | None = None,
    provenance: Mapping[str, Any] | None = None,
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
        simulator: the name of a simulator, or the result of `backend(name, ...)`, which has more settings (`TraceSettings`), such as the
            spacing of the positions at which a moving radar traces the paths between objects and room. Other simulators than "mitsuba"
            refuse a changed value of max_bounces, rays, rays_per_wavelength2 or variant; give these to `backend(name, ...)`.
        elements: "exact" computes the path length to each antenna element. "planar" assumes plane waves across the antenna array.
        out: path without suffix under which the recording is saved (see `Recording.save`), so that a long recording needs no more memory
            than a short one. The samples `iq` of the returned recording are then a memory-mapped file without a name, which takes 8 bytes
            of disk per sample until the recording is no longer used. An interrupted simulation leaves no file. None keeps the samples in
            memory.
        provenance: entries to add to the recording's provenance, as plain JSON values.
    Returns:
        A Recording with samples iq (F frames, chirps, transmitters, receivers, samples) in amplitude units.
    Raises:
        OutputError: `out` cannot be written, or its disk is full.
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
    folder = None if out is None else files.make_folder(recording_files(out)[0].parent)
    kept, sensor, moving = _checked(scene, radar, sensor_poses, motion)
    names = (b"oscillator noise", b"receiver noise") if noise else ()
    noises = tuple(np.random.default_rng(np.random.SeedSequence([seed, *name])) for name in names)
    shape = (len(sensor), *frame_shape(radar))
    blocks = _blocks(kept, radar, sensor, moving, tracer, elements, noises)
    if folder is None:
        iq, start = np.empty(shape, np.complex64), 0
        for block in blocks:
            iq[start : start + len(block)] = block
            start += len(block)
    else:
        with contextlib.closing(ScratchArray(folder, shape, np.complex64, shape[0] * frame_bytes(radar))) as scratch:
            for block in blocks:
                scratch.write(block)
            iq = scratch.array()
    described = {
        "kind": "simulation", "simulator": tracer.name, **{k: v for k, v in asdict(tracer.settings).items() if k != "variant"},
        "elements": elements, "noise": noise, "seed": seed, "surfaces": list(scene.names),
    }  # fmt: skip
    recording = Recording(iq, radar, sensor, provenance=described | dict(provenance or {}))
    if out is not None:
        recording.save(out)
    return recording


def _blocks(
    scene: Scene,
    radar: Radar,
    sensor: np.ndarray,
    moving: ObjectPoses,
    tracer: Backend,
    elements: str,
    noises: Sequence[np.random.Generator],
) -> Iterator[np.ndarray]:
    """Yield the samples (F, C, T, R, N) of consecutive blocks of frames.

    Args:
        scene, radar, sensor, moving: checked by `_checked`. tracer: simulator that traces the paths.
        elements: as in `simulate`.
        noises: random generators of oscillator noise and receiver noise; empty without noise.
    """
    frames, start, size, most_bytes = len(sensor), 0, FIRST_FRAMES, 0.0
    still: list[Paths] | None = None
    if frames > size and poses_module.at_rest(sensor, *moving.values()):
        still = tracer.paths(scene, radar, sensor[:1], {name: poses[:1] for name, poses in moving.items()})
    while start < frames:
        stop = min(start + size, frames)
        parts = still if still is not None else paths_of_frames(tracer, scene, radar, sensor, moving, start, stop)
        iq = received(parts, radar, stop - start, elements=elements, oscillator=noises[0] if noises else None)
        if noises:
            iq += thermal_noise(iq.shape, radar, noises[1])
        if radar.real_sampling:
            iq.imag = 0
        arrays = [value for part in parts if part.poses > 1 for value in vars(part).values() if isinstance(value, np.ndarray)]
        most_bytes = max(most_bytes, (iq.nbytes + sum(array.nbytes for array in arrays)) / len(iq))
        size = int(np.clip(BLOCK_BYTES / most_bytes, FEWEST_FRAMES, MOST_FRAMES))
        start = stop
        yield iq


def trace_paths(
    scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses | None, settings: TraceSettings
) -> tuple[list[Paths], np.ndarray]:
    """Check the arguments of `simulate` and trace the propagation paths on Mitsuba.

    Args:
        scene, radar, sensor_poses, motion: as in `simulate`.
        settings: settings of the tracer.
    Returns:
        A list of `Paths` objects, whose signals add up, and the sensor poses (F, 4, 4). Each `Paths` object has F poses, or one pose that
        is valid for all frames.
    """
    scene, sensor, moving = _checked(scene, radar, sensor_poses, motion)
    return MitsubaBackend(settings).paths(scene, radar, sensor, moving), sensor


def _checked(
    scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses | None
) -> tuple[Scene, np.ndarray, dict[str, np.ndarray]]:
    """Check the arguments of `simulate`. Return the scene without tiny surfaces, the sensor poses (F, 4, 4), and the poses (F, 4, 4) of
    moving surfaces by name.
    """
    for name, value, kind in (("scene", scene, Scene), ("radar", radar, Radar)):
        if not isinstance(value, kind):
            raise InputError(f"{name} must be a radartwin.{kind.__name__}, not {type(value).__name__}")
    sensor = poses_module.check_poses(sensor_poses, "sensor_poses")
    moving, frames = poses_module.check_motion(motion, set(scene.names), len(sensor))
    sensor = poses_module.repeated(sensor, frames)
    places = sensor[:, :3, 3] if len(sensor) == 1 else np.unique(sensor[:, :3, 3], axis=0)
    Scene(s for s in scene.surfaces if s.name not in moving).check_sensor(places)
    for name, poses in moving.items():
        relative = (poses_module.inverse(poses) @ sensor)[:, :3, 3]
        Scene(s for s in scene.surfaces if s.name == name).check_sensor(relative)
    scene = Scene(s for s in scene.surfaces if (s.mesh.area_faces > MIN_AREA_M2).any())
    moving = {name: poses for name, poses in moving.items() if name in scene.names}
    return scene, sensor, moving
