"""Segment a scan: grow planes over the mesh, join pieces of the same plane, and divide the remaining faces into connected parts.

Normals are first averaged over neighbouring faces, because depth noise of 5 mm changes the normal of a 5 cm triangle by 8 degrees. If the
scan has colour, planes are cut where their colour changes. Segments of similar colour that meet at a convex edge form a body (one object).
"""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.sparse.csgraph import connected_components

from radartwin.reconstruct.segmentation import coplanar
from radartwin.reconstruct.segmentation.bodies import with_bodies
from radartwin.reconstruct.segmentation.colour import AREA_M2, colour_pieces, face_colours
from radartwin.reconstruct.segmentation.face_arrays import Faces, Segment, members
from radartwin.reconstruct.segmentation.growing import absorb, grow

ANGLE_DEG = 25.0  # a face joins a plane up to this angle between its smoothed normal and the plane's normal
DISTANCE_M = 0.04  # largest distance of a face's centre from a plane that it joins; about twice the depth noise (phone LiDAR: 1-2 cm)
MIN_PLANE_M2 = 0.06  # planes with a smaller area are dissolved, and their faces then belong to no plane
SMOOTHING_M = 0.08  # radius for averaging normals; larger triangles keep their own normals
# limit instead of ANGLE_DEG for a remaining face with all corners within DISTANCE_M of a plane, because the tilt of such a face is noise
LOOSE_DEG = 75.0
MIN_PART_M2 = 0.01  # smaller connected parts are collected in one segment of fragments
MIN_WIDTH_M = 0.07  # narrower planes are rounded edges, and their faces join neighbouring planes


def segmented(mesh: trimesh.Trimesh) -> list[Segment]:
    """Segment a mesh (metres, z up). Each face of the mesh belongs to exactly one segment.

    The result lists the planes from large to small, then the parts that are not planar from large to small, and last a segment of all
    fragments.
    """
    faces = Faces.of(mesh, SMOOTHING_M)
    label = grow(faces, ANGLE_DEG, DISTANCE_M, MIN_PLANE_M2)
    absorb(faces, label, LOOSE_DEG, DISTANCE_M)
    label = coplanar.merge(faces, label)
    label = _without_narrow(faces, label)
    absorb(faces, label, 100.0, DISTANCE_M)
    _settle(faces, label)
    lab = face_colours(mesh)
    if lab is not None:
        label = _cut(faces, label, lab)
    planes = [plane_segment(faces, which) for which in members(label) if which.size]
    parts, fragments = _parts(faces, np.flatnonzero(label < 0))
    return with_bodies(faces, sorted(planes, key=lambda s: -s.area_m2) + parts, lab) + fragments


def _cut(faces: Faces, label: np.ndarray, lab: np.ndarray) -> np.ndarray:
    """Divide planes where their colour changes. `label` (F,) is the plane number of each face; the new plane numbers (F,) are returned."""
    out, count = label.copy(), int(label.max(initial=-1)) + 1
    for which in members(label):
        if faces.area[which].sum() < 2 * AREA_M2:
            continue
        piece = colour_pieces(faces.centre[which], faces.area[which], lab[which], faces.plane(which)[0])
        out[which[piece > 0]] = count + piece[piece > 0] - 1
        count += int(piece.max())
    return np.unique(out, return_inverse=True)[1] - int(out.min() < 0)


def _parts(faces: Faces, remaining: np.ndarray) -> tuple[list[Segment], list[Segment]]:
    """Divide the faces that belong to no plane into connected parts, largest first, and a list of at most one segment of all fragments."""
    if remaining.size == 0:
        return [], []
    count, part = connected_components(faces.adjacency[remaining][:, remaining], directed=False)
    area = np.bincount(part, faces.area[remaining], count)
    pieces = members(np.where(area[part] >= MIN_PART_M2, part, -1))
    parts = [Segment(remaining[which], float(faces.area[remaining[which]].sum())) for which in pieces if which.size]
    parts.sort(key=lambda s: -s.area_m2)
    fragments = remaining[area[part] < MIN_PART_M2]
    return parts, [Segment(fragments, float(faces.area[fragments].sum()), noise=True)] if fragments.size else []


def plane_segment(faces: Faces, which: np.ndarray) -> Segment:
    normal, offset = faces.plane(which)
    return Segment(which, float(faces.area[which].sum()), normal, offset)


def _settle(faces: Faces, label: np.ndarray) -> None:
    """Move faces at the common edge of two planes to the plane nearer to their corners, because smoothed normals blur the edge."""
    normal, offset = faces.planes(label)
    coo = faces.adjacency.tocoo()
    for _ in range(2 * faces.rounds):
        here, there = label[coo.row], label[coo.col]
        seam = (here >= 0) & (there >= 0) & (here != there)
        face, mine, other = coo.row[seam], here[seam], there[seam]
        old = faces.distance(face, normal[mine], offset[mine])
        new = faces.distance(face, normal[other], offset[other])
        closer = new < old
        if not closer.any():
            return
        label[face[closer]] = other[closer]


def _without_narrow(faces: Faces, label: np.ndarray) -> np.ndarray:
    """Remove the planes narrower than MIN_WIDTH_M (area / length) from `label`, so that their faces belong to no plane."""
    out = label.copy()
    for which in members(label):
        if which.size <= 2:
            continue
        spread = faces.centre[which] - faces.centre[which].mean(axis=0)
        axis = np.linalg.eigh(spread.T @ spread)[1][:, -1]
        if faces.area[which].sum() < MIN_WIDTH_M * np.ptp(spread @ axis):
            out[which] = -1
    return np.unique(out, return_inverse=True)[1] - int(out.min(initial=0) < 0)
