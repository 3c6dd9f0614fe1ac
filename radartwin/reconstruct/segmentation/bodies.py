"""Group segments into bodies. A body is a set of segments that meet at convex edges and have similar colours, as the sides of an object do.

Convexity separates objects (Stein et al. 2014, Object partitioning using local convexity): the sides of a cabinet meet at convex edges, but
the cabinet meets the wall behind it at a concave edge. Floor, ceiling and walls belong to no body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.cluster.hierarchy import DisjointSet
from scipy.spatial import KDTree

from radartwin.reconstruct.segmentation.face_arrays import Faces, Segment, members, thinned
from radartwin.reconstruct.segmentation.grid import in_plane

SIMILAR = 14.0  # largest weighted L*a*b* colour difference between sides of the same object, which are lit differently
SAME = 7.0  # largest weighted L*a*b* difference between segments of an object that meet at a concave edge, such as the boards of a shelf
# smallest height of a wall relative to the height of the scan: for a plane with nothing behind it, and for any other plane
OUTER_HEIGHT, INNER_HEIGHT = 0.4, 0.85
INNER_WIDTH_M = 1.0  # a narrower plane is the side of a column
# a plane counts as having nothing behind it if less than the fraction NOTHING of the scan lies more than BEHIND_M behind the plane
BEHIND_M, NOTHING = 0.15, 0.02
WALL_AREA_M2 = 1.0
LEVEL = np.cos(np.radians(15.0))
UPRIGHT = np.sin(np.radians(15.0))
CONTACT_M = 0.08  # segments with a shorter common edge do not count as touching
APART_M = 0.06  # segments with a smaller distance count as touching, because scanners miss edges


def room_bounds(faces: Faces, segments: Sequence[Segment]) -> np.ndarray:
    """Return a mask (S,) of the segments that bound the room: floor, ceiling, roof slopes, and walls.

    A wall is an upright plane that spans most of the scan's height. A lower upright plane, or a roof slope, counts if the scan has almost
    no points behind the plane.
    """
    points, face = faces.samples
    samples = members(owners(faces, segments)[face])
    places = points[thinned(points, 0.1)]
    low, high = np.quantile(points[:, 2], [0.002, 0.998])
    out = np.zeros(len(segments), dtype=bool)
    for k, segment in enumerate(segments):
        if segment.normal is None or segment.area_m2 < WALL_AREA_M2:
            continue
        z = points[samples[k], 2]
        last = bool((places @ segment.normal < segment.offset_m - BEHIND_M).mean() < NOTHING)
        if abs(segment.normal[2]) < UPRIGHT:
            height = (np.quantile(z, 0.99) - np.quantile(z, 0.01)) / (high - low)
            width = np.ptp(np.quantile(points[samples[k]] @ in_plane(segment.normal)[0], [0.01, 0.99]))
            out[k] = (last and height > OUTER_HEIGHT) or (height > INNER_HEIGHT and width > INNER_WIDTH_M)
        elif segment.normal[2] > LEVEL:
            out[k] = np.median(z) < low + 0.15
        elif segment.normal[2] < 0:
            out[k] = last or (segment.normal[2] < -LEVEL and np.median(z) > high - 0.3)
    return out


def with_bodies(faces: Faces, segments: Sequence[Segment], lab: np.ndarray | None) -> list[Segment]:
    """Return the segments with their `body` numbers. Segments with the same number are sides of the same object.

    `lab` (F, 3) are the weighted L*a*b* colours of the faces; with None, colour is not compared.
    """
    bounds = room_bounds(faces, segments)
    colour = None if lab is None else np.array([np.average(lab[s.faces], axis=0, weights=faces.area[s.faces]) for s in segments])
    # area and mean colour of each body, at the number of one of its segments
    area = np.array([s.area_m2 for s in segments])
    mean = np.zeros((len(segments), 3)) if colour is None else colour.copy()
    bodies = DisjointSet(range(len(segments)))
    for i, j, length, convex, _ in contacts(faces, segments):
        # without colours, parts such as legs and handles stay separate, because nothing shows to which object they belong
        if bounds[i] or bounds[j] or length < CONTACT_M or (colour is None and not convex):
            continue
        a, b = bodies[i], bodies[j]
        limit = SIMILAR if convex else SAME
        # The mean colours of two bodies must also agree, so that a chain of similar segments cannot join two objects.
        alike = colour is None or max(np.linalg.norm(colour[i] - colour[j]), np.linalg.norm(mean[a] - mean[b])) < limit
        if alike and bodies.merge(i, j):
            mean[bodies[i]] = (area[a] * mean[a] + area[b] * mean[b]) / (area[a] + area[b])
            area[bodies[i]] = area[a] + area[b]
    return [replace(s, body=-1 if bounds[k] else int(bodies[k])) for k, s in enumerate(segments)]


class Contact(NamedTuple):
    """Two segments that touch: their indices, the length in metres of their common edge, whether two planes meet at a convex edge, and
    places (N, 3) along the edge.
    """

    first: int
    second: int
    length_m: float
    convex: bool
    places: np.ndarray


def contacts(faces: Faces, segments: Sequence[Segment]) -> list[Contact]:
    """Find the pairs of segments that touch or lie within APART_M of each other, those with the longest common edge first."""
    points, face = faces.samples
    owner = owners(faces, segments)[face]
    kept = np.concatenate([which[thinned(points[which], APART_M / 2)] for which in members(owner)])
    points, owner = points[kept], owner[kept]
    first, second = KDTree(points).query_pairs(APART_M, output_type="ndarray").T
    a, b = owner[first], owner[second]
    seam = a != b
    first, second, a, b = first[seam], second[seam], a[seam], b[seam]
    if not len(a):
        return []
    pairs, which = np.unique(np.sort(np.stack([a, b], axis=1), axis=1), axis=0, return_inverse=True)
    which = which.reshape(-1)
    place = (points[first] + points[second]) / 2
    centre = np.array([np.average(faces.centre[s.faces], axis=0, weights=faces.area[s.faces]) for s in segments])
    out = []
    for (i, j), group in zip(pairs.tolist(), members(which), strict=True):
        n, m, seam_at = segments[i].normal, segments[j].normal, place[group].mean(axis=0)
        crossing = n is not None and m is not None and abs(n @ m) < 0.9
        convex = bool(crossing and (centre[j] - seam_at) @ n < 0 and (centre[i] - seam_at) @ m < 0)
        # The length of the line of places follows from the number of cubes of edge CONTACT_M / 4 that contain places.
        cubes = np.unique(np.floor(place[group] / (CONTACT_M / 4)).astype(np.int64), axis=0)
        out.append(Contact(i, j, len(cubes) * CONTACT_M / 4, convex, place[group]))
    return sorted(out, key=lambda c: -c.length_m)


def owners(faces: Faces, segments: Sequence[Segment]) -> np.ndarray:
    """Return the segment index (F,) of each face."""
    owner = np.full(len(faces.area), -1)
    for k, segment in enumerate(segments):
        owner[segment.faces] = k
    return owner
