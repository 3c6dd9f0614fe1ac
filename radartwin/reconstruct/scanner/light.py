"""Light in a room: lamps under the ceiling with shadows, light from everywhere, reflections of the room, sky outside.

Plausible, not measured: it serves pictures that a person, or a model that names materials, can read. Shadows are depth cubes around
each lamp, reflections one colour cube around the middle of the room, seen without parallax.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from radartwin.compiled import compiled
from radartwin.reconstruct.scanner.look import LEVELS, Look
from radartwin.reconstruct.scanner.raster import nearest_faces

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
        room: (6, M, M, 3) float32 linear colour around the middle; blurred: the same, coarser.
        exposure: factor from linear light to the picture.
    """

    lamps: np.ndarray
    shadows: np.ndarray
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
    light = Light(lamps, shadows, dark, dark, 1.0)
    middle = np.append((low + high)[:2] / 2, low[2] + min(1.6, 0.5 * (high - low)[2]))
    room = np.empty((6, MIRROR_PIXELS, MIRROR_PIXELS, 3), np.float32)
    for side, (pose, lens) in enumerate(_cameras(middle, MIRROR_PIXELS)):
        face, depth = nearest_faces(look.triangles, every, pose, lens, (MIRROR_PIXELS, MIRROR_PIXELS), near_m=0.1)
        room[side] = shaded(look, light, face, depth, pose, lens)
    n = MIRROR_PIXELS // BLUR
    blurred = room.reshape(6, n, BLUR, n, BLUR, 3).mean(axis=(2, 4))
    brightness = room[:5].mean(axis=-1)  # without the floor, which phones see least
    return Light(lamps, shadows, room, blurred, BRIGHT / max(float(np.quantile(brightness, 0.75)), 1e-6))


