"""Define regular grids of ray tubes, which start at a phase centre and cover a solid angle, or which are parallel (plane wave).

The grids are regular because the tubes must cover the wavefront without gaps and overlaps. A random seed may shift the whole grid by a
fraction of a cell, but it never moves a single ray within its tube.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

POINTS_AT_ONCE = 1 << 20  # number of points of a target in the views of `near`; it limits the memory
# Smallest ratio of a facet corner's depth (its distance along the viewing axis in front of the source) to its distance from the source.
MIN_DEPTH = 1e-3


@dataclass(frozen=True)
class TubeGrid:
    """Describe one regular grid of tubes for each of F sensor poses, in the geometry's frame."""

    source: np.ndarray  # (F, 3) phase centres in metres; for a plane wave, points on the start plane of the tubes
    forward: np.ndarray  # (F, 3) unit vectors along the middle of the grid; forward, u_axis and v_axis are orthonormal
    u_axis: np.ndarray  # (F, 3) unit vectors along the first grid axis
    v_axis: np.ndarray  # (F, 3) unit vectors along the second grid axis
    # (F,) u coordinate of the first tube's centre. For a spherical wave, the coordinate is measured in the plane at unit distance from the
    # source and has no unit. For a plane wave, it is in metres.
    low_u: np.ndarray
    low_v: np.ndarray  # (F,) v coordinate of the first tube's centre, in the unit of low_u
    step_u: np.ndarray  # (F,) spacing of the tubes along u_axis, in the unit of low_u
    step_v: np.ndarray  # (F,) spacing of the tubes along v_axis, in the unit of low_u
    count_u: int  # number of tubes along u_axis, the same for all poses
    count_v: int  # number of tubes along v_axis, the same for all poses
    plane: bool = False  # True for a plane wave along `forward`, False for a spherical wave from `source`

    @property
    def poses(self) -> int:
        return len(self.source)

    @property
    def per_pose(self) -> int:
        return self.count_u * self.count_v

    def rows(self, keep: np.ndarray | slice) -> "TubeGrid":
        """Return the grids of the sensor poses that an index array or a slice selects."""
        names = "source", "forward", "u_axis", "v_axis", "low_u", "low_v", "step_u", "step_v"
        return replace(self, **{name: getattr(self, name)[keep] for name in names})

    def covers(self, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return a mask (N,) of the points (N, 3) in the solid angle of the grid of each pose (N,). Grids around a place share no point."""
        way = points - self.source[pose]
        depth, u, v = (np.einsum("ni,ni->n", way, axis[pose]) for axis in (self.forward, self.u_axis, self.v_axis))
        out = depth > 0
        for at, low, step, count in ((u, self.low_u, self.step_u, self.count_u), (v, self.low_v, self.step_v, self.count_v)):
            cell = np.floor((at / np.maximum(depth, 1e-30) - low[pose]) / step[pose] + 0.5 + 1e-9)  # a point on the low side is inside
            out &= (cell >= 0) & (cell < count)
        return out

    def distinct(self, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the sensor poses that have different grids or axes (F, 3) of the transmit antenna, and for each pose the number (F,) of
        its grid and axis among these.
        """
        starts = self.source, self.forward, self.u_axis, self.low_u[:, None], self.low_v[:, None], axis
        _, first, which = np.unique(np.concatenate(starts, axis=1), axis=0, return_index=True, return_inverse=True)
        return first, which.ravel()


def frame_towards(forward: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return orthonormal vectors (forward, u, v), each (F, 3), with u horizontal unless `forward` is vertical."""
    forward = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    up = np.where(np.abs(forward[:, 2:3]) < 0.99, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u_axis = _cross(up, forward)
    u_axis /= np.linalg.norm(u_axis, axis=-1, keepdims=True)
    return forward, u_axis, _cross(forward, u_axis)


def _cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the cross products (F, 3) of vectors (F, 3). For few vectors, np.cross takes several times longer."""
    (ax, ay, az), (bx, by, bz) = first.T, second.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _grid(low: np.ndarray, high: np.ndarray, step: np.ndarray, shift: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Divide the interval [low, high] of every pose into grid cells of equal width, which is at most `step`.

    Whole cells fill the interval exactly, so that the edges of a plate seen from its front fall between two tubes.

    Returns:
        Coordinate of the first tube's centre (F,), cell width (F,), and number of cells, which is the same for all poses.
    """
    cells = np.maximum(np.ceil((high - low) / step - 1e-9), 1)
    fitted = np.maximum((high - low) / cells, 1e-3 * step)
    return low + (0.5 - shift) * fitted, fitted, int(cells.max()) + 1


def towards(
    points: np.ndarray, source: np.ndarray, centre: np.ndarray, cell_m: float, shift: tuple[float, float], plane: bool = False
) -> TubeGrid | None:
    """Build a grid of tubes from each source over the bounding box of the points in its view.

    Args:
        points: (V, 3) points of the target in metres, whose bounding box in every view contains the target.
        source: (F, 3) phase centres in metres; for a plane wave, any points in the direction of the radar.
        centre: (3,) middle of the target in metres.
        cell_m: width of a tube at the middle of the target, in metres.
        shift: offsets of the grid along its two axes, in cells, each in [0, 1).
        plane: True for parallel rays along the direction from `source` to `centre`, False for rays that start at `source`.
    Returns:
        The grid, or None if a source is inside the target or too close to it for one planar grid.
    """
    forward, u_axis, v_axis, across_u, across_v, close = _view(points, source, centre, plane)
    if close.any():
        return None
    step = np.full(len(source), cell_m) if plane else cell_m / np.linalg.norm(centre - source, axis=-1)
    low_u, step_u, count_u = _grid(across_u.min(1), across_u.max(1), step, shift[0])
    low_v, step_v, count_v = _grid(across_v.min(1), across_v.max(1), step, shift[1])
    return TubeGrid(source, forward, u_axis, v_axis, low_u, low_v, step_u, step_v, count_u, count_v, plane)


def near(points: np.ndarray, source: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Return a mask (F,) of the sources that are inside the target or too close to it for one planar grid; arguments as in `towards`."""
    out = np.zeros(len(source), bool)
    reach = np.linalg.norm(points - centre, axis=1).max(initial=0.0)
    # farther away, all depths are above 0.2 times the distance, and all coordinates in the view are below 4
    doubtful = np.flatnonzero(np.linalg.norm(source - centre, axis=1) < 1.3 * reach)
    step = max(1, POINTS_AT_ONCE // max(len(points), 1))
    for first in range(0, len(doubtful), step):
        rows = doubtful[first : first + step]
        out[rows] = _view(points, source[rows], centre, False)[5]
    return out


def _view(points: np.ndarray, source: np.ndarray, centre: np.ndarray, plane: bool) -> tuple[np.ndarray, ...]:
    """Return the axes (F, 3) of the grids towards the target, the coordinates u and v (F, V) of its points in the view, and a mask (F,) of
    the sources that are too close.
    """
    offset = centre - source
    forward, u_axis, v_axis = frame_towards(offset)
    depth, u, v = (np.einsum("fvi,fi->fv", points[None] - source[:, None], axis) for axis in (forward, u_axis, v_axis))
    if plane:
        return forward, u_axis, v_axis, u, v, np.zeros(len(source), bool)
    close = (depth <= 0.2 * np.linalg.norm(offset, axis=-1, keepdims=True)).any(axis=1)
    depth = np.where(close[:, None], np.inf, depth)
    u, v = u / depth, v / depth
    return forward, u_axis, v_axis, u, v, close | (np.maximum(np.abs(u), np.abs(v)).max(axis=1) > 4)


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


def cube_faces(points: np.ndarray, source: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return the faces of the cube of `all_around` that may have tubes towards the convex hull of points (V, 3), for one source (3,) and
    rotation (3, 3).
    """
    depth, u, v = np.moveaxis((points - source) @ rotation @ np.swapaxes(_CUBE, 1, 2), 2, 0)  # each (6, V)
    beyond = [(side > depth).all(axis=1) for side in (u, -u, v, -v)]  # all points lie outside the same side of the pyramid
    return np.flatnonzero(~np.any([*beyond, (depth < 0).all(axis=1)], axis=0))


def all_around(source: np.ndarray, rotation: np.ndarray, rays: int, faces: Iterable[int] = range(6)) -> list[TubeGrid]:
    """Build grids of tubes over all directions around the sensor, one grid per face of a cube in the sensor's frame.

    Cells of neighbouring cube faces meet at the common edge of the faces, where the hat weights of their tubes overlap symmetrically.

    Args:
        source: (F, 3) phase centres in metres.
        rotation: (F, 3, 3) rotation matrices from the sensor frame to the world.
        rays: number of tubes per pose over all six faces of the cube.
        faces: cube faces that get a grid; the last one, 5, lies behind the sensor.
    """
    cells = max(2, round(np.sqrt(rays / 6)))
    step = np.full(len(source), 2 / cells)
    low = np.full(len(source), -1 + 1 / cells)
    grids = []
    for face in faces:
        forward, u_axis, v_axis = (np.einsum("fij,j->fi", rotation, axis) for axis in _CUBE[face])
        grids.append(TubeGrid(source, forward, u_axis, v_axis, low, low, step, step, cells, cells))
    return grids
