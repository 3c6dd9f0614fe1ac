"""Where on a support an object can stand so that its relations hold: candidate spots in the plane, best first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radartwin.scene.collision import top_below
from radartwin.scene.layouts.anchor import Anchor
from radartwin.scene.layouts.layout import Relation
from radartwin.scene.scene import Surface

STEP_M = 0.02  # of the grid of candidates, on supports up to 3 m; coarser on larger ones
CLEAR_M = 0.05  # from an anchor without a distance
_STEPS = 150

ASIDE_M = 0.3  # how far before or behind an anchor something may stand to its left or right

Side = tuple[Anchor, np.ndarray, np.ndarray, float | None]  # anchor, direction, across, distance


def spots(support: Surface, radius_m: float, relations: Sequence[tuple[Relation, Anchor]]) -> np.ndarray:
    """Spots (N, 2) of an object's middle on a support, best first: near the axis of its anchors, else near the support's middle.

    Args:
        radius_m: of the object's base; all of it stands on the support.
        relations: with their anchors; "beside" holds on either side.
    """
    low, high = support.mesh.bounds[:, :2]
    step = max(STEP_M, float((high - low).max()) / _STEPS)
    axes = [np.unique(np.append(np.arange(low[k], high[k], step), (low[k] + high[k]) / 2)) for k in range(2)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    found, costs = [], []
    for sides in _variants(relations):
        points, cost = _related(grid, sides, radius_m)
        if not relations:
            cost = np.linalg.norm(points - (low + high) / 2, axis=1)
        found.append(points)
        costs.append(cost)
    points, cost = np.vstack(found), np.concatenate(costs)
    order = np.argsort(cost.round(6), kind="stable")
    points = points[order]
    _, first = np.unique(points.round(3), axis=0, return_index=True)
    points = points[np.sort(first)]
    turn = 2 * np.pi * np.arange(8) / 8
    ring = 0.98 * radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for offset in (np.zeros(2), *ring):
        points = points[np.isfinite(top_below(support.mesh, points + offset))]
    return points


def _variants(relations: Sequence[tuple[Relation, Anchor]]) -> list[list[Side | Anchor]]:
    """The relations as directions, one list for every choice of left or right; "under" stays its anchor."""
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
    """Grid points moved to where the given distances hold, those that fulfil all relations, and how far from ideal they are."""
    exact = [(side, side[3]) for side in sides if isinstance(side, tuple) and side[3] is not None]
    points = grid
    if exact:
        normals = np.array([direction for (_, direction, _, _), _ in exact])
        wanted = np.array([_face(anchor, direction) + distance for (anchor, direction, _, _), distance in exact])
        points = grid + (wanted - grid @ normals.T) @ np.linalg.pinv(normals).T
        points = points[(np.abs(points @ normals.T - wanted) < 1e-6).all(axis=1)]  # more distances than directions may contradict
    cost = np.zeros(len(points))
    for side in sides:
        if isinstance(side, Anchor):
            low, high = side.points.min(axis=0), side.points.max(axis=0)
            kept = ((points > low) & (points < high)).all(axis=1)
            cost = cost + np.linalg.norm(points - (low + high) / 2, axis=1)
        else:
            kept, more = _beyond(points, side, radius_m)
            cost = cost + more
        points, cost = points[kept], cost[kept]
    return points, cost


def _beyond(points: np.ndarray, side: Side, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Which points are beyond an anchor's face and within its width, and how far they are from its axis and from touching it."""
    anchor, direction, across, distance = side
    along = points @ direction - _face(anchor, direction)
    sideways = anchor.points @ across
    lateral = np.abs(points @ across - (sideways.min() + sideways.max()) / 2)
    width = (0.5 * np.abs(along) if anchor.is_sensor else np.ptp(sideways) / 2) + 1e-6
    close = radius_m + CLEAR_M
    if abs(direction @ anchor.front) < 0.5:  # beside it
        width = width + radius_m + ASIDE_M
    kept = (lateral <= np.maximum(width, radius_m)) & (along > -1e-9 if distance is not None else along >= close - 1e-9)
    return kept, lateral + (0 if distance is not None else along - close)


def _face(anchor: Anchor, direction: np.ndarray) -> float:
    """Where the anchor ends along a direction."""
    return float((anchor.points @ direction).max())
