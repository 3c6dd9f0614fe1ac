"""Light in a room: lamps under the ceiling with shadows, light from everywhere, reflections of the room, sky outside.

Plausible, not measured: it serves pictures that a person, or a model that names materials, can read. Shadows are depth cubes around
each lamp, reflections one colour cube around the middle of the room, seen without parallax.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from radartwin.compiled import compiled, innermost
from radartwin.testbed.scanner.look import LEVELS, Look
from radartwin.testbed.scanner.raster import nearest_faces

SHADOW_PIXELS, MIRROR_PIXELS = 256, 128
LAMP_SPACING_M, LAMP_DROP_M = 3.0, 0.6  # a grid under the ceiling, low enough to hang under luminaires
AMBIENT = 0.45  # share of light that comes from everywhere
BLUR = 4  # brushed metal sees the room at MIRROR_PIXELS / BLUR
BRIGHT = 0.55  # linear level that the brightest tenth of a picture gets
# Right, down, forward of the six cameras of a cube.
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


@dataclasses.dataclass(frozen=True, eq=False)
class Light:
    """What lights a scene.

    Attributes:
        lamps: (L, 3) positions. shadows: (L, 6, S, S) float32 depth around each.
        extremes: (L, 6, S, S, 2) float32 least and largest of the nine depths that a point in that pixel is compared with.
        room: (6, M, M, 3) float32 linear colour around the middle; blurred: the same, coarser.
        exposure: factor from linear light to the picture.
    """

    lamps: np.ndarray
    shadows: np.ndarray
    extremes: np.ndarray
    room: np.ndarray
    blurred: np.ndarray
    exposure: float


def light_of(look: Look) -> Light:
    """Lamps, shadows and reflections of a scene; the middle of its extent takes the exposure."""
    corners = look.triangles.reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    lamps = _lamps(low, high)
    every = look.solid
    shadows = np.stack([_depths(look, every, lamp) for lamp in lamps])
    dark = np.zeros((6, 1, 1, 3), np.float32)
    extremes = _extremes(shadows)
    light = Light(lamps, shadows, extremes, dark, dark, 1.0)
    middle = np.append((low + high)[:2] / 2, low[2] + min(1.6, 0.5 * (high - low)[2]))
    room = np.empty((6, MIRROR_PIXELS, MIRROR_PIXELS, 3), np.float32)
    for side, (pose, lens) in enumerate(_cameras(middle, MIRROR_PIXELS)):
        face, depth = nearest_faces(look.triangles, every, pose, lens, (MIRROR_PIXELS, MIRROR_PIXELS), near_m=0.1)
        room[side] = shaded(look, light, face, depth, pose, lens)
    n = MIRROR_PIXELS // BLUR
    blurred = room.reshape(6, n, BLUR, n, BLUR, 3).mean(axis=(2, 4))
    brightness = room[:5].mean(axis=-1)  # without the floor, which phones see least
    return Light(lamps, shadows, extremes, room, blurred, BRIGHT / max(float(np.quantile(brightness, 0.75)), 1e-6))


def shaded(look: Look, light: Light, face: np.ndarray, depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Linear colour (h, w, 3) float32 of faces (h, w) at depths (h, w); the sky where there is none."""
    lens = np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]])
    out = np.empty((*face.shape, 3), np.float32)
    _shade(
        face, depth, np.ascontiguousarray(pose), lens, look.normals, look.metal, look.sheen, look.to_uv, look.texture, look.tint, look.pool,
        look.levels, light.lamps, light.shadows, light.extremes, light.room, light.blurred, _LINEAR, out, *np.ones((3, face.shape[1], 3)),
        np.empty(face.shape[1]), *np.empty((2, 3)),
    )  # fmt: skip
    return out


def through_glass(
    look: Look, light: Light, behind: np.ndarray, face: np.ndarray, depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray
) -> None:
    """Lay the panes (h, w), -1 for none, over what is behind them, in place: a faint green and a reflection of the room."""
    lens = np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]])
    _glaze(face, depth, np.ascontiguousarray(pose), lens, look.normals, light.room, behind)


