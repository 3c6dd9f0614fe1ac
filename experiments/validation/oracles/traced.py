"""RadarTwin's values for the comparisons with references: paths and fields of a scene by a chosen tracing method."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import trimesh
from scipy.interpolate import BarycentricInterpolator

import radartwin as rt
from experiments.validation.oracles.case import SPEED_OF_LIGHT
from radartwin.simulation.backends.mitsuba import TraceSettings
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import synthesize
from radartwin.simulation.simulate import trace_paths

ORIGIN = ((0.0, 0.0, 0.0),)
ARRAY = rt.Radar.iwr1843(element="isotropic")
MONOSTATIC = replace(ARRAY, tx_positions_m=ORIGIN, rx_positions_m=ORIGIN, num_chirps=1)
METHODS = {"tubes": "tubes alone", "panels": "flat faces"}


def settings(method: str, **values: Any) -> TraceSettings:
    """Return the ray tracer's settings for a method of METHODS, with mirror reflections only; `rays` applies to ray tubes."""
    values = {"room": method, "diffuse": False, "coupling": False, **values}
    if method == "panels":
        values.pop("rays", None)
    return TraceSettings(**values)


def trace(scene: rt.Scene, radar: rt.Radar, pose: np.ndarray, trace_settings: TraceSettings) -> list[Paths]:
    """Trace the paths of one sensor pose and return them as a list of path groups."""
    return trace_paths(scene, radar, pose[None], None, trace_settings)[0]


def field(parts: Sequence[Paths], frequency_hz: float) -> complex:
    """Return the sum of all paths between isotropic antennas at one frequency, interpolated between the nodes of the tracer."""
    total = 0j
    for paths in parts:
        nodes = paths.frequencies_hz
        amplitude = paths.amplitude[:, 0] if len(nodes) == 1 else BarycentricInterpolator(nodes, paths.amplitude.T)(frequency_hz)
        total += complex((amplitude * np.exp(2j * np.pi * frequency_hz / SPEED_OF_LIGHT * paths.length_m)).sum())
    return total


def sweep(parts: Sequence[Paths], radar: rt.Radar) -> np.ndarray:
    """Return the samples (samples,) of the first chirp and the first channel."""
    return sum((synthesize(part, radar)[0, 0, 0, 0] for part in parts), np.zeros(radar.num_samples, complex))


def frequencies(radar: rt.Radar) -> np.ndarray:
    """Return the instantaneous frequency (samples,) in hertz at each sample of a chirp."""
    return radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz


def pose(position: Sequence[float] | np.ndarray, rotation: np.ndarray | None = None) -> np.ndarray:
    """Return the pose (4, 4) from sensor frame to world frame, for a position (3,) in metres and a rotation matrix."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if rotation is None else rotation
    matrix[:3, 3] = position
    return matrix


def polygon(corners: np.ndarray) -> trimesh.Trimesh:
    """Return a convex polygon as a mesh: a fan of triangles with flat normals."""
    faces = [[0, i, i + 1] for i in range(1, len(corners) - 1)]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normals = np.tile(normal / np.linalg.norm(normal), (len(corners), 1))
    return trimesh.Trimesh(corners, faces, vertex_normals=normals, process=False)
