"""Features of a recording under a model, from a few frames: some aspects of a revolution, or some places of a drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from radartwin.adaptive.model import Model
from radartwin.features import sets
from radartwin.features.log import Log, Nominal
from radartwin.features.processed import Processed, process
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene

# As many as in the recordings that repeatability was measured on (experiments/generators/repeatability.py), because some features
# depend on their number.
ASPECTS = 36  # of a turn
PLACES = 17  # of a drive


@dataclass(frozen=True, eq=False)
class Probe:
    """A few frames of a recording, to be traced by one model after another.

    Attributes:
        room: surfaces that a model may leave out. kept: the object under test and its stand.
        radar, sensor_poses, motion: as `simulate`; log: of the same frames.
        families: of the judged features (radartwin/features/sets.py).
        traced: {model: processed recording}; probes that differ only in their families may share it.
    """

    room: Scene
    kept: Scene
    radar: Radar
    sensor_poses: np.ndarray
    motion: Mapping[str, np.ndarray]
    log: Log
    families: tuple[str, ...]
    variant: str = "auto"
    traced: dict[Model, Processed] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        return len(self.log.distance_m)

    def record(self, model: Model) -> Processed:
        """The traced and processed recording under a model, with receiver noise."""
        made = model.recording(self.room, self.kept, self.radar, self.sensor_poses, dict(self.motion), self.variant)
        return process(made, doppler=False)

    def features(self, model: Model) -> tuple[list[str], NDArray[np.floating]]:
        """Names and values of the features under a model."""
        if model not in self.traced:
            self.traced[model] = self.record(model)
        return sets.read(self.traced[model], self.log, self.families, turns=self.log.angle_rad is not None)

    def described(self) -> dict[str, Any]:
        """Everything that decides the features, for a store key."""
        surfaces = [
            (s.name, s.kind, str(s.material), s.roughness_m, np.asarray(s.mesh.vertices), np.asarray(s.mesh.faces), part)
            for part, scene in (("room", self.room), ("kept", self.kept)) for s in scene
        ]  # fmt: skip
        return {
            "surfaces": surfaces, "radar": self.radar.to_dict(), "sensor": np.round(self.sensor_poses, 9),
            "motion": {name: np.round(poses, 9) for name, poses in self.motion.items()}, "families": self.families,
            "distance": np.round(self.log.distance_m, 9), "angle": None if self.log.angle_rad is None else np.round(self.log.angle_rad, 9),
        }  # fmt: skip


def thinned(
    room: Scene, kept: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray], log: Log,
    families: Sequence[str], variant: str = "auto", count: int | None = None, between: bool = False,
) -> Probe:  # fmt: skip
    """A probe of a recording: `count` evenly spaced aspects of its first revolution (default ASPECTS) or places of its drive (PLACES).

    Args:
        sensor_poses, motion: (F or 1, 4, 4). log: of F frames. between: shift by half a step, between the frames of the usual probe.
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
    """Frame positions at which a revolution passes evenly spaced angles; its first frame follows its last."""
    turned = np.unwrap(angle_rad) - angle_rad[0]
    step = float(np.median(np.abs(np.diff(turned))))
    whole = round(2 * np.pi / step)
    return (np.arange(count) + 0.5 * between) * whole / count


def _places(frames: int, count: int, between: bool) -> np.ndarray:
    """Evenly spaced frame positions from the first to the last frame of a drive."""
    if frames <= count:
        return np.arange(frames) + 0.5 * between * (np.arange(frames) < frames - 1)
    return (np.arange(count) + 0.5) * (frames - 1) / count if between else np.linspace(0, frames - 1, count)


def _along(poses: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Poses (F, 4, 4) interpolated at frame positions; the first pose follows the last."""
    known = np.concatenate([poses, poses[:1]]) if at.max() > len(poses) - 1 else poses
    times = np.arange(len(known))
    found = np.tile(np.eye(4), (len(at), 1, 1))
    found[:, :3, :3] = Slerp(times, Rotation.from_matrix(known[:, :3, :3]))(at).as_matrix()
    found[:, :3, 3] = np.stack([np.interp(at, times, column) for column in known[:, :3, 3].T], axis=1)
    return found
