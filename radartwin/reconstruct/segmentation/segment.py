"""Coherent surfaces of a scan: planes grown over the mesh, pieces of one plane joined, and what is left as connected parts.

Normals are averaged over neighbouring faces first: 5 mm of depth noise on 5 cm triangles turns a face by 8 degrees. Where
the scan has colour, a plane is cut where its colour changes; convex neighbours of one colour are one body.
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
    """Mesh in, segments out; together they hold every face once, planes first, largest first."""

    def __call__(self, mesh: trimesh.Trimesh) -> list[Segment]: ...


@dataclass(frozen=True)
class PlanarRegionGrowing:
    """The default segmenter.

    Attributes:
        angle_deg: a face joins while its smoothed normal is this close to the plane's.
        distance_m: and its centre this close to the plane; about twice the depth noise (phone LiDAR: 1-2 cm).
        min_area_m2: a smaller plane is not one; its faces go to the leftovers.
        smoothing_m: radius over which normals are averaged; a triangle larger than this keeps its own.
        loose_deg: leftovers that touch a plane and lie within distance_m, corners and all, join it up to this angle:
            noise, not shape.
        merging: when pieces of one plane are one surface.
        min_part_m2: connected leftovers below this area are gathered in one last segment of fragments.
        min_width_m: a narrower plane is the rounding of an edge, and goes to its neighbours.
        colour: how planes are cut where their colour changes, if the mesh has colours; None never cuts.
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
        label = dissolved(faces, label, self.min_width_m)
        absorb(faces, label, 100.0, self.distance_m)
        settle(faces, label)
        lab = face_colours(mesh) if self.colour is not None else None
        if lab is not None:
            label = self._cut(faces, label, lab)
        planes = [plane_segment(faces, which) for which in members(label) if which.size]
        parts, fragments = self._parts(faces, np.flatnonzero(label < 0))
        segments = sorted(planes, key=lambda s: -s.area_m2) + parts
        return (with_bodies(faces, segments, lab) if self.bodies else segments) + fragments

    def _cut(self, faces: Faces, label: np.ndarray, lab: np.ndarray) -> np.ndarray:
        """Labels with planes cut along their colours."""
        assert self.colour is not None
        out, count = label.copy(), int(label.max(initial=-1)) + 1
        for which in members(label):
            if faces.area[which].sum() < 2 * self.colour.area_m2:
                continue
            piece = self.colour.pieces(faces.centre[which], faces.area[which], lab[which], faces.plane(which)[0])
            out[which[piece > 0]] = count + piece[piece > 0] - 1
            count += int(piece.max())
        return np.unique(out, return_inverse=True)[1] - int(out.min() < 0)

    def _parts(self, faces: Faces, left: np.ndarray) -> tuple[list[Segment], list[Segment]]:
        """Connected leftovers, largest first, and the fragments among them as one or none."""
        if left.size == 0:
            return [], []
        count, part = connected_components(faces.adjacency[left][:, left], directed=False)
        area = np.bincount(part, faces.area[left], count)
        pieces = members(np.where(area[part] >= self.min_part_m2, part, -1))
        parts = [Segment(left[which], float(faces.area[left[which]].sum())) for which in pieces if which.size]
        parts.sort(key=lambda s: -s.area_m2)
        fragments = left[area[part] < self.min_part_m2]
        return parts, [Segment(fragments, float(faces.area[fragments].sum()), noise=True)] if fragments.size else []


def plane_segment(faces: Faces, which: np.ndarray) -> Segment:
    """A segment with the plane fitted to its faces."""
    normal, offset = faces.plane(which)
    return Segment(which, float(faces.area[which].sum()), normal, offset)


def settle(faces: Faces, label: np.ndarray) -> None:
    """Give faces on the seam of two planes to the one their corners lie closer to, ring by ring, in place.

    Smoothed normals blur a crease over a face or two on either side of it.
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


def dissolved(faces: Faces, label: np.ndarray, min_width_m: float) -> np.ndarray:
    """Labels without planes narrower than `min_width_m`: area over length."""
    out = label.copy()
    for which in members(label):
        if which.size <= 2:
            continue
        spread = faces.centre[which] - faces.centre[which].mean(axis=0)
        axis = np.linalg.eigh(spread.T @ spread)[1][:, -1]
        if faces.area[which].sum() < min_width_m * np.ptp(spread @ axis):
            out[which] = -1
    return np.unique(out, return_inverse=True)[1] - int(out.min(initial=0) < 0)
