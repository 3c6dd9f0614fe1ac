"""Which cells of a launch's grid anything could be in: a large thing seen from near spans a grid of which it fills a few hundredths."""

import numpy as np

from radartwin.compiled import compiled
from radartwin.simulation.curved.tube_grid import Launch

MARGIN = 1  # cells around what is in a facet's box
BEFORE = 1e-3  # of the distance to a corner: less far before the source than that, and it is not said to be before it


def covered(launch: Launch, pose: int, corners: np.ndarray) -> np.ndarray | None:
    """Cells of one pose, ascending, whose centre ray could meet a facet; None where some facet is not clearly before the source.

    Args:
        corners: (N, 3, 3) of the facets, in the launch's frame.
    """
    relative = corners - launch.source[pose]
    u, v = relative @ launch.u_axis[pose], relative @ launch.v_axis[pose]
    if not launch.plane:
        depth = relative @ launch.forward[pose]
        if (depth <= BEFORE * np.linalg.norm(relative, axis=-1)).any():
            return None
        u, v = u / depth, v / depth
    u, v = (u - launch.low_u[pose]) / launch.step_u[pose], (v - launch.low_v[pose]) / launch.step_v[pose]
    u, v = u.clip(-2 - MARGIN, launch.count_u + 1 + MARGIN), v.clip(-2 - MARGIN, launch.count_v + 1 + MARGIN)
    seen = np.zeros((launch.count_v, launch.count_u), np.bool_)
    _mark(seen, u, v)
    return np.flatnonzero(seen)


@compiled
def _mark(seen: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
    """Mark the cells of the boxes about facets whose corners are at u, v (N, 3), in cells."""
    rows, columns = seen.shape
    for n in range(len(u)):
        left, right = max(0, int(np.floor(u[n].min())) - MARGIN), min(columns, int(np.ceil(u[n].max())) + MARGIN + 1)
        below, above = max(0, int(np.floor(v[n].min())) - MARGIN), min(rows, int(np.ceil(v[n].max())) + MARGIN + 1)
        for i in range(below, above):
            for k in range(left, right):
                seen[i, k] = True
