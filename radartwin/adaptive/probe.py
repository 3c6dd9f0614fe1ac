"""A probe is a few radar frames of a recording, at some angles of a revolution or positions of a drive; their features are computed under
several models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from radartwin.adaptive.scene_settings import Model
from radartwin.features import families as feature_families
from radartwin.features.log import Log, Nominal
from radartwin.features.processed import Processed, process
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation.poses import ObjectPoses

# A probe has as many frames as the recordings from which the limits were computed (experiments/generators/repeatability.py), because some
# features depend on the number of frames.
ASPECTS = 24  # frames per revolution
PLACES = 13  # frames per drive


@dataclass(frozen=True, eq=False)
class Probe:
    """Hold a few radar frames of a recording, which are simulated with one model after another.

    Attributes:
        room: surfaces of the room, which a model may leave out. kept: surfaces that every model includes, namely the object under test and
            its stand.
        radar, sensor_poses, motion: arguments of `simulate` for these frames. log: logged target distance and turntable angle of the same
            frames.
        families: names of the feature families to compare (radartwin/features/families.py).
        traced: {model: processed recording}, a cache that several probes with different feature families may share.
    """

    room: Scene
    kept: Scene
    radar: Radar
    sensor_poses: np.ndarray
    motion: ObjectPoses
    log: Log
    families: tuple[str, ...]
    variant: str = "auto"
    traced: dict[Model, Processed] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        return len(self.log.distance_m)

    def record(self, model: Model) -> Processed:
        """Simulate the frames of the probe under a model, with thermal noise, and process the recording."""
        simulated = model.recording(self.room, self.kept, self.radar, self.sensor_poses, dict(self.motion), self.variant)
        return process(simulated, doppler=False)

    def features(self, model: Model) -> tuple[list[str], NDArray[np.floating]]:
        if model not in self.traced:
            self.traced[model] = self.record(model)
        return feature_families.read(self.traced[model], self.log, self.families, turns=self.log.angle_rad is not None)

    def described(self) -> dict[str, Any]:
        """Return all inputs of the simulation that affect the features; the store derives its key from them."""
        surfaces = [
            (s.name, s.kind, str(s.material), s.roughness_m, s.correlation_m, np.asarray(s.mesh.vertices), np.asarray(s.mesh.faces), part)
            for part, scene in (("room", self.room), ("kept", self.kept)) for s in scene
        ]  # fmt: skip
        return {
            "surfaces": surfaces, "radar": self.radar.to_dict(), "sensor": np.round(self.sensor_poses, 9),
            "motion": {name: np.round(poses, 9) for name, poses in self.motion.items()}, "families": self.families,
            "distance": np.round(self.log.distance_m, 9), "angle": None if self.log.angle_rad is None else np.round(self.log.angle_rad, 9),
        }  # fmt: skip


def thinned(
    room: Scene, kept: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses, log: Log,
    families: Sequence[str], variant: str = "auto", count: int | None = None, between: bool = False
) -> Probe:  # fmt: skip
    """Build a probe from a recording: evenly spaced angles of the first revolution, or evenly spaced positions of the drive.

    Args:
        sensor_poses, motion: poses of the recording, shape (F or 1, 4, 4). log: target distances and turntable angles of its F frames.
        count: number of frames of the probe; None takes ASPECTS frames for a revolution and PLACES frames for a drive.
        between: whether the frames are shifted by half of their spacing, so that they lie between the frames of the probe with
            between=False.
    """
    frames, turning = len(log.distance_m), log.angle_rad is not None
    at = _aspects(np.asarray(log.angle_rad), count or ASPECTS, between) if turning else _places(frames, count or PLACES, between)
    rate = log.frame_rate_hz / (float(np.diff(at).mean()) if len(at) > 1 else 1.0)
    still = len(sensor_poses) == 1
    sensor = sensor_poses if still else _along(sensor_poses, at)
    moving = {name: _along(poses, at) if len(poses) > 1 else np.repeat(poses, len(at), axis=0) for name, poses in motion.items()}
    distance = np.interp(at, np.arange(frames), log.distance_m)
    turned = (2 * np.pi / len(at)) * np.arange(len(at), dtype=np.float64)
    course = Nominal(rate, distance, turned if turning else None)
    return Probe(room, kept, replace(radar, frame_rate_hz=rate), sensor, moving, course, tuple(families), variant)


def _aspects(angle_rad: np.ndarray, count: int, between: bool) -> np.ndarray:
    """Return fractional frame indices (count,) of evenly spaced angles in one revolution."""
    turned = np.unwrap(angle_rad) - angle_rad[0]
    step = float(np.median(np.abs(np.diff(turned))))
    whole = round(2 * np.pi / step)
    return (np.arange(count) + 0.5 * between) * whole / count


def _places(frames: int, count: int, between: bool) -> np.ndarray:
    """Return fractional frame indices, evenly spaced from the first to the last frame of a drive."""
    if frames <= count:
        return np.arange(frames) + 0.5 * between * (np.arange(frames) < frames - 1)
    return (np.arange(count) + 0.5) * (frames - 1) / count if between else np.linspace(0, frames - 1, count)


def _along(poses: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate poses (F, 4, 4) at fractional frame indices. From the last pose, the interpolation continues to the first."""
    known = np.concatenate([poses, poses[:1]]) if at.max() > len(poses) - 1 else poses
    times = np.arange(len(known))
    interpolated = np.tile(np.eye(4), (len(at), 1, 1))
    interpolated[:, :3, :3] = Slerp(times, Rotation.from_matrix(known[:, :3, :3]))(at).as_matrix()
    interpolated[:, :3, 3] = np.stack([np.interp(at, times, column) for column in known[:, :3, 3].T], axis=1)
    return interpolated
