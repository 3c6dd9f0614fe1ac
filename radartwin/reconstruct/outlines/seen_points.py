"""Test whether points are visible from the camera positions, or whether occupied voxels of the scan hide the points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radartwin.reconstruct.segmentation.masks import distance

VOXEL_M = 0.06
EYE_M = 1.5  # height of a hand-held phone above the floor
CLEAR_M = 0.3  # smallest distance between an assumed standing person and objects
SHORT_M = 0.18  # lines of sight end this far before the surface, so that the surface itself does not block them
RANGE_M = 5.0  # range of phone LiDAR
GRAZING = np.cos(np.radians(75.0))
VIEWPOINTS = 60


@dataclass(frozen=True, eq=False)
class Cameras:
    """V cameras of a scan: camera-to-world poses (V, 4, 4) with OpenCV axes, and common intrinsics (3, 3) and
    picture size (width, height).
    """

    poses: np.ndarray
    intrinsics: np.ndarray
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Sight:
    """Tests whether points are visible from the actual or possible viewpoints of a scan, or hidden by occupied voxels of the scan.

    Attributes:
        occupied: (X, Y, Z) boolean mask of the occupied voxels.
        low: (3,) lowest corner of the voxel array, metres.
        viewpoints: (V, 3) positions from which visibility is tested, metres.
        cameras: the cameras at the viewpoints; None if the cameras are unknown.
    """

    occupied: np.ndarray
    low: np.ndarray
    viewpoints: np.ndarray
    cameras: Cameras | None = None

    @classmethod
    def of(cls, points: np.ndarray, cameras: Cameras | None = None) -> Sight:
        """Make the visibility test from points (N, 3) on the scan. Without cameras, the viewpoints are free positions at eye height."""
        low = points.min(axis=0) - VOXEL_M
        index = ((points - low) / VOXEL_M).astype(int)
        occupied = np.zeros(tuple(index.max(axis=0) + 2), dtype=bool)
        occupied[tuple(index.T)] = True
        if cameras is not None:
            return cls(occupied, low, cameras.poses[:, :3, 3], cameras)
        places = _standing(occupied, low)
        return cls(occupied, low, places[:: max(1, -(-len(places) // VIEWPOINTS))])

    def seen(self, places: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Return how many viewpoints see each of the points `places` (N, 3) on a plane with this normal, within the sensor's range."""
        count = np.zeros(len(places), dtype=int)
        for number, eye in enumerate(self.viewpoints):
            ray = eye - places
            length = np.linalg.norm(ray, axis=1)
            possible = (ray @ normal > GRAZING * length) & (length < RANGE_M) & (length > 2 * SHORT_M)
            if self.cameras is not None:
                possible &= self._in_picture(number, places)
            if possible.any():
                count[possible] += ~self._blocked(places[possible], ray[possible], length[possible])
        return count

    def _in_picture(self, number: int, places: np.ndarray) -> np.ndarray:
        assert self.cameras is not None
        pose, (width, height) = self.cameras.poses[number], self.cameras.size
        x, y, z = ((places - pose[:3, 3]) @ pose[:3, :3]).T
        k, far = self.cameras.intrinsics, np.maximum(z, 1e-9)
        u, v = k[0, 0] * x / far + k[0, 2], k[1, 1] * y / far + k[1, 2]
        return (z > 0) & (u > 0) & (u < width - 1) & (v > 0) & (v < height - 1)

    def _blocked(self, places: np.ndarray, ray: np.ndarray, length: np.ndarray) -> np.ndarray:
        steps = int(np.ceil(length.max() / (VOXEL_M * 0.7)))
        along = np.linspace(0, 1, steps)[None] * (1 - SHORT_M / length)[:, None] + (SHORT_M / length)[:, None]
        at = places[:, None] + along[..., None] * ray[:, None]
        index = ((at - self.low) / VOXEL_M).astype(int)
        inside = np.all((index >= 0) & (index < np.array(self.occupied.shape)), axis=2)
        index = np.where(inside[..., None], index, 0)
        return np.any(self.occupied[index[..., 0], index[..., 1], index[..., 2]] & inside, axis=1)


def _standing(occupied: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Return positions (V, 3) at eye height above a floor where a person could stand, away from obstacles at body height."""
    level = min(int((EYE_M + VOXEL_M) / VOXEL_M), occupied.shape[2] - 1)
    body = np.asarray(occupied[:, :, level // 2 : level + 1].any(axis=2))
    floor = occupied[:, :, : max(1, level // 4)].any(axis=2)
    free = (VOXEL_M * distance(body) > CLEAR_M) & floor
    x, y = np.nonzero(free)
    every = max(1, int(0.5 / VOXEL_M))
    kept = (x % every == 0) & (y % every == 0)
    return np.column_stack([low[:2] + (np.column_stack([x, y])[kept] + 0.5) * VOXEL_M, np.full(kept.sum(), low[2] + VOXEL_M + EYE_M)])
