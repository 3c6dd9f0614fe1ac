"""Compiled functions that compute the colour of each picture pixel from faces, light and textures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost
from radartwin.testbed.scanner.look import LEVELS, to_linear

AMBIENT = 0.45  # fraction of the light in the room that is ambient
LINEAR = to_linear(np.arange(256)).astype(np.float32)  # linear light (0 to 1) of each sRGB value from 0 to 255


class Light(NamedTuple):
    """The light of a scene.

    Attributes:
        lamps: (L, 3) positions of the L lamps.
        shadows: (L, 6, S, S) float32 depth cube map around each lamp, in metres.
        extremes: (L, 6, S, S, 2) float32 smallest and largest of the nine depths that decide the shadow of a point in each pixel.
        room: (6, M, M, 3) float32 linear colour cube map around the room's centre.
        blurred: the colour cube map `room` at a lower resolution.
        exposure: factor from linear light to the linear values of the picture.
    """

    lamps: np.ndarray
    shadows: np.ndarray
    extremes: np.ndarray
    room: np.ndarray
    blurred: np.ndarray
    exposure: float


class Row(NamedTuple):
    """Buffers of the compiled functions: points, normals and rays (W, 3) and light (W,) of a pixel row; colours (3,) of one pixel."""

    point: np.ndarray
    normal: np.ndarray
    ray: np.ndarray
    light: np.ndarray
    colour: np.ndarray
    reflected: np.ndarray


@innermost
def _side(x, y, z):
    """Return the cube-map side in direction (x, y, z), the two coordinates on this side (-1 to 1), and the distance along the side's
    axis.
    """
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        return (0, -y / ax, -z / ax, ax) if x > 0 else (1, y / ax, -z / ax, ax)
    if ay >= az:
        return (2, x / ay, -z / ay, ay) if y > 0 else (3, -x / ay, -z / ay, ay)
    return (4, x / az, y / az, az) if z > 0 else (5, x / az, -y / az, az)


@innermost
def _sky(z, channel):
    """Return one channel of the linear colour of the sky, or of the ground, in a direction with vertical component z."""
    if z > 0:
        low, high = (1.5, 1.6, 1.75), (0.75, 1.1, 1.8)
        return low[channel] + (high[channel] - low[channel]) * min(1.5 * z, 1.0)
    return (0.42, 0.44, 0.4)[channel]


@innermost
def _around(room, x, y, z, colour):
    """Write the linear colour of the room in direction (x, y, z) to `colour` (3,), interpolated bilinearly within a cube-map side."""
    n = room.shape[1]
    side, u, v, _ = _side(x, y, z)
    a, b = min(max((u + 1) * n / 2 - 0.5, 0.0), n - 1.001), min(max((v + 1) * n / 2 - 0.5, 0.0), n - 1.001)
    if n == 1:
        for c in range(3):
            colour[c] = room[side, 0, 0, c]
        return
    i, j = int(b), int(a)
    p, q = a - j, b - i
    for c in range(3):
        top = (1 - p) * room[side, i, j, c] + p * room[side, i, j + 1, c]
        colour[c] = (1 - q) * top + q * ((1 - p) * room[side, i + 1, j, c] + p * room[side, i + 1, j + 1, c])


@innermost
def _lit(shadows, extremes, lamp, x, y, z):
    """Return the fraction of a lamp's light that reaches a point at offset (x, y, z) from the lamp, from nine depths of its cube map."""
    side, u, v, forward = _side(x, y, z)
    n = shadows.shape[2]
    a, b = (u + 1) * n / 2 - 1, (v + 1) * n / 2 - 1
    last = forward - 0.02 - 0.02 * forward
    i0, j0 = min(max(int(b), 0), n - 1), min(max(int(a), 0), n - 1)
    lit = 9 * (extremes[lamp, side, i0, j0, 0] > last)
    if lit == 0 and extremes[lamp, side, i0, j0, 1] > last:
        for di in range(3):
            for dj in range(3):
                lit += shadows[lamp, side, min(i0 + di, n - 1), min(j0 + dj, n - 1)] > last
    return lit / 9


@innermost
def _illuminate(width, row, light):
    """Write the light on a row of points.

    The loop over lamps is outermost, so that neighbouring points read the same part of a cube map.
    """
    for u in range(width):
        row.light[u] = AMBIENT * (0.8 + 0.2 * row.normal[u, 2])
    for k in range(len(light.lamps)):
        for u in range(width):
            nx, ny, nz = row.normal[u, 0], row.normal[u, 1], row.normal[u, 2]
            lx, ly, lz = light.lamps[k, 0] - row.point[u, 0], light.lamps[k, 1] - row.point[u, 1], light.lamps[k, 2] - row.point[u, 2]
            square = lx * lx + ly * ly + lz * lz
            facing = (nx * lx + ny * ly + nz * lz) / np.sqrt(square)
            if facing > 0:
                lit = _lit(light.shadows, light.extremes, k, -lx + 0.01 * nx, -ly + 0.01 * ny, -lz + 0.01 * nz)
                row.light[u] += 2.2 * facing / (square + 0.5) * lit


