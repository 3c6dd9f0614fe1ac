"""Fill a truncated signed distance volume, stored in sparse blocks, from depth pictures.

Ref: Curless and Levoy 1996, A volumetric method for building complex models from range images. The blocks are stored as in Niessner et al.
2013, Real-time 3D reconstruction at scale.

Symbols: D(x) -> sdf, positive in front of a surface; W(x) -> weight. The truncation distance is the largest distance
from a surface that the volume stores, on either side of the surface.

The distance between a voxel and the surface at a pixel is measured perpendicular to the surface, not along the ray. This distance is the
depth difference times the pixel's `slope` |n . r|, where n is the surface normal and r is the ray with a depth component of 1. Behind the
surface, the weight of a voxel decreases to zero at the truncation distance, so that the measurements of the two sides of a thin board
disturb each other less.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost, shared_out
from radartwin.errors import ScanError

SIDE = 8  # voxels along a block's edge
MAX_BLOCKS = 130_000  # 66 million voxels, 1.6 GB with colour


class View(NamedTuple):
    """A depth picture with its pose, slopes and weights, prepared for averaging into the volume.

    Attributes:
        pose: (4, 4) camera-to-world pose, OpenCV camera axes, metres.
        lens: (4,) focal lengths and principal point (fx, fy, cx, cy) of the depth picture, pixels.
        depth: (h, w) float32 depth along the camera's z axis, metres; 0 at pixels without depth.
        slope: (h, w) float32 |n . r| of surface normal n and pixel ray r (depth component 1).
        weight: (h, w) float32 inverse variance of the depth, multiplied by the cosine of the angle of incidence, relative to a pixel of
            high confidence at 1 m and normal incidence.
        colour: (H, W, 3) uint8 sRGB picture; without pixels if the frame has no colour.
        colour_lens: (4,) lens of `colour`.
    """

    pose: np.ndarray
    lens: np.ndarray
    depth: np.ndarray
    slope: np.ndarray
    weight: np.ndarray
    colour: np.ndarray
    colour_lens: np.ndarray


class Volume:
    """A signed distance volume between the corners `low` and `high` (3,) in metres.

    Only blocks of SIDE^3 voxels near observed surfaces are stored.

    Voxel (i, j, k) lies at origin + voxel_m * (i, j, k). `truncation_m` is the largest distance in metres that the volume stores.
    """

    def __init__(self, low: np.ndarray, high: np.ndarray, voxel_m: float, truncation_m: float) -> None:
        self.voxel_m, self.truncation_m = float(voxel_m), float(truncation_m)
        edge = SIDE * self.voxel_m
        margin = self.truncation_m + self.voxel_m
        self.origin = np.floor((np.asarray(low, dtype=np.float64) - margin) / edge) * edge
        self.shape = tuple(int(n) for n in np.ceil((np.asarray(high) + margin - self.origin) / edge).astype(int) + 1)
        self.slot = np.full(self.shape, -1, dtype=np.int32)
        self._marked = np.zeros(self.shape, dtype=np.uint8)
        self.blocks = np.zeros((0, 3), dtype=np.int32)

    def mark(self, view: View) -> None:
        """Mark the blocks within the truncation distance of the surface that the view measured."""
        _mark(view.depth, view.weight, view.lens, view.pose, self.origin, SIDE * self.voxel_m, self.truncation_m, self._marked)

    def allocate(self) -> None:
        """Allocate memory for the marked blocks, or raise a ScanError if there are more than MAX_BLOCKS."""
        self.blocks = np.argwhere(self._marked).astype(np.int32)
        count = len(self.blocks)
        if count > MAX_BLOCKS:
            larger = self.voxel_m * (count / MAX_BLOCKS) ** 0.5
            raise ScanError(f"{count} blocks of voxels of {self.voxel_m:g} m do not fit in memory; pass voxel_m={larger:.2f} or more")
        self.slot[tuple(self.blocks.T)] = np.arange(count)
        cells = (count, SIDE, SIDE, SIDE)
        self.sdf, self.weight = np.zeros(cells, np.float32), np.zeros(cells, np.float32)
        self.colour, self.colour_weight = np.zeros((*cells, 3), np.float32), np.zeros(cells, np.float32)

    def integrate(self, view: View) -> None:
        """Average a view into every block in its field of view.

        Blocks are independent of each other, so the result does not depend on the number of threads.
        """
        rotation = view.pose[:3, :3].T.copy()
        voxels = (self.blocks, self.sdf, self.weight, self.colour, self.colour_weight, self.origin, self.voxel_m, self.truncation_m)
        shared_out(_integrate, len(self.blocks), voxels, view, rotation, -rotation @ view.pose[:3, 3])


@compiled
def _mark(depth, weight, lens, pose, origin, edge, truncation, marked):
    """Set `marked` (X, Y, Z) to 1 at the blocks on each pixel's ray that are at most `truncation` metres from the pixel's surface point."""
    nx, ny, nz = marked.shape
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            d = depth[v, u]
            if d <= 0 or weight[v, u] <= 0:
                continue
            x, y = (u - lens[2]) / lens[0], (v - lens[3]) / lens[1]
            length = np.sqrt(x * x + y * y + 1)
            steps = int(np.ceil(2 * truncation / (0.5 * edge))) + 1
            for s in range(steps + 1):
                z = d + (2 * s / steps - 1) * truncation / length
                i = int((pose[0, 0] * x * z + pose[0, 1] * y * z + pose[0, 2] * z + pose[0, 3] - origin[0]) / edge)
                j = int((pose[1, 0] * x * z + pose[1, 1] * y * z + pose[1, 2] * z + pose[1, 3] - origin[1]) / edge)
                k = int((pose[2, 0] * x * z + pose[2, 1] * y * z + pose[2, 2] * z + pose[2, 3] - origin[2]) / edge)
                if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
                    marked[i, j, k] = 1


@innermost
def _in_view(x, y, z, radius, rotation, shift, lens, shape):
    """Return whether a sphere about (x, y, z) may appear in the camera's picture, with a margin of one pixel."""
    zc = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + shift[2]
    if zc < -radius:
        return False
    if zc <= 2 * radius:
        return True
    xc = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + shift[0]
    yc = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + shift[1]
    reach = 1.5 * radius / (zc - radius)
    u, v = lens[0] * xc / zc + lens[2], lens[1] * yc / zc + lens[3]
    return -reach * lens[0] - 1 < u < shape[1] + reach * lens[0] and -reach * lens[1] - 1 < v < shape[0] + reach * lens[1]


