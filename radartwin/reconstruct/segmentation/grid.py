"""Define a grid of square cells on a plane. Boolean masks on this grid mark covered, hidden or empty cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARGIN_M = 0.2


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid of square cells on a plane.

    Attributes:
        normal, offset_m: unit normal (3,) and distance from the origin in metres of the plane normal . x = offset_m.
        axes: (2, 3) unit vectors in the plane; for an upright plane the first is horizontal and the second points upward.
        low: (2,) in-plane coordinates in metres of the corner of the first cell.
        shape: numbers of cells along the two axes.
        cell_m: edge length of a cell in metres.
    """

    normal: np.ndarray
    offset_m: float
    axes: np.ndarray
    low: np.ndarray
    shape: tuple[int, int]
    cell_m: float

    @classmethod
    def around(cls, points: np.ndarray, normal: np.ndarray, offset_m: float, cell_m: float, angle_rad: float = 0.0) -> Grid:
        """Make a grid that covers points (N, 3) with a margin. The grid axes are the vectors of `in_plane`, rotated by `angle_rad`."""
        axes = np.array([[np.cos(angle_rad), np.sin(angle_rad)], [-np.sin(angle_rad), np.cos(angle_rad)]]) @ in_plane(normal)
        flat = points @ axes.T
        low, high = flat.min(axis=0) - MARGIN_M, flat.max(axis=0) + MARGIN_M
        x, y = np.ceil((high - low) / cell_m).astype(int) + 1
        return cls(normal, offset_m, axes, low, (int(x), int(y)), cell_m)

    def counts(self, points: np.ndarray) -> np.ndarray:
        """Return how many of the points (N, 3), projected along the plane's normal, lie in each cell."""
        at = np.floor((points @ self.axes.T - self.low) / self.cell_m).astype(int)
        at = at[((at >= 0) & (at < np.array(self.shape))).all(axis=1)]
        return np.bincount(at[:, 0] * self.shape[1] + at[:, 1], minlength=self.shape[0] * self.shape[1]).reshape(self.shape)

    def area(self, mask: np.ndarray) -> float:
        """Return the area in m2 of the cells that a boolean mask marks."""
        return float(mask.sum()) * self.cell_m**2

    def to_space(self, flat: np.ndarray) -> np.ndarray:
        """Convert in-plane coordinates (N, 2) in metres to world points (N, 3)."""
        return np.asarray(flat) @ self.axes + self.offset_m * self.normal


def in_plane(normal: np.ndarray) -> np.ndarray:
    """Return two unit vectors (2, 3) in the plane with this normal, right-handed with the normal.

    For an upright plane, the first vector is horizontal and the second vector points upward.
    """
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    across = np.cross(up, normal)
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(normal, across)])
