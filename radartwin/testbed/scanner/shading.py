"""Compiled functions that compute the colour of each picture pixel from faces, light and textures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost, vectorised
from radartwin.testbed.scanner.look import LEVELS, to_linear

AMBIENT = 0.45  # fraction of the light in the room that is ambient
SQRT_2 = np.sqrt(2.0)
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


class Run(NamedTuple):
    """Buffers of the compiled functions for a run of pixels in a row that show the same face, and for one pixel.

    Attributes:
        light: (W,) light on the face. spread: (W,) size of the pixel on the face in metres. cosine: (W,) cosine of ray and normal.
        bright, last, place: (W,) results of `_beam` for one lamp.
        colour: (W, 3) linear colour of the face without light.
        ray, normal, reflected: (3,) ray, normal of the face, and reflection of one pixel.
    """

    light: np.ndarray
    spread: np.ndarray
    cosine: np.ndarray
    bright: np.ndarray
    last: np.ndarray
    place: np.ndarray
    colour: np.ndarray
    ray: np.ndarray
    normal: np.ndarray
    reflected: np.ndarray

    @classmethod
    def of(cls, width: int) -> Run:
        light, spread, cosine, bright, last = np.empty((5, width))
        ray, normal, reflected = np.empty((3, 3))
        return cls(light, spread, cosine, bright, last, np.empty(width, np.int32), np.empty((width, 3)), ray, normal, reflected)


@innermost
def _side(x, y, z):
    """Return the cube-map side in direction (x, y, z), the coordinates on it (-1 to 1), and the distance along the side's axis."""
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
def _lit(shadows, lamp, place, last):
    """Return the fraction of a lamp's light that reaches a point, from nine depths of the lamp's cube map."""
    n, lit = shadows.shape[2], 0
    side, i0, j0 = place // (n * n), place // n % n, place % n
    for di in range(3):
        for dj in range(3):
            lit += shadows[lamp, side, min(i0 + di, n - 1), min(j0 + dj, n - 1)] > last
    return lit / 9


@vectorised
def _view(depth, start, v, pose, lens, normal, spread, cosine):
    """Write the size in metres of each pixel on the face to `spread` (W,), and the cosine of ray and normal to `cosine` (W,)."""
    p00, p10, p20, p02, p12, p22 = pose[0, 0], pose[1, 0], pose[2, 0], pose[0, 2], pose[1, 2], pose[2, 2]
    ry = (v - lens[3]) / lens[1]
    b0, b1, b2 = pose[0, 1] * ry, pose[1, 1] * ry, pose[2, 1] * ry
    nx, ny, nz, lens0, lens2 = normal[0], normal[1], normal[2], lens[0], lens[2]
    for i in range(depth.shape[0]):
        rx = (start + i - lens2) / lens0
        x, y, z = p00 * rx + b0 + p02, p10 * rx + b1 + p12, p20 * rx + b2 + p22
        length = np.sqrt(x * x + y * y + z * z)
        along = nx * (x / length) + ny * (y / length) + nz * (z / length)
        cosine[i] = along
        spread[i] = depth[i] / lens0 / np.sqrt(max(-along, 0.05))


