"""What a mesh does not show: the loops of its boundary, their length, and the area that would close them."""

from __future__ import annotations

import dataclasses

import numpy as np
import trimesh


@dataclasses.dataclass(frozen=True)
class Holes:
    """Boundary of a mesh. A loop is taken for a hole if it is not the longest loop of its connected part, which is the rim.

    Attributes:
        count: holes.
        boundary_m: length of all boundary edges, rims included.
        area_m2: area that would close the holes, each as a fan about its middle.
        largest_m2: of the largest.
    """

    count: int
    boundary_m: float
    area_m2: float
    largest_m2: float


def holes(mesh: trimesh.Trimesh) -> Holes:
    """Count and measure.

    >>> sheet = trimesh.creation.box((1, 1, 1))
    >>> holes(sheet).count
    0
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.asarray(mesh.edges_sorted, dtype=np.int64)
    key, uses = np.unique(edges[:, 0] * len(mesh.vertices) + edges[:, 1], return_counts=True)
    unique = np.stack(np.divmod(key, len(mesh.vertices)), axis=1)
    boundary = unique[uses == 1]
    if not len(boundary):
        return Holes(0, 0.0, 0.0, 0.0)
    count = len(mesh.vertices)
    ends = np.asarray(mesh.vertices)[boundary]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    loops, loop_of = connected_components(coo_matrix((np.ones(len(boundary)), boundary.T), (count, count)), directed=False)
    _, part_of = connected_components(coo_matrix((np.ones(len(unique)), unique.T), (count, count)), directed=False)
    loop, part = loop_of[boundary[:, 0]], part_of[boundary[:, 0]]
    perimeter = np.bincount(loop, weights=length, minlength=loops)
    sums = np.stack([np.bincount(loop, weights=ends.mean(axis=1)[:, axis] * length, minlength=loops) for axis in range(3)], axis=1)
    middle = sums / np.maximum(perimeter, 1e-12)[:, None]
    fan = 0.5 * np.linalg.norm(np.cross(ends[:, 0] - middle[loop], ends[:, 1] - middle[loop]), axis=1)
    area = np.bincount(loop, weights=fan, minlength=loops)
    is_hole = perimeter > 0
    owner = np.zeros(loops, dtype=np.int64)
    owner[loop] = part
    for p in np.unique(part):
        own = np.flatnonzero((owner == p) & (perimeter > 0))
        is_hole[own[np.argmax(perimeter[own])]] = False
    found = area[is_hole]
    return Holes(int(is_hole.sum()), float(length.sum()), float(found.sum()), float(found.max(initial=0.0)))
