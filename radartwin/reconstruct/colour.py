"""Surfaces that differ by colour alone: a door in its wall, a poster, a metal strip along a painted wall.

A plane's colours are laid out as a picture and divided in two as often as the division is a real edge: a step between
neighbouring cells, not a gradient of light, over a piece wide and large enough to be a thing. Colours are CIE L*a*b* with
lightness scaled down, since shading changes lightness first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from radartwin.reconstruct.coplanar import in_plane

LIGHTNESS = 0.6  # weight of L* against a* and b*
NEAR_CELLS = (1, 5)  # a step is measured between cells this far from the edge on either side
ROUNDS = 12  # divisions tried per plane


@dataclass(frozen=True)
class ColourSplit:
    """When a piece of a plane is a surface of its own.

    Attributes:
        cell_m: of the picture; about the scan's resolution.
        step: least colour difference across its edge (weighted L*a*b*; 2 is just visible beside each other).
        contrast: and at least this many standard deviations of the colours beside the edge.
        width_m: narrower pieces (painted lines, frames) stay with what they are on.
        area_m2: so do smaller ones.
    """

    cell_m: float = 0.02
    step: float = 9.0
    contrast: float = 1.5
    width_m: float = 0.12
    area_m2: float = 0.08

    def pieces(self, centre: np.ndarray, area: np.ndarray, lab: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """Piece number of each face (K,), 0 for the main one.

        Args:
            centre: (K, 3) of the plane's faces; area: (K,); lab: (K, 3) from `face_colours`; normal: (3,).
        """
        from scipy.ndimage import distance_transform_edt, median_filter

        points = centre @ in_plane(normal).T
        # A picture finer than its faces is full of holes.
        cell = max(self.cell_m, 1.5 * float(np.sqrt(np.median(area))))
        at = ((points - points.min(axis=0)) / cell).astype(int)
        shape = tuple(at.max(axis=0) + 1)
        index = at[:, 0] * shape[1] + at[:, 1]
        weight = np.bincount(index, area, minlength=shape[0] * shape[1]).reshape(shape)
        seen = weight > 0
        picture = np.stack([np.bincount(index, area * lab[:, k], minlength=weight.size).reshape(shape) for k in range(3)], axis=-1)
        picture /= np.maximum(weight, 1e-12)[..., None]
        nearest = distance_transform_edt(~seen, return_distances=False, return_indices=True)
        picture = picture[tuple(nearest)]
        smooth = np.stack([median_filter(picture[..., k], size=5, mode="nearest") for k in range(3)], axis=-1)
        known = distance_transform_edt(~seen, sampling=cell) < 0.08
        label = np.where(known, 0, -1)
        self._divide(label, smooth, cell)
        return np.maximum(label.reshape(-1)[index], 0)

    def _divide(self, label: np.ndarray, picture: np.ndarray, cell: float) -> None:
        """Number the pieces of a picture (W, H, 3) in place; -1 stays outside."""
        count, todo = 1, [0]
        for _ in range(ROUNDS):
            if not todo:
                return
            current = todo.pop()
            found = self._pieces_of(label == current, picture, cell)
            for piece in found:
                label[piece] = count
                todo.append(count)
                count += 1
            if found:
                todo.append(current)

    def _pieces_of(self, region: np.ndarray, picture: np.ndarray, cell: float) -> list[np.ndarray]:
        from scipy.ndimage import binary_closing, binary_dilation, binary_opening
        from scipy.ndimage import label as connected

        values = picture[region]
        if len(values) * cell**2 < 2 * self.area_m2:
            return []
        minor = np.zeros(region.shape, dtype=bool)
        minor[region] = _two_means(values)
        disc = _disc(max(1, round(self.width_m / 2 / cell)))
        minor = binary_opening(np.pad(minor, len(disc), mode="edge"), disc)[len(disc) : -len(disc), len(disc) : -len(disc)]
        minor = binary_closing(minor, _disc(2)) | minor
        minor &= region
        parts, count = connected(minor)
        found = []
        for k in range(1, count + 1):
            piece = binary_dilation(parts == k, _disc(1)) & minor
            if self.area_m2 <= piece.sum() * cell**2 and self._is_step(piece, region & ~minor, picture):
                found.append(piece)
        return found

    def _is_step(self, piece: np.ndarray, rest: np.ndarray, picture: np.ndarray) -> bool:
        from scipy.ndimage import distance_transform_edt

        near, far = NEAR_CELLS
        to_rest, to_piece = distance_transform_edt(~rest), distance_transform_edt(~piece)
        inside = picture[piece & (to_rest > near) & (to_rest <= far)]
        outside = picture[rest & (to_piece > near) & (to_piece <= far)]
        if min(len(inside), len(outside)) < 8:
            return False
        step = np.median(inside, axis=0) - np.median(outside, axis=0)
        size = float(np.linalg.norm(step))
        along = step / max(size, 1e-12)
        spread = max(float((inside @ along).std()), float((outside @ along).std()))
        return size >= self.step and size >= self.contrast * spread


def face_colours(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Weighted L*a*b* of every face (F, 3), or None where the mesh has no colour or only one."""
    rgb = face_rgb(mesh)
    if rgb is None or float(np.ptp(rgb, axis=0).max()) < 4:
        return None
    return weighted_lab(rgb)


def weighted_lab(rgb: np.ndarray) -> np.ndarray:
    """Weighted L*a*b* (N, 3) of sRGB colours (N, 3), 0..255."""
    from skimage.color import rgb2lab

    return rgb2lab(rgb[:, None] / 255)[:, 0] * [LIGHTNESS, 1.0, 1.0]


def face_rgb(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """sRGB of every face (F, 3), 0..255 floats, or None for a mesh without colours."""
    visual = mesh.visual
    if visual.kind == "vertex":
        return np.asarray(visual.vertex_colors)[:, :3][np.asarray(mesh.faces)].mean(axis=1)
    if visual.kind == "face":
        return np.asarray(visual.face_colors)[:, :3].astype(float)
    return None


def _two_means(values: np.ndarray) -> np.ndarray:
    """Which values (N, 3) belong to the smaller of two clusters."""
    centred = values - values.mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    second = centred @ axis > _otsu(centred @ axis)
    for _ in range(10):
        if second.all() or not second.any():
            return np.zeros(len(values), dtype=bool)
        a, b = values[~second].mean(axis=0), values[second].mean(axis=0)
        again = ((values - b) ** 2).sum(axis=1) < ((values - a) ** 2).sum(axis=1)
        if (again == second).all():
            break
        second = again
    return second if second.sum() * 2 <= len(second) else ~second


def _otsu(values: np.ndarray) -> float:
    """The threshold of largest variance between what lies below and above (Otsu 1979)."""
    counts, edges = np.histogram(values, 128)
    middle = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * middle)
    mean_below = sums / np.maximum(below, 1)
    mean_above = (sums[-1] - sums) / np.maximum(above, 1)
    return float(edges[1:][np.argmax(below * above * (mean_below - mean_above) ** 2)])


def _disc(radius: int) -> np.ndarray:
    x, y = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return x * x + y * y <= radius * radius + 0.5 * radius
