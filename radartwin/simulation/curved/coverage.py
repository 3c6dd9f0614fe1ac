"""Find the cells of a tube grid that can meet a facet, because a large object seen from near may fill a few percent of its grid."""

import numpy as np

from radartwin.compiled import compiled
from radartwin.simulation.curved.tube_grid import TubeGrid

MARGIN = 1  # cells added around the bounding box of a facet
MIN_DEPTH = 1e-3  # smallest depth of a corner in front of the source, relative to its distance


def covered(grid: TubeGrid, pose: int, corners: np.ndarray) -> np.ndarray | None:
    """Return the cells of one pose, ascending, whose centre ray can meet a facet; None if a facet is not in front of the source.

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
