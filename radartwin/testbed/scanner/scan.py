"""Scan a scene with the simulated phone: compute the frames that the phone would write, and the true values for evaluation."""

from __future__ import annotations

import dataclasses

import numpy as np

from radartwin.compiled import each
from radartwin.errors import SceneError
from radartwin.reconstruct.frames.frames import Frame, Frames, check_poses
from radartwin.scene.scene import Scene
from radartwin.testbed.scanner.camera import NOT_SEEN, picture, sight
from radartwin.testbed.scanner.light import light_of
from radartwin.testbed.scanner.look import ORGANIC_REFLECTANCE, Look, look_of, to_linear
from radartwin.testbed.scanner.sensor import Sensor, drifted, measured
from radartwin.testbed.scanner.walk import walked

FRAMES = (100, 360)  # smallest and largest number of frames of a scan
FRAMES_PER_M2 = 0.9  # number of frames per square metre of the surface of the room's bounding box


@dataclasses.dataclass(frozen=True, eq=False)
class ScanTruth:
    """The true values of a simulated scan, which the reconstruction of the room must not use.

    Attributes:
        names: names of the scene's surfaces, in the order of the scene.
        poses: (N, 4, 4) true camera-to-world poses of the N frames.
        surface: (N, h, w) int16, index of the surface at each pixel's depth; -1 without a depth, or if the depth mixes two surfaces.
        first: (N, h, w) int16, index of the first surface on each pixel's ray, including panes; -1 where the ray leaves the scene.
        depth_m: (N, h, w) float32, true depth of the reflecting surface in metres; 0 where the ray leaves the scene.
    """

    names: tuple[str, ...]
    poses: np.ndarray
    surface: np.ndarray
    first: np.ndarray
    depth_m: np.ndarray


def scan(
    scene: Scene,
    seed: int = 0,
    strength: float = 1.0,
    frames: int | None = None,
    poses: np.ndarray | None = None,
    sensor: Sensor = Sensor(),  # noqa: B008 - frozen
    colour_every: int = 1,
) -> tuple[Frames, ScanTruth]:
    """Scan a scene as a person with a phone would.

    Args:
        scene: the true scene to scan.
        seed: seed of all random numbers of the scan.
        strength: factor on depth noise, lost depth values, mixed depths at edges and pose drift; 0 is an ideal sensor.
        frames: number of frames; None computes it from the size of the room.
        poses: true camera-to-world poses (N, 4, 4), OpenCV axes; None plans a walk through the room.
        sensor: parameters of the phone's sensors and their errors.
        colour_every: every n-th frame has a colour picture; 0 makes no colour pictures.
    Returns:
        The frames, with the poses that the phone estimates, and the true values.
    Raises:
        SceneError: the scene is empty, the room has no free floor for a person, or an argument is out of range.
        PoseError: one of the given poses is not a rigid transform.
    """
    if not len(scene):
        raise SceneError("an empty scene cannot be scanned; add surfaces")
    if not 0 <= strength <= 10 or colour_every < 0:
        raise SceneError(f"scan: strength {strength} must be 0 to 10 and colour_every {colour_every} not negative")
    motion, drift, pictures = (np.random.default_rng(s) for s in np.random.SeedSequence([seed, *b"scan"]).spawn(3))
    if poses is None:
        x, y, z = np.ptp(scene.bounds, axis=0)
        poses = walked(scene, frames or int(np.clip(FRAMES_PER_M2 * 2 * (x * y + y * z + z * x), *FRAMES)), motion)
    else:
        poses = check_poses(np.asarray(poses, dtype=np.float64), "poses", [str(i) for i in range(len(poses))])
    look = look_of(scene)
    light = light_of(look) if colour_every else None
    children = pictures.spawn(len(poses))
    estimated = drifted(poses, sensor, strength, drift)
    reflectance = _reflectance(look)
    intrinsics, colour_intrinsics = sensor.intrinsics(sensor.size), sensor.intrinsics(sensor.colour_size)

    def take(i: int) -> tuple[Frame, np.ndarray, np.ndarray, np.ndarray]:
        rng = children[i]
        seen = sight(look, poses[i], intrinsics, sensor.size)
        hit = seen.face >= 0
        depth, confidence, flying = measured(
            seen, np.where(hit, reflectance[seen.face], 0), hit & look.metal[seen.face], sensor, strength, rng
        )
        colour = None
        if light is not None and i % colour_every == 0:
            colour = picture(look, light, poses[i], colour_intrinsics, sensor.colour_size, rng)
        frame = Frame(f"{i:05d}", estimated[i], intrinsics, depth, colour, colour_intrinsics if colour is not None else None, confidence)
        surface = np.where((depth > 0) & hit & ~flying, look.surface[seen.face], NOT_SEEN)
        return frame, surface.astype(np.int16), seen.first.astype(np.int16), np.where(hit, seen.depth, 0).astype(np.float32)

    shots, surfaces, firsts, depths = zip(*each(take, range(len(poses))), strict=True)
    truth = ScanTruth(scene.names, poses, np.stack(surfaces), np.stack(firsts), np.stack(depths))
    room = str(scene.provenance.get("room", ""))
    return Frames.of(shots, f"scan of {room or 'a scene'}", room), truth


def _reflectance(look: Look) -> np.ndarray:
    """Return the reflectance (F,) of each face in the near infrared: the mean luminance of the face's texture or tint."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    bright = look.tint @ weights
    last = look.levels.shape[1] - 1
    for t in np.unique(look.texture[look.texture >= 0]):
        offset, width, height = look.levels[t, last]
        bright[look.texture == t] = (to_linear(look.pool[offset : offset + width * height]) @ weights).mean()
    return np.clip(np.where(look.organic, np.maximum(bright, ORGANIC_REFLECTANCE), bright), 0.02, 1.0)
