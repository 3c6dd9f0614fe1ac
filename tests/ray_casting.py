"""Cast rays at triangles, as an oracle for rasterisers and simulated echoes."""

import numpy as np


def first_hits(starts: np.ndarray, directions: np.ndarray, triangles: np.ndarray, least: float = 1e-6) -> np.ndarray:
    """Return the ray parameters (N,) at which rays first meet one of the triangles (T, 3, 3) beyond `least` (T. Moeller, B. Trumbore 1997),
    and inf for rays that meet none. Starts and directions are (N, 3) or (3,).
    """
    starts, directions = np.broadcast_arrays(np.atleast_2d(starts), np.atleast_2d(directions))
    corner = np.asarray(triangles)[:, 0]
    first, second = np.asarray(triangles)[:, 1] - corner, np.asarray(triangles)[:, 2] - corner
    hits = np.full(len(starts), np.inf)
    for k, (start, direction) in enumerate(zip(starts, directions, strict=True)):
        across = np.cross(direction, second)
        away = start - corner
        around = np.cross(away, first)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / (first * across).sum(axis=1)
            u, v, t = (away * across).sum(axis=1) * scale, around @ direction * scale, (around * second).sum(axis=1) * scale
        hits[k] = t[(u >= 0) & (v >= 0) & (u + v <= 1) & (t > least)].min(initial=np.inf)
    return hits