@vectorised
def _beam(depth, start, v, pose, lens, normal, lamp, n, bright, last, place):
    """Compute a lamp's light on a run of pixels without shadow, and find the pixels of the lamp's cube map that decide the shadow."""
    p00, p10, p20, p02, p12, p22 = pose[0, 0], pose[1, 0], pose[2, 0], pose[0, 2], pose[1, 2], pose[2, 2]
    p03, p13, p23, c0, c1, c2 = pose[0, 3], pose[1, 3], pose[2, 3], lamp[0], lamp[1], lamp[2]
    ry = (v - lens[3]) / lens[1]
    b0, b1, b2 = pose[0, 1] * ry, pose[1, 1] * ry, pose[2, 1] * ry
    nx, ny, nz, lens0, lens2, end = normal[0], normal[1], normal[2], lens[0], lens[2], n - 1.0
    for i in range(depth.shape[0]):
        rx, d = (start + i - lens2) / lens0, depth[i]
        lx = c0 - (p03 + d * (p00 * rx + b0 + p02))
        ly = c1 - (p13 + d * (p10 * rx + b1 + p12))
        lz = c2 - (p23 + d * (p20 * rx + b2 + p22))
        square = lx * lx + ly * ly + lz * lz
        facing = (nx * lx + ny * ly + nz * lz) / np.sqrt(square)
        bright[i] = 2.2 * facing / (square + 0.5) if facing > 0 else 0.0
        # The position of the point as seen from the lamp, on the cube-map side that `_side` returns. The code uses selections instead of
        # branches so that the compiler can compute several pixels at a time.
        x, y, z = -lx + 0.01 * nx, -ly + 0.01 * ny, -lz + 0.01 * nz
        ax, ay, az = abs(x), abs(y), abs(z)
        on_x, on_y = (ax >= ay) & (ax >= az), ay >= az
        forward = ax if on_x else ay if on_y else az
        across = (-y if x > 0 else y) if on_x else (x if y > 0 else -x) if on_y else x
        down = -z if on_x | on_y else y if z > 0 else -y
        side = (0 if x > 0 else 1) if on_x else (2 if y > 0 else 3) if on_y else 4 if z > 0 else 5
        a, b = (across / forward + 1) * n / 2 - 1, (down / forward + 1) * n / 2 - 1
        a, b = a if a > 0 else 0.0, b if b > 0 else 0.0
        a, b = a if a < end else end, b if b < end else end
        last[i] = forward - 0.02 - 0.02 * forward
        place[i] = (np.int32(side) * n + np.int32(b)) * n + np.int32(a)


@innermost
def _illuminate(depth, start, v, pose, lens, normal, light, run):
    """Write the light on a run of pixels that show one face to `run.light`. The other arguments are those of `_view`."""
    count, n = depth.shape[0], light.shadows.shape[2]
    total, bright, last, place = run.light[:count], run.bright[:count], run.last[:count], run.place[:count]
    extremes = light.extremes.reshape(len(light.lamps), 6 * n * n, 2)
    total[:] = AMBIENT * (0.8 + 0.2 * normal[2])
    for k in range(len(light.lamps)):
        _beam(depth, start, v, pose, lens, normal, light.lamps[k], n, bright, last, place)
        for i in range(count):
            if bright[i] > 0 and extremes[k, place[i], 1] > last[i]:
                all_lit = extremes[k, place[i], 0] > last[i]
                total[i] += bright[i] if all_lit else bright[i] * _lit(light.shadows, k, place[i], last[i])


@innermost
def _wrapped(value, size):
    """Return the integer `value` modulo `size`. A multiplication is faster than the division of integers."""
    rest = value - int(np.floor(value * (1.0 / size))) * size
    return rest + size if rest < 0 else rest - size if rest >= size else rest


@vectorised
def _paint(f, depth, start, v, pose, lens, look, spread, out):
    """Write the linear colour of face f, without light, to `out` (W, 3). The other arguments are those of `_view`."""
    pool, levels, t, to_uv = look.pool, look.levels, look.texture[f], look.to_uv[f]
    if t < 0:
        for i in range(depth.shape[0]):
            for c in range(3):
                out[i, c] = look.tint[f, c]
        return
    p00, p10, p20, p02, p12, p22 = pose[0, 0], pose[1, 0], pose[2, 0], pose[0, 2], pose[1, 2], pose[2, 2]
    ry = (v - lens[3]) / lens[1]
    b0, b1, b2 = pose[0, 1] * ry, pose[1, 1] * ry, pose[2, 1] * ry
    a0, a1, a2, a3 = to_uv[0, 0], to_uv[0, 1], to_uv[0, 2], to_uv[0, 3]
    c0, c1, c2, c3 = to_uv[1, 0], to_uv[1, 1], to_uv[1, 2], to_uv[1, 3]
    p03, p13, p23, lens0, lens2 = pose[0, 3], pose[1, 3], pose[2, 3], lens[0], lens[2]
    density = np.sqrt(a0**2 + a1**2 + a2**2)
    level = -1
    offset, w, h, scale_u, scale_v = 0, 0, 0, 0.0, 0.0
    for i in range(depth.shape[0]):
        rx, d = (start + i - lens2) / lens0, depth[i]
        x, y, z = p03 + d * (p00 * rx + b0 + p02), p13 + d * (p10 * rx + b1 + p12), p23 + d * (p20 * rx + b2 + p22)
        # Read the texture level whose texels have about the pixel's size on the surface. Colours are interpolated, and the texture repeats.
        n, limit = 0, SQRT_2
        while n < LEVELS - 1 and density * spread[i] >= limit:
            n, limit = n + 1, 2 * limit
        if n != level:
            level, offset, w, h = n, levels[t, n, 0], levels[t, n, 1], levels[t, n, 2]
            scale_u, scale_v = w / levels[t, 0, 1], h / levels[t, 0, 2]
        a, b = (a0 * x + a1 * y + a2 * z + a3 + 0.5) * scale_u - 0.5, (c0 * x + c1 * y + c2 * z + c3 + 0.5) * scale_v - 0.5
        i0, j0 = int(np.floor(b)), int(np.floor(a))
        p, q = a - j0, b - i0
        i0, j0 = _wrapped(i0, h), _wrapped(j0, w)
        i1, j1 = i0 + 1 if i0 + 1 < h else 0, j0 + 1 if j0 + 1 < w else 0
        i0, i1 = offset + i0 * w, offset + i1 * w
        for c in range(3):
            top = (1 - p) * LINEAR[pool[i0 + j0, c]] + p * LINEAR[pool[i0 + j1, c]]
            low = (1 - p) * LINEAR[pool[i1 + j0, c]] + p * LINEAR[pool[i1 + j1, c]]
            out[i, c] = (1 - q) * top + q * low


