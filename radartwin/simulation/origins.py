"""Find the surface of a scene from which a detected echo comes.

A path ends at its last hit, the point `length_out_m` from the sensor along `arrival` (see radartwin.simulation.paths). The surface that
holds this point is the end of the path. For each detected peak, the module synthesises the paths that end at one surface without all other
paths, and processes them like a recording. The surface whose own paths have the largest power at the range and azimuth of the peak is the
origin of the peak. Paths of several reflections occur in both directions, so that the first and the last surface have equal power.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from radartwin.radar.angles import azimuth_spectrum
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import range_fft
from radartwin.scene.scene import Scene
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import received

ON_SURFACE_M = 0.005  # a hit belongs to a surface within this distance, because outlines and single precision move hits by millimetres
LOBE_BINS = 3.0  # paths farther from a peak than this number of range bins are beyond the main lobe of the Hann window (2 bins)
_PADDING = 16  # bins of a range profile per sample, so that the scalloping loss at a peak is below 0.02 dB


@dataclass(frozen=True)
class Origin:
    """The origin of a detected peak.

    Attributes:
        surface: name of the surface from which the strongest part of the peak comes; "" if no path reaches the range of the peak.
        level_db: power of the paths that end at this surface, relative to the power of all paths, at the range and azimuth of the peak, in
            decibels. The level is about 0 if the peak is the echo of one surface. The level may be above 0 if other surfaces weaken the
            peak.
    """

    surface: str
    level_db: float


def echo_origins(
    scene: Scene, parts: Sequence[Paths], radar: Radar, sensor_pose: np.ndarray, range_m: ArrayLike, azimuth_rad: ArrayLike
) -> list[Origin]:
    """Return the origin of each of K peaks of a scene at rest.

    Args:
        scene: surfaces in world coordinates, with distinct names.
        parts: propagation paths of one sensor pose in this scene, as `trace_paths` returns them.
        radar: radar that recorded the peaks.
        sensor_pose: (4, 4) transformation from the sensor frame to the world.
        range_m, azimuth_rad: (K,) positions of the peaks, the azimuth in radians positive to the left (see radartwin.radar.detection).
    """
    ranges, azimuths = np.atleast_1d(np.asarray(range_m, float)), np.atleast_1d(np.asarray(azimuth_rad, float))
    reach_m = LOBE_BINS * radar.range_resolution_m
    near = [part.where(np.flatnonzero((np.abs(part.length_m[:, None] / 2 - ranges) < reach_m).any(axis=1))) for part in parts]
    ends = [last_surfaces(scene, part, sensor_pose) for part in near]
    total = _power(near, radar, ranges, azimuths)
    names = [index for index in range(len(scene)) if any((end == index).any() for end in ends)]
    alone = [
        _power([part.where(np.flatnonzero(end == index)) for part, end in zip(near, ends, strict=True)], radar, ranges, azimuths)
        for index in names
    ]
    origins = []
    for peak, power in enumerate(total):
        best = max(range(len(names)), key=lambda i: alone[i][peak], default=None)
        if best is None or not alone[best][peak] > 0 or not power > 0:
            origins.append(Origin("", float("-inf")))
        else:
            origins.append(Origin(scene.names[names[best]], float(10 * np.log10(alone[best][peak] / power))))
    return origins


def last_surfaces(scene: Scene, paths: Paths, sensor_pose: np.ndarray) -> np.ndarray:
    """Return for each of N paths the index of the surface in the scene at which the path was last reflected or diffracted, (N,).

    The index is -1 if no surface is within ON_SURFACE_M of the last hit.
    """
    points = sensor_pose[:3, 3] + (paths.arrival * paths.length_out_m[:, None]) @ sensor_pose[:3, :3].T
    nearest, surfaces = np.full(len(points), ON_SURFACE_M), np.full(len(points), -1)
    for index, surface in enumerate(scene):
        away = distances_m(surface.mesh, points, ON_SURFACE_M)
        closer = away < nearest
        nearest[closer], surfaces[closer] = away[closer], index
    return surfaces


def distances_m(mesh: trimesh.Trimesh, points: np.ndarray, within_m: float) -> np.ndarray:
    """Return the distances (N,) of points (N, 3) from a mesh in metres; infinity for points farther away than `within_m`."""
    nearest = np.full(len(points), np.inf)
    low, high = mesh.bounds
    inside = np.flatnonzero(((points > low - within_m) & (points < high + within_m)).all(axis=1))
    if not len(inside):
        return nearest
    triangles = np.asarray(mesh.triangles)
    centres = triangles.mean(axis=1)
    radii = np.linalg.norm(triangles - centres[:, None], axis=2).max(axis=1) + within_m
    near = KDTree(points[inside]).query_ball_point(centres, radii)
    triangle = np.repeat(np.arange(len(triangles)), [len(rows) for rows in near])
    row = inside[np.concatenate(near).astype(int)]
    closest = trimesh.triangles.closest_point(triangles[triangle], points[row])
    np.minimum.at(nearest, row, np.linalg.norm(closest - points[row], axis=1))
    return np.where(nearest <= within_m, nearest, np.inf)


def _power(parts: Sequence[Paths], radar: Radar, range_m: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
    """Return the power (K,) of paths at the ranges and azimuths of K peaks, from the mean of the chirps of one frame."""
    if not any(len(part) for part in parts):
        return np.zeros(len(range_m))
    iq = received(parts, radar, 1)[0].mean(axis=0)
    profiles, axis = range_fft(iq, radar, bins=_PADDING * radar.num_samples)
    cells = np.abs(axis[:, None] - range_m).argmin(axis=0)
    return np.array(
        [azimuth_spectrum(profiles[None, ..., cell], radar, [angle])[0] for cell, angle in zip(cells, azimuth_rad, strict=True)]
    ).astype(float)
