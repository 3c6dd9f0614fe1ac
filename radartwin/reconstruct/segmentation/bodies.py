"""Group segments into bodies: sets of segments that are the sides of one object, because they meet at convex edges and have one colour.

Convexity separates objects (Stein et al. 2014, Object partitioning using local convexity): the sides of a cabinet meet at convex edges, but
the cabinet meets the wall behind it at a concave edge. Floor, ceiling and walls belong to no body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from radartwin.reconstruct.segmentation.coplanar import in_plane
from radartwin.reconstruct.segmentation.faces import Faces, Segment, thinned

SIMILAR = 14.0  # largest weighted L*a*b* difference between sides of one object, which are lit differently
SAME = 7.0  # largest difference across a concave edge, as between the boards of a shelf
OUTER_HEIGHT, INNER_HEIGHT = 0.4, 0.85  # smallest height of a wall relative to the scan: with nothing behind it, and otherwise
INNER_WIDTH_M = 1.0  # a narrower plane is the side of a column
BEHIND_M, NOTHING = 0.15, 0.02  # a plane has nothing behind it if less than this share of the scan lies more than BEHIND_M behind it
WALL_AREA_M2 = 1.0
LEVEL = np.cos(np.radians(15.0))
UPRIGHT = np.sin(np.radians(15.0))
CONTACT_M = 0.08  # segments with a shorter common edge do not count as touching
APART_M = 0.06  # segments this close count as touching, because scanners miss edges


def room_bounds(faces: Faces, segments: Sequence[Segment]) -> np.ndarray:
    """Return a mask (S,) of the segments that bound the room: floor, ceiling, and walls.

    A wall is an upright plane that spans the scan's height or has nothing behind it.
    """
    places = faces.centre[thinned(faces.centre, 0.1)]
    low, high = np.quantile(faces.centre[:, 2], [0.002, 0.998])
    out = np.zeros(len(segments), dtype=bool)
    for k, segment in enumerate(segments):
        if segment.normal is None or segment.area_m2 < WALL_AREA_M2:
            continue
        z = faces.centre[segment.faces, 2]
        if abs(segment.normal[2]) < UPRIGHT:
            height = (np.quantile(z, 0.99) - np.quantile(z, 0.01)) / (high - low)
            outer = height > OUTER_HEIGHT and (places @ segment.normal < segment.offset_m - BEHIND_M).mean() < NOTHING
            width = np.ptp(np.quantile(faces.centre[segment.faces] @ in_plane(segment.normal)[0], [0.01, 0.99]))
            out[k] = outer or (height > INNER_HEIGHT and width > INNER_WIDTH_M)
        elif segment.normal[2] > LEVEL:
            out[k] = np.median(z) < low + 0.15
        elif segment.normal[2] < -LEVEL:
            out[k] = np.median(z) > high - 0.3
    return out


def with_bodies(faces: Faces, segments: Sequence[Segment], lab: np.ndarray | None) -> list[Segment]:
    """Return the segments with `body` numbers, from the weighted L*a*b* colours `lab` (F, 3) of the faces, or without colours."""
    bounds = room_bounds(faces, segments)
    colour = None
    if lab is not None:
        colour = np.array([np.average(lab[s.faces], axis=0, weights=faces.area[s.faces]) for s in segments])
    area = np.array([s.area_m2 for s in segments])
    body_colour = np.zeros((len(segments), 3)) if colour is None else colour.copy()  # indexed by root segment
    root = np.arange(len(segments))

    def find(k: int) -> int:
        while root[k] != k:
            k = root[k]
        return k

    for i, j, length, convex in contacts(faces, segments):
        if bounds[i] or bounds[j] or length < CONTACT_M:
            continue
        a, b = find(i), find(j)
        if a == b:
            continue
        difference = 0.0 if colour is None else float(np.linalg.norm(colour[i] - colour[j]))
        if not convex and colour is None:
            continue  # parts such as legs and handles stay separate, because nothing shows which object they belong to
        limit = SIMILAR if convex else SAME
        # The mean colours of the bodies must also agree, so that a chain of similar segments cannot join two objects.
        if difference < limit and (colour is None or float(np.linalg.norm(body_colour[a] - body_colour[b])) < limit):
            root[b] = a
            body_colour[a] = (area[a] * body_colour[a] + area[b] * body_colour[b]) / (area[a] + area[b])
            area[a] += area[b]
    roots = np.array([find(k) for k in range(len(segments))])
    _, number = np.unique(roots, return_inverse=True)
    return [replace(s, body=-1 if bounds[k] else int(number[k])) for k, s in enumerate(segments)]


def contacts(faces: Faces, segments: Sequence[Segment]) -> list[tuple[int, int, float, bool]]:
    """Find the pairs of segments that touch or lie within APART_M of each other.

    Returns:
        Tuples (i, j, length of the common edge in metres, whether two planes meet at a convex edge), longest edge first.
    """
    owner = np.full(len(faces.area), -1)
    for k, segment in enumerate(segments):
        owner[segment.faces] = k
    chosen = np.flatnonzero(owner >= 0)
    chosen = chosen[thinned(faces.centre[chosen], APART_M / 2)]
    edge = float(np.sqrt(2 * np.median(faces.area)))
    near = KDTree(faces.centre[chosen]).query_pairs(max(APART_M, min(2.5 * edge, 0.12)), output_type="ndarray")
    coo = sp.triu(faces.adjacency).tocoo()
    first, second = (np.concatenate([chosen[near[:, k]], link]) for k, link in enumerate((coo.row, coo.col)))
    a, b = owner[first], owner[second]
    seam = (a >= 0) & (b >= 0) & (a != b)
    first, second, a, b = first[seam], second[seam], a[seam], b[seam]
    if not len(a):
        return []
    pairs, which = np.unique(np.sort(np.stack([a, b], axis=1), axis=1), axis=0, return_inverse=True)
    which = which.reshape(-1)
    place = (faces.centre[first] + faces.centre[second]) / 2
    middle = np.stack([np.bincount(which, place[:, k], len(pairs)) for k in range(3)], axis=1) / np.bincount(which)[:, None]
    length = np.array([_length(place[which == k]) for k in range(len(pairs))])
    centre = np.array([np.average(faces.centre[s.faces], axis=0, weights=faces.area[s.faces]) for s in segments])
    out = []
    for (i, j), metres, seam_at in zip(pairs.tolist(), length, middle, strict=True):
        n, m = segments[i].normal, segments[j].normal
        convex = False
        if n is not None and m is not None and abs(n @ m) < 0.9:
            convex = bool((centre[j] - seam_at) @ n < 0 and (centre[i] - seam_at) @ m < 0)
        out.append((i, j, float(metres), convex))
    return sorted(out, key=lambda c: -c[2])


def _length(points: np.ndarray) -> float:
    """Estimate the length of a line of points (N, 3) from the number of cells of size CONTACT_M / 4 that hold points."""
    cells = np.unique(np.floor(points / (CONTACT_M / 4)).astype(np.int64), axis=0)
    return len(cells) * CONTACT_M / 4
