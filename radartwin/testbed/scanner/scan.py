"""A phone scan of a scene whose truth is known: frames as the phone writes them, and the truth apart, for scoring alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from radartwin.compiled import cores
from radartwin.errors import SceneError
from radartwin.reconstruct.frames.frames import Frame, Frames, check_poses
from radartwin.scene.scene import Scene
from radartwin.testbed.scanner.camera import NOT_SEEN, picture, sight
from radartwin.testbed.scanner.light import light_of
from radartwin.testbed.scanner.look import ORGANIC_REFLECTANCE, Look, look_of, to_linear
from radartwin.testbed.scanner.sensor import Sensor, drifted, measured
from radartwin.testbed.scanner.walk import Walk, walked

FRAMES = (100, 360)  # of a scan, by the area of the room's box
FRAMES_PER_M2 = 0.9


@dataclasses.dataclass(frozen=True, eq=False)
class ScanTruth:
    """What the scanner knows and the reconstruction must not.

    Attributes:
        names: of the scene's surfaces, in its order.
        poses: (N, 4, 4) where the camera really was.
        surface: (N, h, w) int16, the surface whose depth each pixel has; -1 where there is no depth or it mixes two.
        first: (N, h, w) int16, the first surface on each ray, panes and mirrors included; -1 outside.
        depth_m: (N, h, w) float32 true depth of what returns the light; 0 outside.
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
    path: np.ndarray | None = None,
    walk: Walk = Walk(),  # noqa: B008 - frozen
    sensor: Sensor = Sensor(),  # noqa: B008 - frozen
    colour_every: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Frames, ScanTruth]:
    """Frames of a scene as a person with a phone would take them.

    Args:
        strength: factor on noise, dropouts, flying pixels and drift; 0 is a perfect sensor.
        frames: how many; by the room's size unless given.
        path: (N, 4, 4) true camera poses, OpenCV axes, in place of the walk.
        walk, sensor: how the phone moves and errs.
        colour_every: colour for every n-th frame, 0 for none.
        progress: called with (done, of) after every frame.
    Returns:
        The frames, at the poses the phone believes, and the truth.
    Raises:
        SceneError: an empty scene, nowhere to stand, or values out of range.
        PoseError: a path that is not rigid.
    """
    if not len(scene):
        raise SceneError("an empty scene cannot be scanned; add surfaces")
    if not 0 <= strength <= 10 or colour_every < 0:
        raise SceneError(f"scan: strength {strength} must be 0 to 10 and colour_every {colour_every} not negative")
    motion, drift, pictures = (np.random.default_rng(s) for s in np.random.SeedSequence([seed, *b"scan"]).spawn(3))
    if path is not None:
        poses = check_poses(np.asarray(path, dtype=np.float64), "path", [str(i) for i in range(len(path))])
    else:
        poses = walked(scene, frames or _frame_count(scene), walk, motion)
    look = look_of(scene)
    light = light_of(look) if colour_every else None
    children = pictures.spawn(len(poses))
    believed = drifted(poses, sensor, strength, drift)
    bright = _reflectance(look)
    lens, colour_lens = sensor.intrinsics(sensor.size), sensor.intrinsics(sensor.colour_size)

    def take(i: int) -> tuple[Frame, np.ndarray, np.ndarray, np.ndarray]:
        rng = children[i]
        seen = sight(look, poses[i], lens, sensor.size)
        hit = seen.face >= 0
        depth, confidence, flying = measured(seen, np.where(hit, bright[seen.face], 0), hit & look.metal[seen.face], sensor, strength, rng)
        colour = None
        if light is not None and i % colour_every == 0:
            colour = picture(look, light, poses[i], colour_lens, sensor.colour_size, rng)
        frame = Frame(f"{i:05d}", believed[i], lens, depth, colour, colour_lens if colour is not None else None, confidence)
        surface = np.where((depth > 0) & hit & ~flying & ~seen.mirror, look.surface[seen.face], NOT_SEEN)
        return frame, surface.astype(np.int16), seen.first.astype(np.int16), np.where(hit, seen.depth, 0).astype(np.float32)

    taken = []
    with ThreadPoolExecutor(cores()) as pool:
        for one in pool.map(take, range(len(poses))):
            taken.append(one)
            if progress:
                progress(len(taken), len(poses))
    kept, surfaces, firsts, depths = zip(*taken, strict=True)
    truth = ScanTruth(scene.names, poses, np.stack(surfaces), np.stack(firsts), np.stack(depths))
    room = str(scene.provenance.get("room", ""))
    return Frames.of(kept, f"scan of {room or 'a scene'}", room), truth


def _frame_count(scene: Scene) -> int:
    x, y, z = np.ptp(scene.bounds, axis=0)
    return int(np.clip(FRAMES_PER_M2 * 2 * (x * y + y * z + z * x), *FRAMES))


def _reflectance(look: Look) -> np.ndarray:
    """Reflectance (F,) in the near infrared: the mean luminance of a face's texture or tint, more where it is organic."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    bright = look.tint @ weights
    last = look.levels.shape[1] - 1
    for t in np.unique(look.texture[look.texture >= 0]):
        offset, width, height = look.levels[t, last]
        bright[look.texture == t] = (to_linear(look.pool[offset : offset + width * height]) @ weights).mean()
    return np.clip(np.where(look.organic, np.maximum(bright, ORGANIC_REFLECTANCE), bright), 0.02, 1.0)
