"""The simulator `echoes`: every surface is a point target at its vertex nearest to the radar."""

from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.paths import Paths


@dataclass(frozen=True)
class EchoSettings:
    cross_section_m2: float = 1.0
    label: str | None = None


@dataclass(frozen=True)
class EchoBackend:
    settings: EchoSettings = EchoSettings()
    name = "echoes"

    def paths(self, scene, radar, sensor_poses, motion=None, track=None):
        if self.settings.label == "broken":
            raise RuntimeError("the solver broke\nin two lines")
        return [self.part(surface, radar, sensor_poses, (motion or {}).get(surface.name, np.eye(4)[None])) for surface in scene]

    def part(self, surface, radar, sensor_poses, object_poses):
        seen_from = np.linalg.inv(sensor_poses) @ object_poses
        vertices = np.einsum("fij,vj->fvi", seen_from[:, :3, :3], surface.mesh.vertices) + seen_from[:, None, :3, 3]
        frames = np.arange(len(vertices))
        nearest = vertices[frames, np.linalg.norm(vertices, axis=2).argmin(axis=1)]
        distance = np.linalg.norm(nearest, axis=1)
        wavelength = SPEED_OF_LIGHT / radar.center_frequency_hz
        level = wavelength * np.sqrt(self.settings.cross_section_m2 / (4 * np.pi) ** 3) / distance**2
        direction = nearest / distance[:, None]
        amplitude, frequency = level[:, None].astype(complex), np.array([radar.center_frequency_hz])
        bounces = np.ones(len(frames), int)
        return Paths(len(frames), frames, bounces, amplitude, frequency, distance, distance, direction, direction, 0 * distance)
