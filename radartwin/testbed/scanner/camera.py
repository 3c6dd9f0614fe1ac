"""Compute one view of the simulated phone: the true depth, the reflecting face at each pixel, and the colour picture."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from radartwin.compiled import compiled
from radartwin.testbed.scanner.light import Light, shaded, through_glass
from radartwin.testbed.scanner.look import Look
from radartwin.testbed.scanner.raster import nearest_faces

VIGNETTE = 0.12  # relative loss of brightness in the corners of the colour picture
GRAIN = 1.2  # standard deviation of the noise in the colour picture, for 8-bit values from 0 to 255
NOT_SEEN = -1


@dataclasses.dataclass(frozen=True, eq=False)
class Sight:
    """The first surface that reflects light along the ray of each pixel. All arrays of a `Sight` have the shape (h, w) of the picture.

    Attributes:
        depth: float32 depth in metres of the first surface that is not a transparent pane; infinite where the ray leaves the scene.
        face: int32 index of the reflecting face; -1 where the ray leaves the scene.
        first: int32 index of the first surface on the ray, including panes; -1 where the ray leaves the scene.
        pane: whether the ray passes through a transparent pane.
        cosine: float32 cosine of the angle between the ray and the reflecting face's normal; 0 where the ray leaves the scene.
    """

    depth: np.ndarray
    face: np.ndarray
    first: np.ndarray
    pane: np.ndarray
    cosine: np.ndarray


def sight(look: Look, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]) -> Sight:
    """Return the true depth and the reflecting face at each pixel of a camera at `pose` (4, 4) with `size` (width, height) in pixels."""
    face, depth, pane, pane_depth = _hits(look, pose, intrinsics, size)
    first = np.where(face >= 0, look.surface[face], NOT_SEEN)
    first = np.where(pane >= 0, look.surface[pane], first)
    v, u = np.indices(face.shape)
    ray = np.stack([(u - intrinsics[0, 2]) / intrinsics[0, 0], (v - intrinsics[1, 2]) / intrinsics[1, 1], np.ones(face.shape)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    cosine = np.abs(np.einsum("ijk,ijk->ij", look.normals[face], ray @ pose[:3, :3].T))
    cosine = np.where(face >= 0, cosine, 0).astype(np.float32)
    return Sight(depth, face, first.astype(np.int32), np.isfinite(pane_depth), cosine)


def picture(
    look: Look, light: Light, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int], rng: np.random.Generator
) -> np.ndarray:
    """Render the colour picture (h, w, 3), uint8 sRGB, of the phone's camera, with dark corners and noise."""
    face, depth, pane, _ = _hits(look, pose, intrinsics, size)
    linear = shaded(look, light, face, depth, pose, intrinsics)
    through_glass(look, light, linear, pane, pose, intrinsics)
    height, width = face.shape
    linear *= (light.exposure * _corners(height, width))[..., None]
    bright = linear > 0.7
    linear[bright] = 0.7 + 0.3 * np.tanh((linear[bright] - 0.7) / 0.3)  # compresses very bright values
    power = np.maximum(linear, 1e-6) ** (1 / 2.4)
    return _quantised(linear, power, rng.standard_normal((height, width), dtype=np.float32))


@functools.cache
def _corners(height: int, width: int) -> np.ndarray:
    """Return the relative brightness (h, w) float32 of a picture's pixels, which decreases towards the corners."""
    v, u = np.mgrid[:height, :width].astype(np.float32)
    radius = ((u - width / 2) ** 2 + (v - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
    return 1 - VIGNETTE * radius


@compiled
def _quantised(linear, power, noise):
    """Return the 8-bit sRGB picture (h, w, 3) of the linear colours `linear`."""
    height, width, _ = linear.shape
    out = np.empty((height, width, 3), np.uint8)
    for v in range(height):
        for u in range(width):
            for c in range(3):
                dark = linear[v, u, c] <= np.float32(0.0031308)
                srgb = np.float32(12.92) * linear[v, u, c] if dark else np.float32(1.055) * power[v, u, c] - np.float32(0.055)
                value = np.float32(255) * srgb + noise[v, u] * np.float32(GRAIN) + np.float32(0.5)
                out[v, u, c] = np.uint8(min(max(value, np.float32(0)), np.float32(255)))
    return out


def _hits(
    look: Look, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (nearest opaque face, its depth, pane in front of it, depth of the pane) at each pixel, each of shape (h, w)."""
    face, depth = nearest_faces(look.triangles, look.solid, pose, intrinsics, size)
    pane, pane_depth = np.full_like(face, -1), np.full_like(depth, np.inf)
    if look.clear.any():
        pane, pane_depth = nearest_faces(look.triangles, look.clear, pose, intrinsics, size, depth)
    return face, depth, pane, pane_depth