def shaded(look: Look, light: Light, face: np.ndarray, depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Linear colour (h, w, 3) float32 of faces (h, w) at depths (h, w); the sky where there is none."""
    lens = np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]])
    out = np.empty((*face.shape, 3), np.float32)
    _shade(
        face, depth, np.ascontiguousarray(pose), lens, look.normals, look.metal, look.sheen, look.to_uv, look.texture, look.tint, look.pool,
        look.levels, light.lamps, light.shadows, light.room, light.blurred, _LINEAR, CUBE, out,
    )  # fmt: skip
    return out


def through_glass(
    look: Look, light: Light, behind: np.ndarray, face: np.ndarray, depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray
) -> None:
    """Lay the panes (h, w), -1 for none, over what is behind them, in place: a faint green and a reflection of the room."""
    lens = np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]])
    _glaze(face, depth, np.ascontiguousarray(pose), lens, look.normals, light.room, CUBE, behind)


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


def _linear_table() -> np.ndarray:
    s = np.arange(256) / 255
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)


_LINEAR = _linear_table()


@compiled
def _side(cube, x, y, z):
    """Side of a cube a direction goes through, and where, -1..1 each way."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        side = 0 if x > 0 else 1
    elif ay >= az:
        side = 2 if y > 0 else 3
    else:
        side = 4 if z > 0 else 5
    forward = cube[side, 2, 0] * x + cube[side, 2, 1] * y + cube[side, 2, 2] * z
    u = (cube[side, 0, 0] * x + cube[side, 0, 1] * y + cube[side, 0, 2] * z) / forward
    v = (cube[side, 1, 0] * x + cube[side, 1, 1] * y + cube[side, 1, 2] * z) / forward
    return side, u, v, forward


@compiled
def _sky(z, channel):
    if z > 0:
        low, high = (1.5, 1.6, 1.75), (0.75, 1.1, 1.8)
        return low[channel] + (high[channel] - low[channel]) * min(1.5 * z, 1.0)
    return (0.42, 0.44, 0.4)[channel]


@compiled
def _around(room, cube, x, y, z, channel):
    """The room's colour in a direction, bilinear within a side."""
    n = room.shape[1]
    side, u, v, _ = _side(cube, x, y, z)
    a, b = min(max((u + 1) * n / 2 - 0.5, 0.0), n - 1.001), min(max((v + 1) * n / 2 - 0.5, 0.0), n - 1.001)
    if n == 1:
        return room[side, 0, 0, channel]
    i, j = int(b), int(a)
    p, q = a - j, b - i
    top = (1 - p) * room[side, i, j, channel] + p * room[side, i, j + 1, channel]
    return (1 - q) * top + q * ((1 - p) * room[side, i + 1, j, channel] + p * room[side, i + 1, j + 1, channel])


@compiled
def _lit(shadows, lamp, cube, x, y, z):
    """Share of light from a lamp at an offset from it: four samples of its depth cube."""
    side, u, v, forward = _side(cube, x, y, z)
    n = shadows.shape[2]
    a, b = (u + 1) * n / 2 - 1, (v + 1) * n / 2 - 1
    total = 0.0
    for di in range(3):
        for dj in range(3):
            i, j = min(max(int(b) + di, 0), n - 1), min(max(int(a) + dj, 0), n - 1)
            if shadows[lamp, side, i, j] > forward - 0.02 - 0.02 * forward:
                total += 1 / 9
    return total


@compiled
def _shade(
    face, depth, pose, lens, normals, metal, sheen, to_uv, texture, tint, pool, levels, lamps, shadows, room, blurred, linear, cube, out
):  # fmt: skip
    height, width = face.shape
    colour = np.empty(3)
    for v in range(height):
        for u in range(width):
            rx, ry = (u - lens[2]) / lens[0], (v - lens[3]) / lens[1]
            dx, dy, dz = (
                pose[0, 0] * rx + pose[0, 1] * ry + pose[0, 2],
                pose[1, 0] * rx + pose[1, 1] * ry + pose[1, 2],
                pose[2, 0] * rx + pose[2, 1] * ry + pose[2, 2],
            )
            length = np.sqrt(dx * dx + dy * dy + dz * dz)
            f = face[v, u]
            if f < 0:
                for c in range(3):
                    out[v, u, c] = _sky(dz / length, c)
                continue
            d = depth[v, u]
            x, y, z = pose[0, 3] + d * dx, pose[1, 3] + d * dy, pose[2, 3] + d * dz
            dx, dy, dz = dx / length, dy / length, dz / length
            nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
            cosine = nx * dx + ny * dy + nz * dz
            if cosine > 0:
                nx, ny, nz, cosine = -nx, -ny, -nz, -cosine
            t = texture[f]
            if t < 0:
                colour[:] = tint[f]
            else:
                # The level whose pixels are as large as ours on the surface; bilinear, repeated.
                m = to_uv[f]
                a = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
                b = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
                density = np.sqrt(m[0, 0] ** 2 + m[0, 1] ** 2 + m[0, 2] ** 2)
                footprint = density * d / lens[0] / np.sqrt(max(-cosine, 0.05))
                n = min(max(int(np.floor(np.log2(max(footprint, 1e-3)) + 0.5)), 0), LEVELS - 1)
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
            light = AMBIENT * (0.8 + 0.2 * nz)
            for k in range(len(lamps)):
                lx, ly, lz = lamps[k, 0] - x, lamps[k, 1] - y, lamps[k, 2] - z
                square = lx * lx + ly * ly + lz * lz
                facing = (nx * lx + ny * ly + nz * lz) / np.sqrt(square)
                if facing > 0:
                    light += 2.2 * facing / (square + 0.5) * _lit(shadows, k, cube, -lx + 0.01 * nx, -ly + 0.01 * ny, -lz + 0.01 * nz)
            if sheen[f] <= 0:
                for c in range(3):
                    out[v, u, c] = light * colour[c]
                continue
            gloss = sheen[f] + (1 - sheen[f]) * (1 + cosine) ** 5 * (1.0 if metal[f] else 0.5)
            sx, sy, sz = dx - 2 * cosine * nx, dy - 2 * cosine * ny, dz - 2 * cosine * nz
            for c in range(3):
                seen = _around(blurred if metal[f] else room, cube, sx, sy, sz, c)
                if metal[f]:
                    out[v, u, c] = (1 - sheen[f]) * light * colour[c] + gloss * seen * (0.3 + 0.7 * colour[c])
                else:
                    out[v, u, c] = (1 - gloss) * light * colour[c] + gloss * seen


@compiled
def _glaze(face, depth, pose, lens, normals, room, cube, out):
    clear = (0.84, 0.88, 0.86)
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
            for c in range(3):
                out[v, u, c] = (1 - gloss) * clear[c] * out[v, u, c] + gloss * _around(room, cube, sx, sy, sz, c)
