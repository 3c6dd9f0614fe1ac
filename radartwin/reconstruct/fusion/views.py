"""Prepare depth pictures for fusion: compute the slope of the surface at each pixel, and the weight of each pixel."""

from __future__ import annotations

import numpy as np

from radartwin.compiled import compiled
from radartwin.reconstruct.frames.frames import Frame, Frames, rescaled
from radartwin.reconstruct.fusion.volume import View

# Standard deviation of the depth z: floor + slope z + curve z^2, for low, medium and high confidence. For high confidence it is 5 mm at 1 m
# and 13 mm at 5 m; only ratios matter. The values for low and medium confidence are fitted to the real frames of
# docs/decisions/005-virtual-scanner.md (low: 21 to 111 mm, medium: 12 to 43 mm, from 1.25 to 3.25 m). A pixel of low confidence has little
# weight beside a pixel of high confidence, but dark and distant surfaces often have only pixels of low confidence.
NOISE_FLOOR_M, NOISE_PER_M = 0.003, 0.002
NOISE = np.array([[0.0, 0.0, 0.0105], [0.0, 0.0, 0.0041], [NOISE_FLOOR_M, NOISE_PER_M, 0.0]], np.float32)
REFERENCE_NOISE_M = NOISE_FLOOR_M + NOISE_PER_M  # noise of a pixel with weight 1: high confidence, 1 m, normal incidence
STEP = 2  # the slope at a pixel is computed from the pixels at this distance on either side, in pixels
MIN_COSINE = 0.15  # cosine of the angle of incidence; pixels beyond 81 degrees from the surface normal are discarded as edges
CACHE_BYTES = 1_000_000_000


class Views:
    """Prepares the pictures of frames for fusion, and discards depths over `max_range_m`.

    Up to CACHE_BYTES of prepared views are cached, because the fusion reads each view several times.
    """

    def __init__(self, frames: Frames, max_range_m: float) -> None:
        self.frames, self.max_range_m = frames, max_range_m
        self.poses = frames.poses.copy()
        self._cache: dict[int, View] = {}
        self._bytes = 0

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> View:
        """Return the prepared view of frame `index` at its current pose."""
        view = self._cache.get(index)
        if view is None:
            view = prepared(self.frames[index], self.max_range_m)
            self._bytes += 3 * view.depth.nbytes + view.colour.nbytes
            if self._bytes < CACHE_BYTES:
                self._cache[index] = view
        return view._replace(pose=self.poses[index])


def prepared(frame: Frame, max_range_m: float) -> View:
    """Prepare the pictures of a frame for fusion.

    >>> depth = np.full((9, 9), 2.0, np.float32)
    >>> intrinsics = np.array([[10.0, 0, 4], [0, 10, 4], [0, 0, 1]])
    >>> float(prepared(Frame("wall", np.eye(4), intrinsics, depth), 5.0).slope[4, 4])
    1.0
    """
    depth = np.where(frame.depth_m <= max_range_m, frame.depth_m, np.float32(0)).astype(np.float32)
    confidence = np.full(depth.shape, 2, np.uint8) if frame.confidence is None else np.minimum(frame.confidence, 2)
    lens = _lens(frame.intrinsics)
    noise = NOISE[confidence]
    # standard deviation of each depth pixel in metres, at least that of a pixel of high confidence
    sigma = np.maximum(noise[..., 0] + (noise[..., 1] + noise[..., 2] * depth) * depth, NOISE_FLOOR_M + NOISE_PER_M * depth)
    slope, weight = _slope(depth, sigma, lens)
    return View(frame.pose, lens, depth, slope, weight, *_reduced(frame))


def _lens(intrinsics: np.ndarray) -> np.ndarray:
    return np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]], dtype=np.float64)


def _reduced(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Return the colour picture, averaged to the resolution of the depth to avoid aliasing in the voxels, and its lens."""
    if frame.colour is None or frame.colour_intrinsics is None:
        return np.zeros((0, 0, 3), np.uint8), np.ones(4)
    factor = max(round(float(frame.colour_intrinsics[0, 0] / frame.intrinsics[0, 0])), 1)
    height, width = (n // factor for n in frame.colour.shape[:2])
    small = _averaged(np.ascontiguousarray(frame.colour), factor)
    return small, _lens(rescaled(frame.colour_intrinsics, (width * factor, height * factor), (width, height)))


@compiled
def _averaged(picture, factor):
    """Return the picture (h, w, 3) uint8 of which each pixel is the mean of `factor` x `factor` pixels of `picture`."""
    height, width = picture.shape[0] // factor, picture.shape[1] // factor
    out = np.empty((height, width, 3), np.uint8)
    for v in range(height):
        for u in range(width):
            for c in range(3):
                total = 0
                for i in range(factor):
                    for j in range(factor):
                        total += picture[v * factor + i, u * factor + j, c]
                out[v, u, c] = (2 * total + factor * factor) // (2 * factor * factor)
    return out


@compiled
def _slope(depth, sigma, lens):
    """Return slope |n . r| (normal n, pixel ray r of depth component 1) and weight (h, w); 0 without depth or a surface around a pixel."""
    height, width = depth.shape
    fx, fy, cx, cy = lens
    slope, weight = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    for v in range(height):
        for u in range(width):
            d = depth[v, u]
            if d <= 0:
                continue
            # The difference is one-sided at borders and beside pixels without depth.
            u0, u1, v0, v1 = max(u - STEP, 0), min(u + STEP, width - 1), max(v - STEP, 0), min(v + STEP, height - 1)
            u0, u1 = (u0 if depth[v, u0] > 0 else u), (u1 if depth[v, u1] > 0 else u)
            v0, v1 = (v0 if depth[v0, u] > 0 else v), (v1 if depth[v1, u] > 0 else v)
            if u0 == u1 or v0 == v1:
                continue
            x, y = (u - cx) / fx, (v - cy) / fy
            zx, zy = (depth[v, u1] - depth[v, u0]) / (u1 - u0), (depth[v1, u] - depth[v0, u]) / (v1 - v0)
            # The two tangents of the surface z(u, v) are (z/fx + x zx, y zx, zx) and (x zy, z/fy + y zy, zy).
            ax, ay, az = d / fx + x * zx, y * zx, zx
            bx, by, bz = x * zy, d / fy + y * zy, zy
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            along = abs(nx * x + ny * y + nz) / np.sqrt(nx * nx + ny * ny + nz * nz)
            cosine = along / np.sqrt(x * x + y * y + 1)
            if cosine < MIN_COSINE:
                continue
            relative = sigma[v, u] / REFERENCE_NOISE_M
            slope[v, u] = along
            weight[v, u] = cosine / (relative * relative)
    return slope, weight
