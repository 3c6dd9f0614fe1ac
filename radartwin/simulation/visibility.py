"""Find the single-bounce paths that other bodies block. The ray tracer Mitsuba casts a ray between the sensor and the point of each path.

`hidden` finds the blocked paths of a moving body. `negated` returns the blocked paths of static surfaces with opposite amplitude. The paths
of static surfaces can therefore stay in a cache, and their sum with the negated paths has no paths through moving bodies.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths

LANES = 200_000  # number of pairs of a path and a frame examined at once, which need about 30 MB
SHORT = 1e-4  # a ray ends at this fraction of its length before the point, so that it does not hit the surface of the point


@dataclass(frozen=True)
class Occluder:
    """Describe a body that can block the line between sensor and another body."""

    geometry: Geometry  # triangles of the blocking body
    rotation: np.ndarray  # (F, 3, 3) rotation matrices from the frame of the paths to the body's frame, for F sensor poses
    translation: np.ndarray  # (F, 3) translations between the same frames, in metres


def visible(geometry: Geometry, start: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of the lines that no surface blocks.

    Args:
        geometry: blocking surfaces.
        start: (N, 3) start points of the lines in metres.
        direction: (N, 3) unit directions of the lines.
        distance: (N,) length of the lines in metres.
    """
    import mitsuba as mi

    if not len(distance) or not len(geometry.corners):
        return np.ones(len(distance), bool)

    from radartwin.simulation.drjit_arrays import upload, vectors

    ray: Any = mi.Ray3f(vectors(start), vectors(direction))
    ray.maxt = upload(mi.Float, distance * (1 - SHORT))
    return ~geometry.scene.ray_test(ray).numpy()


def hidden(paths: Paths, sensor: np.ndarray, obstacles: Sequence[Occluder]) -> np.ndarray:
    """Return a mask (N,) of the single-bounce paths whose line from sensor to point an obstacle blocks.

    Args:
        paths: N single-bounce paths at F sensor poses.
        sensor: (F, 4, 4) transformations from the sensor frame to the frame of the points.
        obstacles: other bodies, with their transformations from the frame of the points for F sensor poses or for one pose.
    """
    out = np.zeros(len(paths), bool)
    for first in range(0, len(paths), LANES):
        block = slice(first, first + LANES)
        out[block] = _blocked(paths.pose[block], paths.departure[block], paths.length_in_m[block], sensor, obstacles)
    return out


def negated(paths: Paths, sensor: np.ndarray, obstacles: Sequence[Occluder]) -> Paths:
    """Return the blocked paths of static surfaces, with opposite amplitude.

    Args:
        paths: single-bounce paths at F sensor poses, or at one pose that is valid for all F poses.
        sensor, obstacles: as in `hidden`; the frame of the points is the world.
    """
    parts = [(np.zeros(0, int), np.zeros(0, int))]
    for frame, row in pairs(paths, len(sensor)):
        blocked = _blocked(frame, paths.departure[row], paths.length_in_m[row], sensor, obstacles)
        parts.append((frame[blocked], row[blocked]))
    frame, row = (np.concatenate(column) for column in zip(*parts, strict=True))
    copies = paths.where(row)
    return replace(copies, poses=len(sensor), pose=frame, amplitude=-copies.amplitude)


def pairs(paths: Paths, frames: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the frame and the row in `paths` of all paths of all frames, in blocks of about LANES pairs."""
    if paths.poses == frames:
        for first in range(0, len(paths), LANES):
            row = np.arange(first, min(first + LANES, len(paths)))
            yield paths.pose[row], row
        return
    step = max(1, LANES // max(len(paths), 1))
    for first in range(0, frames, step):
        block = np.arange(first, min(first + step, frames))
        yield np.repeat(block, len(paths)), np.tile(np.arange(len(paths)), len(block))


def _blocked(
    frame: np.ndarray, direction: np.ndarray, distance: np.ndarray, sensor: np.ndarray, obstacles: Sequence[Occluder]
) -> np.ndarray:
    """Return a mask (N,) of the lines from the sensor, of directions (N, 3) in the sensor frame, that an obstacle blocks."""
    out = np.zeros(len(frame), bool)
    for obstacle in obstacles:
        rotation = obstacle.rotation @ sensor[:, :3, :3]
        place = np.einsum("fij,fj->fi", np.broadcast_to(obstacle.rotation, rotation.shape), sensor[:, :3, 3]) + obstacle.translation
        along = np.einsum("nij,nj->ni", rotation[frame], direction)
        # Only lines through the sphere around the obstacle need a ray.
        across = obstacle.geometry.centre - place[frame]
        nearest = np.clip(np.einsum("ni,ni->n", across, along), 0, distance)
        near = np.flatnonzero(np.linalg.norm(across - nearest[:, None] * along, axis=1) <= obstacle.geometry.radius_m)
        out[near] |= ~visible(obstacle.geometry, place[frame[near]], along[near], distance[near])
    return out
