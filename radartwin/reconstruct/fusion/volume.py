"""A truncated signed distance volume in sparse blocks, filled from depth pictures. Ref: Curless and Levoy 1996, A volumetric method
for building complex models from range images; blocks as in Niessner et al. 2013, Real-time 3D reconstruction at scale.

Symbols: D(x) -> sdf, positive before a surface; W(x) -> weight; truncation is the largest distance kept on either side.

A pixel's distance is measured to the plane of its surface, not along the ray: the depth difference times the pixel's `slope`,
|n . r| with n the surface's normal and r the ray of unit depth. Behind the surface the weight falls to zero at the truncation, so
that the two sides of a thin board spoil each other less.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.errors import ScanError

SIDE = 8  # voxels along a block's edge
MAX_BLOCKS = 130_000  # 66 million voxels, 1.6 GB with colour


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """A depth picture prepared for the volume.

    Attributes:
        pose: (4, 4) camera-to-world.
        intrinsics: (3, 3) of the depth.
        depth: (h, w) float32 metres, 0 where there is none.
        slope: (h, w) float32, |n . r|.
        weight: (h, w) float32, inverse variance relative to that of a sure pixel seen squarely at 1 m.
        colour: (H, W, 3) uint8, or None.
        colour_intrinsics: (3, 3), or None.
    """

    pose: np.ndarray
    intrinsics: np.ndarray
    depth: np.ndarray
    slope: np.ndarray
    weight: np.ndarray
    colour: np.ndarray | None = None
    colour_intrinsics: np.ndarray | None = None


class Volume:
    """Blocks of SIDE^3 voxels wherever a surface was seen; voxel (i, j, k) lies at origin + voxel * (i, j, k).

    Args:
        low, high: (3,) corners of what may be seen, metres.
        voxel_m: edge of a voxel.
        truncation_m: largest distance kept.
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
        """Note the blocks within the truncation of the view's surface."""
        fx, fy, cx, cy = _pinhole(view.intrinsics)
        _mark(view.depth, view.weight, fx, fy, cx, cy, view.pose, self.origin, SIDE * self.voxel_m, self.truncation_m, self._marked)

    def allocate(self) -> int:
        """Make room for the marked blocks; returns how many there are.

        Raises:
            ScanError: more than fit in memory.
        """
        self.blocks = np.argwhere(self._marked).astype(np.int32)
        count = len(self.blocks)
        if count > MAX_BLOCKS:
            larger = self.voxel_m * (count / MAX_BLOCKS) ** 0.5
            raise ScanError(f"{count} blocks of voxels of {self.voxel_m:g} m do not fit; pass voxel_m={larger:.2f} or more")
        self.slot[tuple(self.blocks.T)] = np.arange(count)
        cells = (count, SIDE, SIDE, SIDE)
        self.sdf, self.weight = np.zeros(cells, np.float32), np.zeros(cells, np.float32)
        self.colour, self.colour_weight = np.zeros((*cells, 3), np.float32), np.zeros(cells, np.float32)
        return count

    def clear(self) -> None:
        """Forget what was integrated, keep the blocks."""
        for values in (self.sdf, self.weight, self.colour, self.colour_weight):
            values[:] = 0

    def integrate(self, view: View) -> None:
        """Average the view into every block that it sees; blocks are independent, so the result does not depend on threads."""
        fx, fy, cx, cy = _pinhole(view.intrinsics)
        coloured = view.colour is not None
        colour = view.colour if view.colour is not None else np.zeros((1, 1, 3), np.uint8)
        lens = _pinhole(view.colour_intrinsics) if view.colour_intrinsics is not None else (1.0, 1.0, 0.0, 0.0)
        turned = view.pose[:3, :3].T.copy()
        shared_out(
            _integrate, len(self.blocks), self.blocks, self.sdf, self.weight, self.colour, self.colour_weight, self.origin, self.voxel_m,
            self.truncation_m, turned, -turned @ view.pose[:3, 3], np.array([fx, fy, cx, cy]), view.depth, view.slope, view.weight,
            coloured, colour, np.array(lens),
        )  # fmt: skip

    def distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distance (N,) and its gradient (N, 3) at world points (N, 3), trilinear; NaN beside observed voxels."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        value, gradient = np.empty(len(points)), np.empty((len(points), 3))
        shared_out(_distance, len(points), points, self.slot, self.sdf, self.weight, self.origin, self.voxel_m, value, gradient)
        return value, gradient


def _pinhole(intrinsics: np.ndarray) -> tuple[float, float, float, float]:
    return float(intrinsics[0, 0]), float(intrinsics[1, 1]), float(intrinsics[0, 2]), float(intrinsics[1, 2])


@compiled
def _mark(depth, weight, fx, fy, cx, cy, pose, origin, edge, truncation, marked):
    nx, ny, nz = marked.shape
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            d = depth[v, u]
            if d <= 0 or weight[v, u] <= 0:
                continue
            x, y = (u - cx) / fx, (v - cy) / fy
            length = np.sqrt(x * x + y * y + 1)
            steps = int(np.ceil(2 * truncation / (0.5 * edge))) + 1
            for s in range(steps + 1):
                z = d + (2 * s / steps - 1) * truncation / length
                i = int((pose[0, 0] * x * z + pose[0, 1] * y * z + pose[0, 2] * z + pose[0, 3] - origin[0]) / edge)
                j = int((pose[1, 0] * x * z + pose[1, 1] * y * z + pose[1, 2] * z + pose[1, 3] - origin[1]) / edge)
                k = int((pose[2, 0] * x * z + pose[2, 1] * y * z + pose[2, 2] * z + pose[2, 3] - origin[2]) / edge)
                if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
                    marked[i, j, k] = 1


