"""Sides of one thing: planes and parts that meet in a convex edge and have one colour.

Convexity tells things apart (Stein et al. 2014, Object partitioning using local convexity): sides of a cabinet meet convexly, the
cabinet and the wall behind it concavely. Floor, ceiling and walls are nobody's sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import KDTree

from radartwin.reconstruct.segmentation.coplanar import in_plane
from radartwin.reconstruct.segmentation.faces import Faces, Segment, thinned

ALIKE = 14.0  # weighted L*a*b* within which sides of one thing may differ: light falls on them differently
SAME = 7.0  # ... and within which even what meets concavely, as the boards of a shelf, is one
OUTER_HEIGHT, INNER_HEIGHT = 0.4, 0.85  # of the scan's height that a wall spans at least, one with nothing behind it or any
INNER_WIDTH_M = 1.0  # narrower ones are columns' sides
BEHIND_M, NOTHING = 0.15, 0.02  # deeper than noise; share of the scan that is nothing
SHELL_AREA_M2 = 1.0
LEVEL = np.cos(np.radians(15.0))
UPRIGHT = np.sin(np.radians(15.0))
CONTACT_M = 0.08  # shorter seams are no contact
APART_M = 0.06


def shell(faces: Faces, segments: Sequence[Segment]) -> np.ndarray:
    """Which segments (S,) bound the room: the floor, the ceiling, and upright planes from the one to the other or behind everything."""
    places = faces.centre[thinned(faces.centre, 0.1)]
    low, high = np.quantile(faces.centre[:, 2], [0.002, 0.998])
    out = np.zeros(len(segments), dtype=bool)
    for k, segment in enumerate(segments):
        if segment.normal is None or segment.area_m2 < SHELL_AREA_M2:
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
    """The segments with `body` numbered: sides of one thing alike, floor, ceiling and walls -1.

    Args:
        lab: (F, 3) weighted colours of the faces, or None.
    """
    bounds = shell(faces, segments)
    colour = None
    if lab is not None:
        colour = np.array([np.average(lab[s.faces], axis=0, weights=faces.area[s.faces]) for s in segments])
    area = np.array([s.area_m2 for s in segments])
    whole = np.zeros((len(segments), 3)) if colour is None else colour.copy()  # of the thing so far that each is the root of
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
        # Without colour, parts (legs, handles) stay by themselves: what they touch may be anything.
        if not convex and colour is None:
            continue
        least = ALIKE if convex else SAME
        # Likeness must not creep from side to side, or through the rubble in a corner, until a thing is two.
        if difference < least and (colour is None or float(np.linalg.norm(whole[a] - whole[b])) < least):
            root[b] = a
            whole[a] = (area[a] * whole[a] + area[b] * whole[b]) / (area[a] + area[b])
            area[a] += area[b]
    roots = np.array([find(k) for k in range(len(segments))])
    _, number = np.unique(roots, return_inverse=True)
    return [replace(s, body=-1 if bounds[k] else int(number[k])) for k, s in enumerate(segments)]


def contacts(faces: Faces, segments: Sequence[Segment]) -> list[tuple[int, int, float, bool]]:
    """Pairs of segments that touch, or end APART_M from each other, since scanners miss edges.

    Returns:
        (i, j, length of the seam in metres, whether two planes meet convexly), longest first.
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
    """About the length of a line that points (N, 3) lie along: cells of CONTACT_M / 4 that they fall in."""
    cells = np.unique(np.floor(points / (CONTACT_M / 4)).astype(np.int64), axis=0)
    return len(cells) * CONTACT_M / 4
