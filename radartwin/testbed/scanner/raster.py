"""Rasterise triangles for a pinhole camera with scan lines and a depth buffer: find the nearest face and its depth at every pixel."""

from __future__ import annotations

import numpy as np

from radartwin.compiled import compiled

NEAR_M = 0.05


def nearest_faces(
    triangles: np.ndarray,
    drawn: np.ndarray,
    pose: np.ndarray,
    intrinsics: np.ndarray,
    size: tuple[int, int],
    depth: np.ndarray | None = None,
    near_m: float = NEAR_M,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the face in the mask `drawn` that is nearest to the camera at every pixel.

    Args:
        triangles: (F, 3, 3) corners of the faces in world coordinates; faces are visible from both sides.
        drawn: (F,) bool mask of the faces to draw.
        pose: (4, 4) camera-to-world pose, OpenCV axes.
        intrinsics: (3, 3) camera intrinsics in pixels.
        size: (width, height) of the picture in pixels.
        depth: (h, w) largest depth in metres at each pixel; faces at larger depth are not drawn. None sets no limit.
        near_m: smallest depth in metres; parts of faces at smaller depth are cut off.
    Returns:
        Index of the nearest face, (h, w) int32; -1 at pixels without a face.
        Depth of the nearest face along the camera axis, (h, w) float32 in metres; infinite at pixels without a face.

    >>> wall = np.array([[[-9.0, -9, 2], [9, -9, 2], [0, 18, 2]]])
    >>> face, depth = nearest_faces(wall, np.ones(1, bool), np.eye(4), np.array([[8.0, 0, 4], [0, 8, 4], [0, 0, 1]]), (8, 8))
    >>> int(face.max()), float(depth[0, 0])
    (0, 2.0)
    """
    width, height = size
    face = np.full((height, width), -1, np.int32)
    depth = np.full((height, width), np.inf, np.float32) if depth is None else depth.astype(np.float32)
    rotation = pose[:3, :3].T
    seen = triangles @ rotation.T - rotation @ pose[:3, 3]
    lens = np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]])
    _draw(np.ascontiguousarray(seen), np.flatnonzero(drawn), lens, near_m, face, depth)
    depth[face < 0] = np.inf
    return face, depth


@compiled
def _draw(triangles, order, lens, near, face, depth):
    height, width = face.shape
    clipped = np.empty((4, 3))
    flat = np.empty((4, 3))
    for f in order:
        count = 0
        for i in range(3):  # cut the triangle at the near plane
            j = (i + 1) % 3
            zi, zj = triangles[f, i, 2], triangles[f, j, 2]
            if zi >= near:
                clipped[count] = triangles[f, i]
                count += 1
            if (zi >= near) != (zj >= near):
                t = (near - zi) / (zj - zi)
                for axis in range(3):
                    clipped[count, axis] = triangles[f, i, axis] + t * (triangles[f, j, axis] - triangles[f, i, axis])
                count += 1
        if count < 3:
            continue
        low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
        for i in range(count):
            inverse = 1 / clipped[i, 2]
            u, v = lens[0] * clipped[i, 0] * inverse + lens[2], lens[1] * clipped[i, 1] * inverse + lens[3]
            flat[i, 0], flat[i, 1], flat[i, 2] = u, v, inverse
            low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
        if high_u < 0 or high_v < 0 or low_u > width - 1 or low_v > height - 1:
            continue
        for k in range(1, count - 1):
            ax, ay, bx, by, cx, cy = flat[0, 0], flat[0, 1], flat[k, 0], flat[k, 1], flat[k + 1, 0], flat[k + 1, 1]
            area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
            if abs(area) < 1e-12:
                continue
            # The inverse of the depth changes linearly across the picture of a triangle.
            pu = ((flat[k, 2] - flat[0, 2]) * (cy - ay) - (flat[k + 1, 2] - flat[0, 2]) * (by - ay)) / area
            pv = ((flat[k + 1, 2] - flat[0, 2]) * (bx - ax) - (flat[k, 2] - flat[0, 2]) * (cx - ax)) / area
            p0 = flat[0, 2] - pu * ax - pv * ay
            top, bottom = max(int(np.ceil(min(ay, min(by, cy)))), 0), min(int(np.floor(max(ay, max(by, cy)))), height - 1)
            for v in range(top, bottom + 1):
                left, right = np.inf, -np.inf
                for e in range(3):  # find the intersections of the pixel row with the three edges
                    if e == 0:
                        x0, y0, x1, y1 = ax, ay, bx, by
                    elif e == 1:
                        x0, y0, x1, y1 = bx, by, cx, cy
                    else:
                        x0, y0, x1, y1 = cx, cy, ax, ay
                    if y0 == y1:
                        if y0 == v:
                            left, right = min(left, min(x0, x1)), max(right, max(x0, x1))
                    elif min(y0, y1) <= v <= max(y0, y1):
                        x = x0 + (v - y0) * (x1 - x0) / (y1 - y0)
                        left, right = min(left, x), max(right, x)
                if right < left:
                    continue
                first, last = max(int(np.ceil(left - 1e-6)), 0), min(int(np.floor(right + 1e-6)), width - 1)
                for u in range(first, last + 1):
                    inverse = p0 + pu * u + pv * v
                    if inverse > 0 and 1 / inverse < depth[v, u]:
                        depth[v, u] = 1 / inverse
                        face[v, u] = f
