"""Light in a room: lamps under the ceiling with shadows, ambient light, reflections of the room, and the sky outside.

The light is plausible, not measured. Its pictures only need to be readable by a person or by a model that names materials. Shadows are
depth cubes around each lamp. Reflections come from one colour cube around the centre of the room, without parallax.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost
from radartwin.testbed.scanner.look import LEVELS, Look, to_linear
from radartwin.testbed.scanner.raster import nearest_faces

SHADOW_PIXELS, MIRROR_PIXELS = 256, 128
LAMP_SPACING_M, LAMP_DROP_M = 3.0, 0.6  # grid of lamps; distance below the ceiling, so that lamps hang below luminaires
AMBIENT = 0.45  # share of ambient light
BLUR = 4  # brushed metal reflects the room at MIRROR_PIXELS / BLUR
BRIGHT = 0.55  # linear level of the upper quartile of the room's brightness in a picture
LINEAR = to_linear(np.arange(256)).astype(np.float32)  # of sRGB values
# Right, down and forward axes of the six cameras of a cube.
CUBE = np.array(
    [
        [[0, -1, 0], [0, 0, -1], [1, 0, 0]],
        [[0, 1, 0], [0, 0, -1], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[-1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ],
    dtype=np.float64,
)


class Light(NamedTuple):
    """The light of a scene.

    Attributes:
        lamps: (L, 3) positions.
        shadows: (L, 6, S, S) float32 depth around each lamp.
        extremes: (L, 6, S, S, 2) float32 smallest and largest of the nine depths that decide the shadow of a point in that pixel.
        room: (6, M, M, 3) float32 linear colour around the centre; blurred: the same at a lower resolution.
        exposure: factor from linear light to the picture.
    """

    lamps: np.ndarray
    shadows: np.ndarray
    extremes: np.ndarray
    room: np.ndarray
    blurred: np.ndarray
    exposure: float


class _Row(NamedTuple):
    """Buffers of the compiled functions: points, normals and rays (W, 3) and light (W,) of a row; colours (3,) of a pixel."""

    point: np.ndarray
    normal: np.ndarray
    ray: np.ndarray
    light: np.ndarray
    colour: np.ndarray
    reflected: np.ndarray


def light_of(look: Look) -> Light:
    """Lamps, shadows and reflections of a scene, with the exposure for its centre."""
    corners = look.triangles.reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    lamps = _lamps(low, high)
    shadows = np.stack([_depths(look, lamp) for lamp in lamps])
    dark = np.zeros((6, 1, 1, 3), np.float32)
    light = Light(lamps, shadows, _extremes(shadows), dark, dark, 1.0)
    centre = np.append((low + high)[:2] / 2, low[2] + min(1.6, 0.5 * (high - low)[2]))
    room = np.empty((6, MIRROR_PIXELS, MIRROR_PIXELS, 3), np.float32)
    for side, (pose, intrinsics) in enumerate(_cube_cameras(centre, MIRROR_PIXELS)):
        face, depth = nearest_faces(look.triangles, look.solid, pose, intrinsics, (MIRROR_PIXELS, MIRROR_PIXELS), near_m=0.1)
        room[side] = shaded(look, light, face, depth, pose, intrinsics)
    n = MIRROR_PIXELS // BLUR
    blurred = room.reshape(6, n, BLUR, n, BLUR, 3).mean(axis=(2, 4))
    brightness = room[:5].mean(axis=-1)  # without the floor, which phones see least
    return light._replace(room=room, blurred=blurred, exposure=BRIGHT / max(float(np.quantile(brightness, 0.75)), 1e-6))


def shaded(look: Look, light: Light, face: np.ndarray, depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Linear colour (h, w, 3) float32 of faces (h, w) at depths (h, w); the sky where face is -1."""
    out = np.empty((*face.shape, 3), np.float32)
    width = face.shape[1]
    point, normal, ray = np.ones((3, width, 3))
    row = _Row(point, normal, ray, np.empty(width), np.empty(3), np.empty(3))
    _shade(face, depth, np.ascontiguousarray(pose), _lens(intrinsics), look, light, row, out)
    return out


def through_glass(
    look: Look, light: Light, behind: np.ndarray, face: np.ndarray, depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray
) -> None:
    """Add panes (h, w), -1 for none, to the picture `behind` in place: a faint green and a reflection of the room."""
    _glaze(face, depth, np.ascontiguousarray(pose), _lens(intrinsics), look.normals, light.room, behind)


def _lens(intrinsics: np.ndarray) -> np.ndarray:
    return np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]])


