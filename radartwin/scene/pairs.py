"""Compute winding numbers of points and crossings of line segments with triangles, in compiled loops."""

from __future__ import annotations

import math

import numpy as np

from radartwin.compiled import compiled


@compiled
def winding_number(triangles, points):
    """Compute the winding number (N,) of triangles (T, 3, 3) around points (N, 3): 1 inside a solid with outward normals, 0 outside.

    The winding number is the sum of the triangles' solid angles (van Oosterom and Strackee 1983) divided by 4 pi.
    """
    out = np.zeros(len(points))
    for n in range(len(points)):
        total = 0.0
        for t in range(len(triangles)):
            ax, ay, az = triangles[t, 0, 0] - points[n, 0], triangles[t, 0, 1] - points[n, 1], triangles[t, 0, 2] - points[n, 2]
            bx, by, bz = triangles[t, 1, 0] - points[n, 0], triangles[t, 1, 1] - points[n, 1], triangles[t, 1, 2] - points[n, 2]
            cx, cy, cz = triangles[t, 2, 0] - points[n, 0], triangles[t, 2, 1] - points[n, 1], triangles[t, 2, 2] - points[n, 2]
            la = math.sqrt(ax * ax + ay * ay + az * az)
            lb = math.sqrt(bx * bx + by * by + bz * bz)
            lc = math.sqrt(cx * cx + cy * cy + cz * cz)
            volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
            total += math.atan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        out[n] = total / (2 * math.pi)
    return out


@compiled
def crossing(starts, ends, triangles, segment, share):
    """Find the crossings of line segments, from `starts` (S, 3) to `ends` (S, 3), with triangles (T, 3, 3). Moeller and Trumbore 1997.

    For each crossing, the function writes the index of the line segment into `segment` (N,) and the position of the crossing, as a fraction
    of the segment's length, into `share` (N,). Crossings are sorted by the index of the line segment. The function writes at most N
    crossings and returns the number of all crossings.
    """
    count = 0
    for s in range(len(starts)):
        ox, oy, oz = starts[s]
        dx, dy, dz = ends[s, 0] - ox, ends[s, 1] - oy, ends[s, 2] - oz
        for t in range(len(triangles)):
            apart = False
            for k in range(3):
                a, b, c = triangles[t, 0, k], triangles[t, 1, k], triangles[t, 2, k]
                if min(starts[s, k], ends[s, k]) > max(a, b, c) or max(starts[s, k], ends[s, k]) < min(a, b, c):
                    apart = True
                    break
            if apart:
                continue
            x, y, z = triangles[t, 0]
            e1x, e1y, e1z = triangles[t, 1, 0] - x, triangles[t, 1, 1] - y, triangles[t, 1, 2] - z
            e2x, e2y, e2z = triangles[t, 2, 0] - x, triangles[t, 2, 1] - y, triangles[t, 2, 2] - z
            px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
            determinant = e1x * px + e1y * py + e1z * pz
            if abs(determinant) < 1e-15:
                continue
            tx, ty, tz = ox - x, oy - y, oz - z
            u = (tx * px + ty * py + tz * pz) / determinant
            qx, qy, qz = ty * e1z - tz * e1y, tz * e1x - tx * e1z, tx * e1y - ty * e1x
            v = (dx * qx + dy * qy + dz * qz) / determinant
            at = (e2x * qx + e2y * qy + e2z * qz) / determinant
            if u >= 0 and v >= 0 and u + v <= 1 and 0 <= at <= 1:
                if count < len(segment):
                    segment[count] = s
                    share[count] = at
                count += 1
    return count
