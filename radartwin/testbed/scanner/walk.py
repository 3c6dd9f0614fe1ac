"""Plan the path of a person with the phone through a room: a closed walk that avoids furniture, with a panning camera."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from skimage.measure import label

from radartwin.errors import SceneError
from radartwin.reconstruct.mesh_distance import covered, farthest_points
from radartwin.scene.scene import Scene

CELL_M = 0.1
LOWEST_M, HIGHEST_M = 0.15, 1.9  # objects between these heights above the floor block a person


EYE_M = 1.5  # height of the phone above the floor
CLEARANCE_M = 0.45  # smallest distance of the phone from walls and furniture
PAN_DEG, TREMBLE_DEG = 28.0, 1.5  # camera rotation between two frames; standard deviation of each camera angle because the hand trembles
DOWN_DEG = -42.0  # lowest elevation of the camera; at the highest elevation, the camera sees the ceiling's edge from 1.5 m away
TURNS_PER_NOD = 2.7  # number of camera revolutions during one period of the camera's elevation


def walked(scene: Scene, frames: int, rng: np.random.Generator) -> np.ndarray:
    """Return camera poses (N, 4, 4) with OpenCV axes, evenly spaced along a closed walk through the room.

    Raises:
        SceneError: the room has no free floor on which a person could stand.
    """
    ground = _closed_walk(scene)
    steps = np.linalg.norm(np.diff(ground, axis=0, append=ground[:1]), axis=1)
    along = np.concatenate([[0], np.cumsum(steps)])
    at = np.linspace(0, along[-1], frames, endpoint=False)
    closed = np.vstack([ground, ground[:1]])
    x, y = (np.interp(at, along, closed[:, i]) for i in range(2))
    low, high = scene.bounds
    rise = float(high[2] - low[2]) - EYE_M
    up = float(np.clip(np.degrees(np.arctan2(rise, 1.5)) - 12, 15, 65))
    yaw = np.radians(PAN_DEG) * np.arange(frames)
    nod = np.sin(yaw / TURNS_PER_NOD)
    pitch = np.radians(DOWN_DEG + (up - DOWN_DEG) * (0.5 + 0.5 * nod))
    tremble = np.radians(TREMBLE_DEG) * rng.standard_normal((frames, 3))
    height = low[2] + EYE_M + 0.03 * np.sin(2 * np.pi * at / 1.4) + 0.01 * rng.standard_normal(frames)
    return look_along(np.stack([x, y, height], axis=1), yaw + tremble[:, 0], pitch + tremble[:, 1], tremble[:, 2])


def look_along(positions: np.ndarray, yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Return camera poses (N, 4, 4) with OpenCV axes for positions (N, 3) and azimuth, elevation and roll (N,) in radians.

    >>> look_along(np.zeros((1, 3)), np.zeros(1), np.zeros(1), np.zeros(1))[0, :3, 2].tolist()
    [1.0, 0.0, 0.0]
    """
    forward = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1)
    right = np.stack([np.sin(yaw), -np.cos(yaw), np.zeros_like(yaw)], axis=1)
    down = np.cross(forward, right)
    turned = np.cos(roll)[:, None] * right + np.sin(roll)[:, None] * down
    poses = np.tile(np.eye(4), (len(yaw), 1, 1))
    poses[:, :3, :3] = np.stack([turned, np.cross(forward, turned), forward], axis=2)
    poses[:, :3, 3] = positions
    return poses


def _closed_walk(scene: Scene) -> np.ndarray:
    """Return points (M, 2) in metres along a smooth closed walk over the part of the floor that is free."""
    low, high = scene.bounds
    shape = tuple(np.ceil((high - low)[:2] / CELL_M).astype(int) + 1)
    blocked = np.zeros(shape, dtype=bool)
    for surface in scene:
        points, _ = covered(np.asarray(surface.mesh.triangles), 0.5 * CELL_M)
        standing = points[(points[:, 2] > low[2] + LOWEST_M) & (points[:, 2] < low[2] + HIGHEST_M)]
        blocked[tuple(np.round((standing[:, :2] - low[:2]) / CELL_M).astype(int).T)] = True
    blocked[[0, -1], :] = True
    blocked[:, [0, -1]] = True
    clear = CELL_M * np.asarray(ndimage.distance_transform_edt(~blocked))
    parts = np.asarray(label(clear >= CLEARANCE_M, connectivity=1))
    if not parts.any():
        raise SceneError(f"scan: no free floor {CLEARANCE_M} m from all surfaces; give camera poses")
    largest = 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    free = parts == largest
    cells = np.argwhere(free)
    first = int(np.argmin(((cells - cells.mean(axis=0)) ** 2).sum(axis=1)))
    stops = cells[farthest_points(cells, max(4, round(free.sum() * CELL_M**2 / 2.5)), first)]
    tour = _tour(stops, free, clear)
    smooth = ndimage.gaussian_filter1d(tour.astype(float), 4.0, axis=0, mode="wrap")
    inside = free[tuple(np.round(smooth).astype(int).T)]  # where a smoothed point is not on free floor, the unsmoothed point is used
    return np.where(inside[:, None], smooth, tour) * CELL_M + low[:2]


def _tour(stops: np.ndarray, free: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """Return the floor cells (M, 2) of a closed walk through all stops, which are points that the walk must visit."""
    cells = np.argwhere(free)
    number = np.full(free.shape, -1)
    number[free] = np.arange(len(cells))
    rows, columns, costs = [], [], []
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = cells + step
        inside = np.flatnonzero(((other >= 0) & (other < free.shape)).all(axis=1))
        inside = inside[free[tuple(other[inside].T)]]
        rows.append(number[tuple(cells[inside].T)])
        columns.append(number[tuple(other[inside].T)])
        costs.append(np.hypot(*step) / np.minimum(clear[tuple(cells[inside].T)], 1.0))
    links = coo_matrix((np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), (len(cells), len(cells)))
    ids = number[tuple(stops.T)]
    length, before = dijkstra(links.tocsr(), directed=False, indices=ids, return_predecessors=True)
    between = length[:, ids]
    order = [0]
    while len(order) < len(ids):
        left = [i for i in range(len(ids)) if i not in order]
        order.append(min(left, key=lambda i: between[order[-1], i]))
    improved = True
    while improved:
        improved = False
        for i in range(1, len(order) - 1):
            for j in range(i + 1, len(order)):
                a, b, c, d = order[i - 1], order[i], order[j], order[(j + 1) % len(order)]
                if between[a, c] + between[b, d] < between[a, b] + between[c, d] - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    improved = True
    tour = []
    for start, end in zip(order, order[1:] + order[:1], strict=True):
        node, path = ids[end], []
        while node != ids[start]:
            path.append(node)
            node = before[start, node]
        tour += [ids[start], *path[::-1]][:-1]
    return cells[tour]