@innermost
def _paint(f, x, y, z, spread, look, colour):
    """Write the linear colour of face f at point (x, y, z) to `colour` (3,). A pixel covers `spread` metres on the face at this point."""
    to_uv, pool, levels = look.to_uv, look.pool, look.levels
    t = look.texture[f]
    if t < 0:
        for c in range(3):
            colour[c] = look.tint[f, c]
        return
    # Read the texture level whose texels have about the pixel's size on the surface. Colours are interpolated, and the texture repeats.
    a = to_uv[f, 0, 0] * x + to_uv[f, 0, 1] * y + to_uv[f, 0, 2] * z + to_uv[f, 0, 3]
    b = to_uv[f, 1, 0] * x + to_uv[f, 1, 1] * y + to_uv[f, 1, 2] * z + to_uv[f, 1, 3]
    density = np.sqrt(to_uv[f, 0, 0] ** 2 + to_uv[f, 0, 1] ** 2 + to_uv[f, 0, 2] ** 2)
    n = min(max(int(np.floor(np.log2(max(density * spread, 1e-3)) + 0.5)), 0), LEVELS - 1)
    offset, w, h = levels[t, n, 0], levels[t, n, 1], levels[t, n, 2]
    scale_u, scale_v = w / levels[t, 0, 1], h / levels[t, 0, 2]
    a, b = (a + 0.5) * scale_u - 0.5, (b + 0.5) * scale_v - 0.5
    i0, j0 = int(np.floor(b)), int(np.floor(a))
    p, q = a - j0, b - i0
    i0, j0 = i0 % h, j0 % w
    i1, j1 = i0 + 1 if i0 + 1 < h else 0, j0 + 1 if j0 + 1 < w else 0
    for c in range(3):
        top = (1 - p) * LINEAR[pool[offset + i0 * w + j0, c]] + p * LINEAR[pool[offset + i0 * w + j1, c]]
        low = (1 - p) * LINEAR[pool[offset + i1 * w + j0, c]] + p * LINEAR[pool[offset + i1 * w + j1, c]]
        colour[c] = (1 - q) * top + q * low


@innermost
def shade(face, depth, pose, lens, look, light, row, out):
    """Write the linear colour of each pixel to the picture `out` (h, w, 3), row by row."""
    height, width = face.shape
    for v in range(height):
        _place_row(v, face, depth, pose, lens, look.normals, row)
        _illuminate(width, row, light)
        for u in range(width):
            f = face[v, u]
            if f < 0:
                for c in range(3):
                    out[v, u, c] = _sky(row.ray[u, 2], c)
                continue
            cosine = row.normal[u, 0] * row.ray[u, 0] + row.normal[u, 1] * row.ray[u, 1] + row.normal[u, 2] * row.ray[u, 2]
            spread = depth[v, u] / lens[0] / np.sqrt(max(-cosine, 0.05))
            _paint(f, row.point[u, 0], row.point[u, 1], row.point[u, 2], spread, look, row.colour)
            sheen, metal = look.sheen[f], look.metal[f]
            if sheen <= 0:
                for c in range(3):
                    out[v, u, c] = row.light[u] * row.colour[c]
                continue
            gloss = sheen + (1 - sheen) * (1 + cosine) ** 5 * (1.0 if metal else 0.5)
            sx = row.ray[u, 0] - 2 * cosine * row.normal[u, 0]
            sy = row.ray[u, 1] - 2 * cosine * row.normal[u, 1]
            sz = row.ray[u, 2] - 2 * cosine * row.normal[u, 2]
            if metal:
                _around(light.blurred, sx, sy, sz, row.reflected)
            else:
                _around(light.room, sx, sy, sz, row.reflected)
            for c in range(3):
                if metal:
                    out[v, u, c] = (1 - sheen) * row.light[u] * row.colour[c] + gloss * row.reflected[c] * (0.3 + 0.7 * row.colour[c])
                else:
                    out[v, u, c] = (1 - gloss) * row.light[u] * row.colour[c] + gloss * row.reflected[c]


@innermost
def _place_row(v, face, depth, pose, lens, normals, row):
    """Write the points, the unit rays, and the normals towards the camera for picture row v to `row`."""
    for u in range(face.shape[1]):
        rx, ry = (u - lens[2]) / lens[0], (v - lens[3]) / lens[1]
        length, cosine, f = 0.0, 0.0, face[v, u]
        for i in range(3):
            row.ray[u, i] = pose[i, 0] * rx + pose[i, 1] * ry + pose[i, 2]
            length += row.ray[u, i] * row.ray[u, i]
            if f >= 0:
                row.point[u, i], row.normal[u, i] = pose[i, 3] + depth[v, u] * row.ray[u, i], normals[f, i]
        length = np.sqrt(length)
        for i in range(3):
            row.ray[u, i] /= length
            cosine += row.normal[u, i] * row.ray[u, i]
        if cosine > 0:
            for i in range(3):
                row.normal[u, i] = -row.normal[u, i]


@compiled
def glaze(face, depth, pose, lens, normals, room, out):
    """Tint the pixels of the picture `out` that have a glass pane in front, and add the reflection of the room in the pane."""
    clear, reflected = (0.84, 0.88, 0.86), np.empty(3)
    for v in range(face.shape[0]):
        for u in range(face.shape[1]):
            f = face[v, u]
            if f < 0:
                continue
            rx, ry = (u - lens[2]) / lens[0], (v - lens[3]) / lens[1]
            dx = pose[0, 0] * rx + pose[0, 1] * ry + pose[0, 2]
            dy = pose[1, 0] * rx + pose[1, 1] * ry + pose[1, 2]
            dz = pose[2, 0] * rx + pose[2, 1] * ry + pose[2, 2]
            length = np.sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = dx / length, dy / length, dz / length
            nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
            cosine = nx * dx + ny * dy + nz * dz
            gloss = 0.08 + 0.92 * (1 - abs(cosine)) ** 5  # reflectance of both faces of the pane together
            sx, sy, sz = dx - 2 * cosine * nx, dy - 2 * cosine * ny, dz - 2 * cosine * nz
            _around(room, sx, sy, sz, reflected)
            for c in range(3):
                out[v, u, c] = (1 - gloss) * clear[c] * out[v, u, c] + gloss * reflected[c]