@innermost
def _interpolated(depth, u, v, d):
    """Return the depth at (u, v): bilinear between four pixels that show the same surface, otherwise the depth d of the nearest pixel."""
    m0, n0 = int(np.floor(v)), int(np.floor(u))
    if m0 >= 0 and n0 >= 0 and m0 + 1 < depth.shape[0] and n0 + 1 < depth.shape[1]:
        a, c, e, g = depth[m0, n0], depth[m0, n0 + 1], depth[m0 + 1, n0], depth[m0 + 1, n0 + 1]
        if min(min(a, c), min(e, g)) > 0.95 * d and max(max(a, c), max(e, g)) < 1.05 * d:
            p, q = u - n0, v - m0
            return (1 - q) * ((1 - p) * a + p * c) + q * ((1 - p) * e + p * g)
    return float(d)


@compiled
def _integrate(first, last, voxels, view, rotation, shift):
    """Average the depth and colour of a view, with its world-to-camera pose, into the voxels of the blocks number `first` to `last`."""
    indices, sdf, weight, colour, colour_weight, origin, voxel, truncation = voxels
    _, lens, depth, slope, pixel_weight, picture, picture_lens = view
    height, width = depth.shape
    edge = SIDE * voxel
    for b in range(first, last):
        x0, y0, z0 = origin[0] + edge * indices[b, 0], origin[1] + edge * indices[b, 1], origin[2] + edge * indices[b, 2]
        if not _in_view(x0 + edge / 2, y0 + edge / 2, z0 + edge / 2, 0.87 * edge, rotation, shift, lens, depth.shape):
            continue
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    x, y, z = x0 + voxel * i, y0 + voxel * j, z0 + voxel * k
                    zc = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z + shift[2]
                    if zc < 0.05:
                        continue
                    xc = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z + shift[0]) / zc
                    yc = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z + shift[1]) / zc
                    u, v = lens[0] * xc + lens[2], lens[1] * yc + lens[3]
                    m, n = int(np.floor(v + 0.5)), int(np.floor(u + 0.5))
                    if m < 0 or n < 0 or m >= height or n >= width:
                        continue
                    d, w = depth[m, n], pixel_weight[m, n]
                    if d <= 0 or w <= 0:
                        continue
                    along = (_interpolated(depth, u, v, d) - zc) * slope[m, n]
                    if along < -truncation:
                        continue
                    if along < -voxel:
                        w = w * (truncation + along) / (truncation - voxel)
                    value = min(along, truncation)
                    total = weight[b, i, j, k] + w
                    if total <= 0:
                        continue
                    sdf[b, i, j, k] += w / total * (value - sdf[b, i, j, k])
                    weight[b, i, j, k] = total
                    if abs(along) < 2 * voxel:
                        m = int(np.floor(picture_lens[1] * yc + picture_lens[3] + 0.5))
                        n = int(np.floor(picture_lens[0] * xc + picture_lens[2] + 0.5))
                        if 0 <= m < picture.shape[0] and 0 <= n < picture.shape[1]:
                            share = w / (colour_weight[b, i, j, k] + w)
                            colour_weight[b, i, j, k] += w
                            for channel in range(3):
                                colour[b, i, j, k, channel] += share * (picture[m, n, channel] - colour[b, i, j, k, channel])
