"""Segment a scan: grow planes over the mesh, join pieces of one plane, and take the other faces as connected parts.

Normals are first averaged over neighbouring faces, because 5 mm of depth noise on 5 cm triangles turns a face by 8 degrees. If the scan
has colour, planes are cut where their colour changes, and convex neighbours of one colour form one body.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import trimesh
from scipy.sparse.csgraph import connected_components

from radartwin.reconstruct.segmentation import coplanar
from radartwin.reconstruct.segmentation.bodies import with_bodies
from radartwin.reconstruct.segmentation.colour import ColourSplit, face_colours
from radartwin.reconstruct.segmentation.faces import Faces, Segment, members
from radartwin.reconstruct.segmentation.growing import absorb, grow


class Segmenter(Protocol):
    """Divides the faces of a mesh into segments, planes first, largest first."""

    def __call__(self, mesh: trimesh.Trimesh) -> list[Segment]: ...


@dataclass(frozen=True)
class PlanarRegionGrowing:
    """The default segmenter.

    Attributes:
        angle_deg: largest angle between a face's smoothed normal and the plane's for the face to join.
        distance_m: largest distance of its centre from the plane; about twice the depth noise (phone LiDAR: 1-2 cm).
        min_area_m2: smaller planes are dissolved.
        smoothing_m: radius for averaging normals; larger triangles keep their own normals.
        loose_deg: largest angle for a remaining face that touches a plane and has all corners within distance_m, because its tilt is
            noise.
        merging: limits for joining pieces of one plane.
        min_part_m2: smaller connected parts are collected in one last segment of fragments.
        min_width_m: narrower planes are rounded edges, and go to their neighbours.
        colour: limits for cutting planes where their colour changes; None never cuts.
        bodies: number convex neighbours of one colour as one body.
    """

    angle_deg: float = 25.0
    distance_m: float = 0.04
    min_area_m2: float = 0.06
    smoothing_m: float = 0.08
    loose_deg: float = 75.0
    merging: coplanar.Tolerances = field(default_factory=coplanar.Tolerances)
    min_part_m2: float = 0.01
    min_width_m: float = 0.07
    colour: ColourSplit | None = field(default_factory=ColourSplit)
    bodies: bool = True

    def __call__(self, mesh: trimesh.Trimesh) -> list[Segment]:
        faces = Faces.of(mesh, self.smoothing_m)
        label = grow(faces, self.angle_deg, self.distance_m, self.min_area_m2)
        absorb(faces, label, self.loose_deg, self.distance_m)
        label = coplanar.merge(faces, label, self.merging)
        label = _without_narrow(faces, label, self.min_width_m)
        absorb(faces, label, 100.0, self.distance_m)
        _settle(faces, label)
        lab = face_colours(mesh) if self.colour is not None else None
        if lab is not None:
            label = self._cut(faces, label, lab)
        planes = [plane_segment(faces, which) for which in members(label) if which.size]
        parts, fragments = self._parts(faces, np.flatnonzero(label < 0))
        segments = sorted(planes, key=lambda s: -s.area_m2) + parts
        return (with_bodies(faces, segments, lab) if self.bodies else segments) + fragments

    def _cut(self, faces: Faces, label: np.ndarray, lab: np.ndarray) -> np.ndarray:
        """Labels with planes cut where their colour changes."""
        assert self.colour is not None
        out, count = label.copy(), int(label.max(initial=-1)) + 1
        for which in members(label):
            if faces.area[which].sum() < 2 * self.colour.area_m2:
                continue
            piece = self.colour.pieces(faces.centre[which], faces.area[which], lab[which], faces.plane(which)[0])
            out[which[piece > 0]] = count + piece[piece > 0] - 1
            count += int(piece.max())
        return np.unique(out, return_inverse=True)[1] - int(out.min() < 0)

    def _parts(self, faces: Faces, remaining: np.ndarray) -> tuple[list[Segment], list[Segment]]:
        """Connected parts of the remaining faces, largest first, and a list with one segment of all fragments, or none."""
        if remaining.size == 0:
            return [], []
        count, part = connected_components(faces.adjacency[remaining][:, remaining], directed=False)
        area = np.bincount(part, faces.area[remaining], count)
        pieces = members(np.where(area[part] >= self.min_part_m2, part, -1))
        parts = [Segment(remaining[which], float(faces.area[remaining[which]].sum())) for which in pieces if which.size]
        parts.sort(key=lambda s: -s.area_m2)
        fragments = remaining[area[part] < self.min_part_m2]
        return parts, [Segment(fragments, float(faces.area[fragments].sum()), noise=True)] if fragments.size else []


def plane_segment(faces: Faces, which: np.ndarray) -> Segment:
    """A planar segment from faces."""
    normal, offset = faces.plane(which)
    return Segment(which, float(faces.area[which].sum()), normal, offset)


def _settle(faces: Faces, label: np.ndarray) -> None:
    """Give faces along the seam of two planes to the plane nearer to their corners, ring by ring, in place.

    Smoothed normals blur an edge over one or two faces on either side.
    """
    normal, offset = faces.planes(label)
    coo = faces.adjacency.tocoo()
    for _ in range(2 * faces.rounds):
        here, there = label[coo.row], label[coo.col]
        seam = (here >= 0) & (there >= 0) & (here != there)
        face, mine, other = coo.row[seam], here[seam], there[seam]
        own = faces.distance(face, normal[mine], offset[mine])
        new = faces.distance(face, normal[other], offset[other])
        closer = new < own
        if not closer.any():
            return
        label[face[closer]] = other[closer]


def _without_narrow(faces: Faces, label: np.ndarray, min_width_m: float) -> np.ndarray:
    """Labels without planes whose width (area over length) is below `min_width_m`."""
    out = label.copy()
    for which in members(label):
        if which.size <= 2:
            continue
        spread = faces.centre[which] - faces.centre[which].mean(axis=0)
        axis = np.linalg.eigh(spread.T @ spread)[1][:, -1]
        if faces.area[which].sum() < min_width_m * np.ptp(spread @ axis):
            out[which] = -1
    return np.unique(out, return_inverse=True)[1] - int(out.min(initial=0) < 0)
