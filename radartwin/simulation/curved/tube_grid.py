"""Regular grids of tubes: from a phase centre over a solid angle, or in parallel from far away.

A tube carries the solid angle (or area) it stands for and its two footprint vectors, the derivatives of its direction (or
position) along the grid. Grids are regular because the tubes' integrals tile the wavefront only then; a seed may
shift the whole grid by part of a cell, never one ray within its tube.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Launch:
    """A grid of tubes per pose, in the geometry's frame.

    Attributes:
        source: (F, 3) phase centres; for a plane wave, points on the launch plane.
        forward, u_axis, v_axis: (F, 3) orthonormal.
        low_u, low_v: (F,) coordinates of the first tube's centre in the plane at unit distance (plane wave: metres).
        step_u, step_v: (F,) grid spacing in the same unit.
        count_u, count_v: tubes along each axis, the same for all poses.
        plane: a plane wave along `forward` instead of a spherical one.
    """

    source: np.ndarray
    forward: np.ndarray
    u_axis: np.ndarray
    v_axis: np.ndarray
    low_u: np.ndarray
    low_v: np.ndarray
    step_u: np.ndarray
    step_v: np.ndarray
    count_u: int
    count_v: int
    plane: bool = False

    @property
    def poses(self) -> int:
        return len(self.source)

    @property
    def per_pose(self) -> int:
        return self.count_u * self.count_v


def frame_towards(forward: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orthonormal (forward, u, v), each (F, 3), with u horizontal where it can be."""
    forward = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    up = np.where(np.abs(forward[:, 2:3]) < 0.99, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u_axis = np.cross(up, forward)
    u_axis /= np.linalg.norm(u_axis, axis=-1, keepdims=True)
    return forward, u_axis, np.cross(forward, u_axis)


def _grid(low: np.ndarray, high: np.ndarray, step: np.ndarray, shift: float) -> tuple[np.ndarray, np.ndarray, int]:
    """(first tube centre, step, count) that cover [low, high] of every pose with whole cells.

    Fitting the cells to the box puts the edges of a plate seen face-on between two tubes, where their position is exact.
    """
    cells = np.maximum(np.ceil((high - low) / step - 1e-9), 1)
    fitted = np.maximum((high - low) / cells, 1e-3 * step)
    return low + (0.5 - shift) * fitted, fitted, int(cells.max()) + 1


def towards(
    points: np.ndarray, source: np.ndarray, centre: np.ndarray, cell_m: float, shift: tuple[float, float], plane: bool = False
) -> Launch | None:
    """Tubes from each source over the bounding box of the points as seen from there.

    Args:
        points: (V, 3) hull points of the target.
        source: (F, 3) phase centres; for a plane wave, any point towards the radar.
        centre: (3,) where `cell_m` is measured.
        cell_m: side of a tube at the centre.
        shift: offset of the grid in cells, each in [0, 1).
        plane: parallel rays instead.
    Returns:
        The launch, or None where some source is inside or too close to the target for one planar grid.
    """
    offset = centre - source
    distance = np.linalg.norm(offset, axis=-1)
    forward, u_axis, v_axis = frame_towards(offset)
    relative = points[None] - source[:, None]
    depth = np.einsum("fvi,fi->fv", relative, forward)
    across_u = np.einsum("fvi,fi->fv", relative, u_axis)
    across_v = np.einsum("fvi,fi->fv", relative, v_axis)
    if plane:
        step = np.full(len(source), cell_m)
    else:
        if (depth <= 0.2 * distance[:, None]).any():
            return None
        across_u, across_v = across_u / depth, across_v / depth
        if max(np.abs(across_u).max(), np.abs(across_v).max()) > 4:
            return None
        step = cell_m / distance
    low_u, step_u, count_u = _grid(across_u.min(1), across_u.max(1), step, shift[0])
    low_v, step_v, count_v = _grid(across_v.min(1), across_v.max(1), step, shift[1])
    return Launch(source, forward, u_axis, v_axis, low_u, low_v, step_u, step_v, count_u, count_v, plane)


_CUBE = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    ],
    float,
)


def all_around(source: np.ndarray, rotation: np.ndarray, rays: int, faces: int = 6) -> list[Launch]:
    """Tubes over the sphere as the faces of a cube in the sensor's frame.

    The cells of neighbouring faces meet at the seams, and a hat reaches as far beyond a seam as its neighbour reaches back.

    Args:
        source: (F, 3) phase centres.
        rotation: (F, 3, 3) sensor-to-world rotations.
        rays: tubes per pose over six faces.
        faces: 6 for the sphere, 5 to leave out the face behind the sensor.
    """
    cells = max(2, round(np.sqrt(rays / 6)))
    step = np.full(len(source), 2 / cells)
    low = np.full(len(source), -1 + 1 / cells)
    launches = []
    for axes in _CUBE[:faces]:
        forward, u_axis, v_axis = (np.einsum("fij,j->fi", rotation, axis) for axis in axes)
        launches.append(Launch(source, forward, u_axis, v_axis, low, low, step, step, cells, cells))
    return launches
