"""Measure the holes of a mesh: count the loops of its boundary, and measure their length and the area that would close them."""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh


@dataclasses.dataclass(frozen=True)
class Holes:
    """Measures of a mesh's boundary. The longest boundary loop of a connected part is its rim, and the other loops are holes.

    Attributes:
        count: number of holes.
        boundary_m: length of all boundary edges, rims included.
        area_m2: area of triangle fans that would close the holes.
        largest_m2: area of the largest hole.
    """

    count: int
    boundary_m: float
    area_m2: float
    largest_m2: float


def holes(mesh: trimesh.Trimesh) -> Holes:
    """Count and measure the holes of a mesh.

    >>> sheet = trimesh.creation.box((1, 1, 1))
    >>> holes(sheet).count
    0
    """
    edges = np.asarray(mesh.edges_sorted, dtype=np.int64)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    boundary = unique[uses == 1]
    if not len(boundary):
        return Holes(0, 0.0, 0.0, 0.0)
    count = len(mesh.vertices)
    ends = np.asarray(mesh.vertices)[boundary]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    loop, part = (trimesh.graph.connected_component_labels(links, count)[boundary[:, 0]] for links in (boundary, unique))
    perimeter = np.bincount(loop, weights=length)
    sums = np.stack([np.bincount(loop, weights=ends.mean(axis=1)[:, axis] * length) for axis in range(3)], axis=1)
    centre = sums / np.maximum(perimeter, 1e-12)[:, None]
    fan = 0.5 * np.linalg.norm(np.cross(ends[:, 0] - centre[loop], ends[:, 1] - centre[loop]), axis=1)
    area = np.bincount(loop, weights=fan)
    is_hole = perimeter > 0
    part_of_loop = np.zeros(len(perimeter), dtype=np.int64)
    part_of_loop[loop] = part
    for p in np.unique(part):
        own = np.flatnonzero((part_of_loop == p) & (perimeter > 0))
        is_hole[own[np.argmax(perimeter[own])]] = False
    return Holes(int(is_hole.sum()), float(length.sum()), float(area[is_hole].sum()), float(area[is_hole].max(initial=0.0)))
