"""Define a grid of square cells on a plane. Masks on this grid mark covered, hidden or empty cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radartwin.reconstruct.segmentation.coplanar import in_plane

MARGIN_M = 0.2


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid of square cells on a plane.

    Attributes:
        normal, offset_m: the plane is normal . x = offset_m.
        axes: (2, 3) unit vectors in the plane; horizontal and upward if the plane is upright.
        low: (2,) in-plane coordinates of the first cell's corner.
        shape, cell_m: numbers of cells along both axes, and edge of a cell.
    """

    normal: np.ndarray
    offset_m: float
    axes: np.ndarray
    low: np.ndarray
    shape: tuple[int, int]
    cell_m: float

    @classmethod
    def around(cls, points: np.ndarray, normal: np.ndarray, offset_m: float, cell_m: float, turn: float = 0.0) -> Grid:
        """Make the grid around points (N, 3), with a margin. The axes are those of `in_plane`, rotated by `turn` radians."""
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ in_plane(normal)
        flat = points @ axes.T
        low, high = flat.min(axis=0) - MARGIN_M, flat.max(axis=0) + MARGIN_M
        x, y = np.ceil((high - low) / cell_m).astype(int) + 1
        return cls(normal, offset_m, axes, low, (int(x), int(y)), cell_m)

    def counts(self, points: np.ndarray) -> np.ndarray:
        """Count the points (N, 3), projected along the normal, in each cell."""
        at = np.floor((points @ self.axes.T - self.low) / self.cell_m).astype(int)
        at = at[((at >= 0) & (at < np.array(self.shape))).all(axis=1)]
        return np.bincount(at[:, 0] * self.shape[1] + at[:, 1], minlength=self.shape[0] * self.shape[1]).reshape(self.shape)

    def area(self, mask: np.ndarray) -> float:
        """Return the area of a mask, m2."""
        return float(mask.sum()) * self.cell_m**2

    def to_space(self, flat: np.ndarray) -> np.ndarray:
        """Convert in-plane coordinates (N, 2) to points (N, 3)."""
        return np.asarray(flat) @ self.axes + self.offset_m * self.normal
