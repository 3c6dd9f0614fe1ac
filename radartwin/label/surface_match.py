"""Describe a surface by points spread evenly over its area, and find the same surface again in another scan of the same room.

Surfaces of two scans are matched by votes: each point of a surface in the first scan votes for the nearest surface of the second scan. If
both surfaces are flat, the angle between their normals counts as additional distance. The match tolerates the differences of a second scan,
such as offsets of a few centimetres, a surface split into two parts, or another outline. The match does not use surface names. Both scans
must have the same coordinate frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from radartwin.errors import LabelError

SPACING_M, MIN_POINTS = 0.25, 12  # spacing and smallest number of the stored points of a surface; 25 m2 of floor have 400 points
REACH_M = 0.3  # largest distance from a point to the surface it votes for; larger than SPACING_M, because scans have errors of centimetres
RIGHT_ANGLE_M = 0.4  # additional distance for a right angle between two flat surfaces, in metres
MIN_SHARE = 0.3  # a surface matches a surface of the other scan if at least this share of its points votes for that surface


@dataclass(frozen=True, eq=False)
class Place:
    """Position of a surface, in metres: centroid (3,), normal (3,) (None if not flat), area, and points on it (N, 3)."""

    centroid: np.ndarray
    normal: np.ndarray | None
    area_m2: float
    points: np.ndarray

    def to_dict(self) -> dict[str, Any]:
        """Return the surface position as JSON-compatible values, with lengths rounded to centimetres."""
        return {
            "centroid_m": _rounded(self.centroid, 2),
            "normal": None if self.normal is None else _rounded(self.normal, 3),
            "area_m2": round(self.area_m2, 3),
            "points_cm": np.rint(100 * self.points).astype(int).reshape(-1).tolist(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Place:
        """Make a surface position from the JSON-compatible values that `to_dict` returned."""
        try:
            normal = None if values["normal"] is None else np.array(values["normal"], float).reshape(3)
            points = np.array(values["points_cm"], float).reshape(-1, 3) / 100
            return cls(np.array(values["centroid_m"], float).reshape(3), normal, float(values["area_m2"]), points)
        except KeyError as error:
            raise LabelError(f"the surface position of a recorded answer lacks {error}") from error
        except (TypeError, ValueError) as error:
            raise LabelError(f"the surface position of a recorded answer is not valid ({error})") from error


def place_of(mesh: trimesh.Trimesh, spacing_m: float = SPACING_M) -> Place:
    """Compute the position of a mesh, with one point per spacing_m^2 of area, but at least MIN_POINTS points."""
    corners = np.asarray(mesh.triangles, float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(cross, axis=1)
    area = float(doubled.sum() / 2)
    mean = cross.sum(axis=0) / max(doubled.sum(), 1e-300)
    length = float(np.linalg.norm(mean))
    count = max(MIN_POINTS, math.ceil(area / spacing_m**2))
    points = _spread_points(corners, doubled, count)
    centroid = np.average(corners.mean(axis=1), axis=0, weights=np.maximum(doubled, 1e-300))
    return Place(centroid, mean / length if length > 0.8 else None, area, points)


def matches(places: Sequence[Place], among: Sequence[Place]) -> list[tuple[int, float] | None]:
    """Match each surface in `places` with the surface in `among` that most of its points vote for (each point votes for the nearest
    surface).

    Returns: one entry per surface in `places`. Each entry is the matched surface's index in `among` and the share of the points that voted
        for the matched surface, or None if this share is below MIN_SHARE.
    """
    out: list[tuple[int, float] | None] = []
    for shares in _votes(places, among):
        winner = int(shares.argmax()) if shares.size else 0
        out.append((winner, float(shares[winner])) if shares.size and shares[winner] >= MIN_SHARE else None)
    return out


def overlap(place: Place, other: Place) -> float:
    """Return the share (0 to 1) of the points on the surface `place` that lie on the surface `other`."""
    return float(_votes([place], [other])[0][0])


def _votes(places: Sequence[Place], among: Sequence[Place]) -> list[np.ndarray]:
    """Return for each surface in `places` an array (len(among),): the share of its points that vote for each surface in `among`."""
    from scipy.spatial import KDTree

    if not among:
        return [np.zeros(0) for _ in places]
    pool = np.concatenate([place.points for place in among])
    place_index = np.repeat(np.arange(len(among)), [len(place.points) for place in among])
    normals = np.array([np.zeros(3) if place.normal is None else place.normal for place in among])
    tree = KDTree(pool)
    out = []
    for place in places:
        distance, near = tree.query(place.points, k=min(12, len(pool)), distance_upper_bound=REACH_M)
        distance, near = distance.reshape(len(place.points), -1), near.reshape(len(place.points), -1)
        in_reach = np.isfinite(distance)
        label = place_index[np.where(in_reach, near, 0)]
        cost = np.where(in_reach, distance, np.inf)
        if place.normal is not None:
            flat = np.linalg.norm(normals[label], axis=-1) > 0
            cost = cost + np.where(flat, RIGHT_ANGLE_M * (1 - np.abs(normals[label] @ place.normal)), 0)
        best = cost.argmin(axis=1)
        rows = np.arange(len(best))
        out.append(np.bincount(label[rows, best][np.isfinite(cost[rows, best])], minlength=len(among)) / len(place.points))
    return out


def _spread_points(corners: np.ndarray, weight: np.ndarray, count: int) -> np.ndarray:
    """Return `count` points (count, 3) on triangles (F, 3, 3), spread evenly in proportion to the triangles' `weight` (F,)."""
    cumulative = np.cumsum(weight)
    index = np.arange(count)
    face = np.searchsorted(cumulative, (index + 0.5) / count * cumulative[-1])
    plastic = 1.32471795724474602596
    u, v = np.mod(0.5 + (index + 1) / plastic, 1), np.mod(0.5 + (index + 1) / plastic**2, 1)
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    triangles = corners[np.minimum(face, len(corners) - 1)]
    return triangles[:, 0] + u[:, None] * (triangles[:, 1] - triangles[:, 0]) + v[:, None] * (triangles[:, 2] - triangles[:, 0])


def _rounded(values: np.ndarray, digits: int) -> list[float]:
    return [round(float(value), digits) + 0.0 for value in values]