@compiled
def shade(face, depth, pose, lens, look, light, run, out):
    """Write the linear colour of each pixel to the picture `out` (h, w, 3), by runs of pixels in a row that show the same face."""
    height, width = face.shape
    for v in range(height):
        start = 0
        while start < width:
            f, end = face[v, start], start + 1
            while end < width and face[v, end] == f:
                end += 1
            if f >= 0:
                _shade_run(f, v, start, depth[v, start:end], pose, lens, look, light, run, out[v, start:end])
            else:
                for u in range(start, end):
                    _ray(v, u, pose, lens, run.ray)
                    for c in range(3):
                        out[v, u, c] = _sky(run.ray[2], c)
            start = end


@innermost
def _ray(v, u, pose, lens, ray):
    """Write the unit vector from the camera through pixel (v, u) to `ray` (3,)."""
    rx, ry, length = (u - lens[2]) / lens[0], (v - lens[3]) / lens[1], 0.0
    for i in range(3):
        ray[i] = pose[i, 0] * rx + pose[i, 1] * ry + pose[i, 2]
        length += ray[i] * ray[i]
    length = np.sqrt(length)
    for i in range(3):
        ray[i] /= length


@innermost
def _shade_run(f, v, start, depth, pose, lens, look, light, run, out):
    """Write the linear colour of a run of pixels that show face f to `out` (W, 3). The other arguments are those of `_view`."""
    ray, normal, count = run.ray, run.normal, depth.shape[0]
    _ray(v, start, pose, lens, ray)
    sign = -1.0 if look.normals[f, 0] * ray[0] + look.normals[f, 1] * ray[1] + look.normals[f, 2] * ray[2] > 0 else 1.0
    for i in range(3):
        normal[i] = sign * look.normals[f, i]  # towards the camera
    _view(depth, start, v, pose, lens, normal, run.spread[:count], run.cosine[:count])
    _illuminate(depth, start, v, pose, lens, normal, light, run)
    sheen, metal = look.sheen[f], look.metal[f]
    _paint(f, depth, start, v, pose, lens, look, run.spread, run.colour)
    for i in range(count):
        colour = run.colour[i]
        if sheen <= 0:
            for c in range(3):
                out[i, c] = run.light[i] * colour[c]
            continue
        cosine = run.cosine[i]
        gloss = sheen + (1 - sheen) * (1 + cosine) ** 5 * (1.0 if metal else 0.5)
        _ray(v, start + i, pose, lens, ray)
        sx, sy, sz = ray[0] - 2 * cosine * normal[0], ray[1] - 2 * cosine * normal[1], ray[2] - 2 * cosine * normal[2]
        if metal:
            _around(light.blurred, sx, sy, sz, run.reflected)
        else:
            _around(light.room, sx, sy, sz, run.reflected)
        for c in range(3):
            if metal:
                out[i, c] = (1 - sheen) * run.light[i] * colour[c] + gloss * run.reflected[c] * (0.3 + 0.7 * colour[c])
            else:
                out[i, c] = (1 - gloss) * run.light[i] * colour[c] + gloss * run.reflected[c]


@compiled
def glaze(face, pose, lens, normals, room, out):
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