def _lamps(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    counts = np.maximum(np.round((high - low)[:2] / LAMP_SPACING_M).astype(int), 1)
    x, y = (low[i] + (high - low)[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in range(2))
    height = low[2] + max((high - low)[2] - LAMP_DROP_M, 0.5 * (high - low)[2])
    return np.array([[a, b, height] for a in x for b in y])


def _cube_cameras(position: np.ndarray, pixels: int):
    """Pose and intrinsics of the six cameras of a cube."""
    intrinsics = np.array([[pixels / 2, 0, pixels / 2 - 0.5], [0, pixels / 2, pixels / 2 - 0.5], [0, 0, 1]])
    for axes in CUBE:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes.T, position
        yield pose, intrinsics


def _depths(look: Look, position: np.ndarray) -> np.ndarray:
    """Depth cube (6, S, S) around a lamp."""
    size = (SHADOW_PIXELS, SHADOW_PIXELS)
    cameras = _cube_cameras(position, SHADOW_PIXELS)
    return np.stack([nearest_faces(look.triangles, look.solid, pose, intrinsics, size, near_m=0.3)[1] for pose, intrinsics in cameras])


def _extremes(shadows: np.ndarray) -> np.ndarray:
    """Smallest and largest depth (..., 2) of each pixel and the eight to its right and below; border pixels repeat."""
    out = np.empty((*shadows.shape, 2), np.float32)
    for k, extreme in enumerate((np.minimum, np.maximum)):
        rows = shadows.copy()
        for step in (1, 2):
            rows[..., :-step, :] = extreme(rows[..., :-step, :], shadows[..., step:, :])
        both = out[..., k]
        both[...] = rows
        for step in (1, 2):
            both[..., :-step] = extreme(both[..., :-step], rows[..., step:])
    return out


@innermost
def _side(x, y, z):
    """The side of CUBE in a direction, the two coordinates on it (-1..1), and the distance along its axis."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        return (0, -y / ax, -z / ax, ax) if x > 0 else (1, y / ax, -z / ax, ax)
    if ay >= az:
        return (2, x / ay, -z / ay, ay) if y > 0 else (3, -x / ay, -z / ay, ay)
    return (4, x / az, y / az, az) if z > 0 else (5, x / az, -y / az, az)


@innermost
def _sky(z, channel):
    """Linear colour of the sky or the ground in a direction with vertical part z."""
    if z > 0:
        low, high = (1.5, 1.6, 1.75), (0.75, 1.1, 1.8)
        return low[channel] + (high[channel] - low[channel]) * min(1.5 * z, 1.0)
    return (0.42, 0.44, 0.4)[channel]


@innermost
def _around(room, x, y, z, colour):
    """Write the room's colour in a direction, bilinear within a side, to `colour` (3,)."""
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
    """Share of a lamp's light at an offset from the lamp, from nine samples of its depth cube."""
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
    """Write the light on a row of points; lamp by lamp, because neighbouring points read the same part of a depth cube."""
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
    """Write the linear colour of face f at a point to `colour` (3,); a pixel covers `spread` metres there."""
    to_uv, pool, levels = look.to_uv, look.pool, look.levels
    t = look.texture[f]
    if t < 0:
        for c in range(3):
            colour[c] = look.tint[f, c]
        return
    # The texture level with about the pixel's size on the surface; bilinear, repeated.
    a = to_uv[f, 0, 0] * x + to_uv[f, 0, 1] * y + to_uv[f, 0, 2] * z + to_uv[f, 0, 3]
    b = to_uv[f, 1, 0] * x + to_uv[f, 1, 1] * y + to_uv[f, 1, 2] * z + to_uv[f, 1, 3]
    density = np.sqrt(to_uv[f, 0, 0] ** 2 + to_uv[f, 0, 1] ** 2 + to_uv[f, 0, 2] ** 2)
    n = min(max(int(np.floor(np.log2(max(density * spread, 1e-3)) + 0.5)), 0), LEVELS - 1)
    offset, w, h = levels[t, n, 0], levels[t, n, 1], levels[t, n, 2]
    scale_u, scale_v = w / levels[t, 0, 1], h / levels[t, 0, 2]
    a, b = (a + 0.5) * scale_u - 0.5, (b + 0.5) * scale_v - 0.5
    i0, j0 = int(np.floor(b)), int(np.floor(a))
    p, q = a - j0, b - i0
    i1, j1 = (i0 + 1) % h, (j0 + 1) % w
    i0, j0 = i0 % h, j0 % w
    for c in range(3):
        top = (1 - p) * LINEAR[pool[offset + i0 * w + j0, c]] + p * LINEAR[pool[offset + i0 * w + j1, c]]
        low = (1 - p) * LINEAR[pool[offset + i1 * w + j0, c]] + p * LINEAR[pool[offset + i1 * w + j1, c]]
        colour[c] = (1 - q) * top + q * low


@innermost
def _shade(face, depth, pose, lens, look, light, row, out):
    """Write the colour of each pixel, row by row."""
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
    """Write the points, unit rays, and normals towards the camera of picture row v."""
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
def _glaze(face, depth, pose, lens, normals, room, out):
    """Tint the pixels of `out` with a pane in front, and add the pane's reflection."""
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
            gloss = 0.08 + 0.92 * (1 - abs(cosine)) ** 5  # both faces of the pane
            sx, sy, sz = dx - 2 * cosine * nx, dy - 2 * cosine * ny, dz - 2 * cosine * nz
            _around(room, sx, sy, sz, reflected)
            for c in range(3):
                out[v, u, c] = (1 - gloss) * clear[c] * out[v, u, c] + gloss * reflected[c]
