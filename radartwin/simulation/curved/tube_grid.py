"""Regular grids of ray tubes: from a phase centre over a solid angle, or parallel tubes of a plane wave.

Grids are regular because the tubes must cover the wavefront without gaps and overlaps. A random seed may shift the whole grid by a part of
a cell, but never a single ray within its tube.
"""

from dataclasses import dataclass

import numpy as np

from radartwin.compiled import compiled

MARGIN = 1  # cells added around the bounding box of a facet
MIN_DEPTH = 1e-3  # smallest depth of a corner in front of the source, relative to its distance


@dataclass(frozen=True)
class TubeGrid:
    """Describe a regular grid of tubes per pose, in the geometry's frame."""

    source: np.ndarray  # (F, 3) phase centres; for a plane wave, points on the start plane
    forward: np.ndarray  # (F, 3); forward, u_axis and v_axis are orthonormal
    u_axis: np.ndarray
    v_axis: np.ndarray
    low_u: np.ndarray  # (F,) centre of the first tube, in the plane at unit distance (for a plane wave, in metres)
    low_v: np.ndarray
    step_u: np.ndarray  # (F,) grid spacing, in the unit of low_u and low_v
    step_v: np.ndarray
    count_u: int  # tubes along each axis, the same for all poses
    count_v: int
    plane: bool = False  # whether the wave is a plane wave along `forward` instead of a spherical wave

    @property
    def poses(self) -> int:
        return len(self.source)

    @property
    def per_pose(self) -> int:
        return self.count_u * self.count_v


def frame_towards(forward: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return orthonormal vectors (forward, u, v), each (F, 3), with u horizontal unless `forward` is vertical."""
    forward = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    up = np.where(np.abs(forward[:, 2:3]) < 0.99, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u_axis = np.cross(up, forward)
    u_axis /= np.linalg.norm(u_axis, axis=-1, keepdims=True)
    return forward, u_axis, np.cross(forward, u_axis)


def _grid(low: np.ndarray, high: np.ndarray, step: np.ndarray, shift: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Return (centre of the first tube, step, count) of whole cells that cover the interval [low, high] of every pose.

    The cells fit the interval exactly, so that the edges of a plate seen from its front fall between two tubes.
    """
    cells = np.maximum(np.ceil((high - low) / step - 1e-9), 1)
    fitted = np.maximum((high - low) / cells, 1e-3 * step)
    return low + (0.5 - shift) * fitted, fitted, int(cells.max()) + 1


def towards(
    points: np.ndarray, source: np.ndarray, centre: np.ndarray, cell_m: float, shift: tuple[float, float], plane: bool = False
) -> TubeGrid | None:
    """Build a grid of tubes from each source over the bounding box of the points in its view.

    Args:
        points: (V, 3) hull points of the target.
        source: (F, 3) phase centres; for a plane wave, any point towards the radar.
        centre: (3,) middle of the target. cell_m: width of a tube at the middle.
        shift: offset of the grid in cells, each in [0, 1).
        plane: whether the rays are parallel to the direction to the centre.
    Returns:
        The grid, or None if a source is inside or too close to the target for one planar grid.
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
    return TubeGrid(source, forward, u_axis, v_axis, low_u, low_v, step_u, step_v, count_u, count_v, plane)


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


def all_around(source: np.ndarray, rotation: np.ndarray, rays: int, faces: int = 6) -> list[TubeGrid]:
    """Build grids of tubes over the sphere, one grid per face of a cube in the sensor's frame.

    Cells of neighbouring cube faces meet at the common edge, where their hat weights overlap symmetrically.

    Args:
        source: (F, 3) phase centres.
        rotation: (F, 3, 3) sensor-to-world rotations.
        rays: number of tubes per pose over six faces.
        faces: 6 for the whole sphere, 5 without the face behind the sensor.
    """
    cells = max(2, round(np.sqrt(rays / 6)))
    step = np.full(len(source), 2 / cells)
    low = np.full(len(source), -1 + 1 / cells)
    grids = []
    for axes in _CUBE[:faces]:
        forward, u_axis, v_axis = (np.einsum("fij,j->fi", rotation, axis) for axis in axes)
        grids.append(TubeGrid(source, forward, u_axis, v_axis, low, low, step, step, cells, cells))
    return grids


def covered(grid: TubeGrid, pose: int, corners: np.ndarray) -> np.ndarray | None:
    """Return the cells of one pose, ascending, whose centre ray can meet a facet; None if a facet is not in front of the source.

    A large object seen from near may fill a few percent of its grid.

    Args:
        corners: (N, 3, 3) corners of the facets, in the grid's frame.
    """
    relative = corners - grid.source[pose]
    u, v = relative @ grid.u_axis[pose], relative @ grid.v_axis[pose]
    if not grid.plane:
        depth = relative @ grid.forward[pose]
        if (depth <= MIN_DEPTH * np.linalg.norm(relative, axis=-1)).any():
            return None
        u, v = u / depth, v / depth
    u, v = (u - grid.low_u[pose]) / grid.step_u[pose], (v - grid.low_v[pose]) / grid.step_v[pose]
    u, v = u.clip(-2 - MARGIN, grid.count_u + 1 + MARGIN), v.clip(-2 - MARGIN, grid.count_v + 1 + MARGIN)
    seen = np.zeros((grid.count_v, grid.count_u), np.bool_)
    _mark(seen, u, v)
    return np.flatnonzero(seen)


@compiled
def _mark(seen: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
    """Mark the cells in the bounding boxes of facets. The corners u, v (N, 3) are in units of cells."""
    rows, columns = seen.shape
    for n in range(len(u)):
        left, right = max(0, int(np.floor(u[n].min())) - MARGIN), min(columns, int(np.ceil(u[n].max())) + MARGIN + 1)
        below, above = max(0, int(np.floor(v[n].min())) - MARGIN), min(rows, int(np.ceil(v[n].max())) + MARGIN + 1)
        for i in range(below, above):
            for k in range(left, right):
                seen[i, k] = True
