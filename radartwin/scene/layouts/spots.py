"""Find the candidate positions of an object on a supporting surface that satisfy the object's relations to anchors, the best first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radartwin.scene.collision import top_below
from radartwin.scene.layouts.anchor import Anchor
from radartwin.scene.layouts.layout import Relation
from radartwin.scene.scene import Surface

STEP_M = 0.02  # grid step of the candidate positions on supporting surfaces up to 3 m; larger surfaces have a larger step
_MAX_STEPS = 150  # largest number of grid steps along a side of the supporting surface
CLEAR_M = 0.05  # gap between object and anchor if the relation has no distance
ASIDE_M = 0.3  # largest distance by which an object left or right of an anchor may stand beyond the anchor's front or back

# anchor, unit vector of the relation, unit vector across the relation, distance in metres or None
Side = tuple[Anchor, np.ndarray, np.ndarray, float | None]


def spots(support: Surface, radius_m: float, relations: Sequence[tuple[Relation, Anchor]]) -> np.ndarray:
    """Return candidate positions (N, 2), in metres, of the vertical axis of an object on a supporting surface, the best first.

    The best position is nearest to the axes of the anchors. The axis of an anchor is the line through its middle in the direction of the
    relation. Without relations, the best position is nearest to the middle of the surface.

    Args:
        radius_m: radius in metres of the object's base, which must lie within the supporting surface.
        relations: relations of the object with their anchors; the relation "beside" allows positions on the left and on the right.
    """
    low, high = support.mesh.bounds[:, :2]
    step = max(STEP_M, float((high - low).max()) / _MAX_STEPS)
    axes = [np.unique(np.append(np.arange(low[k], high[k], step), (low[k] + high[k]) / 2)) for k in range(2)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    candidates, costs = [], []
    for sides in _variants(relations):
        points, cost = _related(grid, sides, radius_m)
        if not relations:
            cost = np.linalg.norm(points - (low + high) / 2, axis=1)
        candidates.append(points)
        costs.append(cost)
    points, cost = np.vstack(candidates), np.concatenate(costs)
    order = np.argsort(cost.round(6), kind="stable")
    points = points[order]
    _, first = np.unique(points.round(3), axis=0, return_index=True)
    points = points[np.sort(first)]
    angle = 2 * np.pi * np.arange(8) / 8
    ring = 0.98 * radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for offset in (np.zeros(2), *ring):
        points = points[np.isfinite(top_below(support.mesh, points + offset))]
    return points


def _variants(relations: Sequence[tuple[Relation, Anchor]]) -> list[list[Side | Anchor]]:
    """Convert relations to lists of sides, one list per choice of left or right for "beside"; the anchor itself stands for "under"."""
    out: list[list[Side | Anchor]] = [[]]
    for relation, anchor in relations:
        front, left, distance = anchor.front, anchor.left, relation.distance_m
        sides = {
            "in front of": [(anchor, front, left, distance)],
            "behind": [(anchor, -front, left, distance)],
            "left of": [(anchor, left, front, distance)],
            "right of": [(anchor, -left, front, distance)],
            "beside": [(anchor, left, front, distance), (anchor, -left, front, distance)],
            "under": [anchor],
        }[relation.relation]
        out = [[*variant, side] for variant in out for side in sides]
    return out


def _related(grid: np.ndarray, sides: Sequence[Side | Anchor], radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the grid points, moved to the stated distances from the anchors, that satisfy all relations, and their costs in metres."""
    exact = [(side, side[3]) for side in sides if isinstance(side, tuple) and side[3] is not None]
    points = grid
    if exact:
        normals = np.array([direction for (_, direction, _, _), _ in exact])
        offsets = np.array([_end(anchor, direction) + distance for (anchor, direction, _, _), distance in exact])
        points = grid + (offsets - grid @ normals.T) @ np.linalg.pinv(normals).T
        # remove the points that do not have all stated distances, because the distances of several relations may contradict each other
        points = points[(np.abs(points @ normals.T - offsets) < 1e-6).all(axis=1)]
    cost = np.zeros(len(points))
    for side in sides:
        if isinstance(side, Anchor):
            low, high = side.points.min(axis=0), side.points.max(axis=0)
            valid = ((points > low) & (points < high)).all(axis=1)
            cost = cost + np.linalg.norm(points - (low + high) / 2, axis=1)
        else:
            valid, more = _beyond(points, side, radius_m)
            cost = cost + more
        points, cost = points[valid], cost[valid]
    return points, cost


def _beyond(points: np.ndarray, side: Side, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return which points (N, 2) lie beyond an anchor within its width, and their costs (N,): distance from its axis plus gap, m."""
    anchor, direction, across, distance = side
    along = points @ direction - _end(anchor, direction)
    sideways = anchor.points @ across
    lateral = np.abs(points @ across - (sideways.min() + sideways.max()) / 2)
    width = (0.5 * np.abs(along) if anchor.is_sensor else np.ptp(sideways) / 2) + 1e-6
    close = radius_m + CLEAR_M
    if abs(direction @ anchor.front) < 0.5:  # the relation is left or right of the anchor
        width = width + radius_m + ASIDE_M
    valid = (lateral <= np.maximum(width, radius_m)) & (along > -1e-9 if distance is not None else along >= close - 1e-9)
    return valid, lateral + (0 if distance is not None else along - close)


def _end(anchor: Anchor, direction: np.ndarray) -> float:
    """Return the largest coordinate in metres of the anchor's points along a direction."""
    return float((anchor.points @ direction).max())