@compiled
def _integrate(
    first, last, blocks, sdf, weight, colour, colour_weight, origin, voxel, truncation, turn, shift, lens, depth, slope, sure,
    coloured, picture, picture_lens,
):  # fmt: skip
    height, width = depth.shape
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    edge = SIDE * voxel
    radius = 0.87 * edge
    for b in range(first, last):
        # The block's sphere against the view's cone, a pixel generous.
        x0, y0, z0 = origin[0] + edge * blocks[b, 0], origin[1] + edge * blocks[b, 1], origin[2] + edge * blocks[b, 2]
        x, y, z = x0 + edge / 2, y0 + edge / 2, z0 + edge / 2
        zc = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
        if zc < -radius:
            continue
        if zc > 2 * radius:
            xc = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0]
            yc = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1]
            reach = 1.5 * radius / (zc - radius)
            if not (-reach * fx - 1 < fx * xc / zc + cx < width + reach * fx and -reach * fy - 1 < fy * yc / zc + cy < height + reach * fy):
                continue
        for i in range(SIDE):
            for j in range(SIDE):
                for k in range(SIDE):
                    x, y, z = x0 + voxel * i, y0 + voxel * j, z0 + voxel * k
                    zc = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
                    if zc < 0.05:
                        continue
                    xc = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0]) / zc
                    yc = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1]) / zc
                    u, v = fx * xc + cx, fy * yc + cy
                    m, n = int(np.floor(v + 0.5)), int(np.floor(u + 0.5))
                    if m < 0 or n < 0 or m >= height or n >= width:
                        continue
                    d, w = depth[m, n], sure[m, n]
                    if d <= 0 or w <= 0:
                        continue
                    # Between four pixels of one surface the depth is interpolated; across an edge it is not.
                    m0, n0 = int(np.floor(v)), int(np.floor(u))
                    if m0 >= 0 and n0 >= 0 and m0 + 1 < height and n0 + 1 < width:
                        a, c, e, g = depth[m0, n0], depth[m0, n0 + 1], depth[m0 + 1, n0], depth[m0 + 1, n0 + 1]
                        if min(min(a, c), min(e, g)) > 0.95 * d and max(max(a, c), max(e, g)) < 1.05 * d:
                            p, q = u - n0, v - m0
                            d = (1 - q) * ((1 - p) * a + p * c) + q * ((1 - p) * e + p * g)
                    along = (d - zc) * slope[m, n]
                    if along < -truncation:
                        continue
                    if along < -voxel:
                        w = w * (truncation + along) / (truncation - voxel)
                    value = min(along, truncation)
                    old = weight[b, i, j, k]
                    total = old + w
                    if total <= 0:
                        continue
                    sdf[b, i, j, k] += w / total * (value - sdf[b, i, j, k])
                    weight[b, i, j, k] = total
                    if coloured and abs(along) < 2 * voxel:
                        m = int(np.floor(picture_lens[1] * yc + picture_lens[3] + 0.5))
                        n = int(np.floor(picture_lens[0] * xc + picture_lens[2] + 0.5))
                        if 0 <= m < picture.shape[0] and 0 <= n < picture.shape[1]:
                            share = w / (colour_weight[b, i, j, k] + w)
                            colour_weight[b, i, j, k] += w
                            for channel in range(3):
                                colour[b, i, j, k, channel] += share * (picture[m, n, channel] - colour[b, i, j, k, channel])


@compiled
def _distance(first, last, points, slot, sdf, weight, origin, voxel, value, gradient):
    nx, ny, nz = slot.shape
    corner = np.empty((2, 2, 2))
    for p in range(first, last):
        value[p] = np.nan
        gradient[p, :] = np.nan
        x, y, z = (points[p, 0] - origin[0]) / voxel, (points[p, 1] - origin[1]) / voxel, (points[p, 2] - origin[2]) / voxel
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        known = i >= 0 and j >= 0 and k >= 0 and i + 1 < nx * SIDE and j + 1 < ny * SIDE and k + 1 < nz * SIDE
        for c in range(8):
            if not known:
                break
            di, dj, dk = c >> 2, (c >> 1) & 1, c & 1
            b = slot[(i + di) // SIDE, (j + dj) // SIDE, (k + dk) // SIDE]
            if b < 0 or weight[b, (i + di) % SIDE, (j + dj) % SIDE, (k + dk) % SIDE] <= 0:
                known = False
            else:
                corner[di, dj, dk] = sdf[b, (i + di) % SIDE, (j + dj) % SIDE, (k + dk) % SIDE]
        if not known:
            continue
        a, c, e = x - i, y - j, z - k
        plane = (1 - a) * corner[0] + a * corner[1]
        line = (1 - c) * plane[0] + c * plane[1]
        value[p] = (1 - e) * line[0] + e * line[1]
        gradient[p, 2] = (line[1] - line[0]) / voxel
        across = plane[1] - plane[0]
        gradient[p, 1] = ((1 - e) * across[0] + e * across[1]) / voxel
        across = corner[1] - corner[0]
        gradient[p, 0] = ((1 - c) * ((1 - e) * across[0, 0] + e * across[0, 1]) + c * ((1 - e) * across[1, 0] + e * across[1, 1])) / voxel