def _lamps(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    counts = np.maximum(np.round((high - low)[:2] / LAMP_SPACING_M).astype(int), 1)
    x, y = (low[i] + (high - low)[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in range(2))
    height = low[2] + max((high - low)[2] - LAMP_DROP_M, 0.5 * (high - low)[2])
    return np.array([[a, b, height] for a in x for b in y])


def _cameras(position: np.ndarray, pixels: int):
    lens = np.array([[pixels / 2, 0, pixels / 2 - 0.5], [0, pixels / 2, pixels / 2 - 0.5], [0, 0, 1]])
    for axes in CUBE:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes.T, position
        yield pose, lens


def _depths(look: Look, drawn: np.ndarray, position: np.ndarray) -> np.ndarray:
    size = (SHADOW_PIXELS, SHADOW_PIXELS)
    return np.stack(
        [nearest_faces(look.triangles, drawn, pose, lens, size, near_m=0.3)[1] for pose, lens in _cameras(position, SHADOW_PIXELS)]
    )


def _extremes(shadows: np.ndarray) -> np.ndarray:
    """Least and largest depth (..., 2) of each pixel and the eight to its right and below; the last ones stand for what lies beyond."""
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


def _linear_table() -> np.ndarray:
    s = np.arange(256) / 255
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)


_LINEAR = _linear_table()


@innermost
def _side(x, y, z):
    """Side of CUBE a direction goes through, where, -1..1 each way, and how far ahead."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        return (0, -y / ax, -z / ax, ax) if x > 0 else (1, y / ax, -z / ax, ax)
    if ay >= az:
        return (2, x / ay, -z / ay, ay) if y > 0 else (3, -x / ay, -z / ay, ay)
    return (4, x / az, y / az, az) if z > 0 else (5, x / az, -y / az, az)


@innermost
def _sky(z, channel):
    if z > 0:
        low, high = (1.5, 1.6, 1.75), (0.75, 1.1, 1.8)
        return low[channel] + (high[channel] - low[channel]) * min(1.5 * z, 1.0)
    return (0.42, 0.44, 0.4)[channel]


@innermost
def _around(room, x, y, z, colour):
    """The room's colour in a direction, bilinear within a side, into `colour` (3,)."""
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
    """Share of light from a lamp at an offset from it: nine samples of its depth cube, which mostly agree."""
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
def _illuminate(width, where, normal, lamps, shadows, extremes, light):
    """Light on a row of points `where` (w, 3) with normals (w, 3), into `light` (w,); lamp by lamp, so that neighbours look alike."""
    for u in range(width):
        light[u] = AMBIENT * (0.8 + 0.2 * normal[u, 2])
    for k in range(len(lamps)):
        for u in range(width):
            nx, ny, nz = normal[u, 0], normal[u, 1], normal[u, 2]
            lx, ly, lz = lamps[k, 0] - where[u, 0], lamps[k, 1] - where[u, 1], lamps[k, 2] - where[u, 2]
            square = lx * lx + ly * ly + lz * lz
            facing = (nx * lx + ny * ly + nz * lz) / np.sqrt(square)
            if facing > 0:
                lit = _lit(shadows, extremes, k, -lx + 0.01 * nx, -ly + 0.01 * ny, -lz + 0.01 * nz)
                light[u] += 2.2 * facing / (square + 0.5) * lit


@innermost
def _paint(f, x, y, z, spread, texture, tint, to_uv, pool, levels, linear, colour):
    """A face's own linear colour at a point that a pixel covers `spread` metres of, into `colour` (3,)."""
    t = texture[f]
    if t < 0:
        for c in range(3):
            colour[c] = tint[f, c]
        return
    # The level whose pixels are as large as ours on the surface; bilinear, repeated.
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
        top = (1 - p) * linear[pool[offset + i0 * w + j0, c]] + p * linear[pool[offset + i0 * w + j1, c]]
        low = (1 - p) * linear[pool[offset + i1 * w + j0, c]] + p * linear[pool[offset + i1 * w + j1, c]]
        colour[c] = (1 - q) * top + q * low


@innermost
def _shade(
    face, depth, pose, lens, normals, metal, sheen, to_uv, texture, tint, pool, levels, lamps, shadows, extremes, room, blurred, linear,
    out, where, normal, way, light, colour, seen,
):  # fmt: skip
    """Rows one after the other; the last six are room to work in, for the points of a row and for one pixel."""
    height, width = face.shape
    for v in range(height):
        for u in range(width):
            rx, ry = (u - lens[2]) / lens[0], (v - lens[3]) / lens[1]
            length, cosine, f = 0.0, 0.0, face[v, u]
            for i in range(3):
                way[u, i] = pose[i, 0] * rx + pose[i, 1] * ry + pose[i, 2]
                length += way[u, i] * way[u, i]
                if f >= 0:
                    where[u, i], normal[u, i] = pose[i, 3] + depth[v, u] * way[u, i], normals[f, i]
            length = np.sqrt(length)
            for i in range(3):
                way[u, i] /= length
                cosine += normal[u, i] * way[u, i]
            if cosine > 0:
                for i in range(3):
                    normal[u, i] = -normal[u, i]
        _illuminate(width, where, normal, lamps, shadows, extremes, light)
        for u in range(width):
            f = face[v, u]
            if f < 0:
                for c in range(3):
                    out[v, u, c] = _sky(way[u, 2], c)
                continue
            cosine = normal[u, 0] * way[u, 0] + normal[u, 1] * way[u, 1] + normal[u, 2] * way[u, 2]
            spread = depth[v, u] / lens[0] / np.sqrt(max(-cosine, 0.05))
            _paint(f, where[u, 0], where[u, 1], where[u, 2], spread, texture, tint, to_uv, pool, levels, linear, colour)
            if sheen[f] <= 0:
                for c in range(3):
                    out[v, u, c] = light[u] * colour[c]
                continue
            gloss = sheen[f] + (1 - sheen[f]) * (1 + cosine) ** 5 * (1.0 if metal[f] else 0.5)
            sx, sy, sz = (
                way[u, 0] - 2 * cosine * normal[u, 0],
                way[u, 1] - 2 * cosine * normal[u, 1],
                way[u, 2] - 2 * cosine * normal[u, 2],
            )
            if metal[f]:
                _around(blurred, sx, sy, sz, seen)
            else:
                _around(room, sx, sy, sz, seen)
            for c in range(3):
                if metal[f]:
                    out[v, u, c] = (1 - sheen[f]) * light[u] * colour[c] + gloss * seen[c] * (0.3 + 0.7 * colour[c])
                else:
                    out[v, u, c] = (1 - gloss) * light[u] * colour[c] + gloss * seen[c]


@compiled
def _glaze(face, depth, pose, lens, normals, room, out):
    clear, seen = (0.84, 0.88, 0.86), np.empty(3)
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
            _around(room, sx, sy, sz, seen)
            for c in range(3):
                out[v, u, c] = (1 - gloss) * clear[c] * out[v, u, c] + gloss * seen[c]
