"""One look of the phone at the scene: true depth, what it comes from, and the colour picture."""

from __future__ import annotations

import dataclasses

import numpy as np

from radartwin.testbed.scanner.light import Light, shaded, through_glass
from radartwin.testbed.scanner.look import Look
from radartwin.testbed.scanner.raster import nearest_faces

VIGNETTE = 0.12  # darkening of the corners
GRAIN = 1.2  # standard deviation of the colour noise, counts of 255
NOT_SEEN = -1


@dataclasses.dataclass(frozen=True, eq=False)
class Sight:
    """What light along each pixel's ray meets; (h, w) each.

    Attributes:
        depth: float32 metres to what returns light: through panes, and by way of mirrors; infinite outside.
        face: int32 of what returns it, -1 outside.
        first: int32 index of the first surface on the way, panes and mirrors included; -1 outside.
        pane, mirror: whether light went through a pane, or by way of a mirror.
        cosine: float32 between the ray and the normal of `face`; 0 outside.
    """

    depth: np.ndarray
    face: np.ndarray
    first: np.ndarray
    pane: np.ndarray
    mirror: np.ndarray
    cosine: np.ndarray


def sight(look: Look, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]) -> Sight:
    """True depth and origin for a camera at `pose`, pictures of `size` (width, height)."""
    face, depth, panes, pane_depth, mirrors = _faces(look, pose, intrinsics, size)
    first = np.where(face >= 0, look.surface[face], NOT_SEEN)
    first = np.where(panes >= 0, look.surface[panes], first)
    through = np.isfinite(pane_depth)
    mirrored = np.zeros(face.shape, dtype=bool)
    for where, other, far, _ in mirrors:
        face, depth = np.where(where, other, face), np.where(where, far, depth)
        mirrored |= where
    return Sight(depth, face, first.astype(np.int32), through, mirrored, _cosine(look, face, pose, intrinsics, mirrors))


def picture(
    look: Look, light: Light, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int], rng: np.random.Generator
) -> np.ndarray:
    """Colour picture (h, w, 3) uint8 sRGB, with vignetting and grain."""
    face, depth, panes, pane_depth, mirrors = _faces(look, pose, intrinsics, size)
    linear = shaded(look, light, face, depth, pose, intrinsics)
    for where, other, far, virtual in mirrors:
        linear[where] = 0.9 * shaded(look, light, np.where(where, other, -1), far, virtual, intrinsics)[where]
    through_glass(look, light, linear, panes, pane_depth, pose, intrinsics)
    height, width = face.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    radius = ((u - width / 2) ** 2 + (v - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
    linear *= (light.exposure * (1 - VIGNETTE * radius))[..., None]
    linear = np.where(linear > 0.7, 0.7 + 0.3 * np.tanh((linear - 0.7) / 0.3), linear)  # a shoulder for highlights
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055)
    noise = rng.standard_normal((height, width, 1), dtype=np.float32) * np.float32(GRAIN)
    return np.clip(255 * srgb + noise + 0.5, 0, 255).astype(np.uint8)


def _faces(look: Look, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]):
    """Solid faces and depth, panes before them and their depth, and per mirror what it shows."""
    face, depth = nearest_faces(look.triangles, look.solid, pose, intrinsics, size)
    panes, pane_depth = np.full_like(face, -1), np.full_like(depth, np.inf)
    if look.clear.any():
        panes, pane_depth = nearest_faces(look.triangles, look.clear, pose, intrinsics, size, depth)
    mirrors = []
    if look.mirror.any():
        hit = np.unique(look.surface[face[(face >= 0) & look.mirror[face]]])
        mirrors = [_mirror(look, int(index), face, pose, intrinsics, size) for index in hit]
    return face, depth, panes, pane_depth, mirrors


def _mirror(look: Look, index: int, face: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]):
    """Where a mirror is seen, the faces and depths it shows there, and the mirrored camera's pose."""
    own = look.surface == index
    where = (face >= 0) & own[face]
    front = int(np.bincount(face[where]).argmax())  # a mirror may be a thin box: take the side that shows
    normal, point = look.normals[front], look.triangles[front, 0]
    normal = normal * np.sign((pose[:3, 3] - point) @ normal)
    flip = np.eye(4)
    flip[:3, :3] -= 2 * np.outer(normal, normal)
    flip[:3, 3] = 2 * (point @ normal) * normal
    ahead = ((look.triangles - point) @ normal).max(axis=1) > 1e-3
    virtual = flip @ pose
    other, far = nearest_faces(look.triangles, look.solid & ~own & ahead, virtual, intrinsics, size)
    return where, other, far, virtual


def _cosine(look: Look, face: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray, mirrors) -> np.ndarray:
    v, u = np.indices(face.shape)
    ray = np.stack([(u - intrinsics[0, 2]) / intrinsics[0, 0], (v - intrinsics[1, 2]) / intrinsics[1, 1], np.ones(face.shape)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    out = np.abs(np.einsum("ijk,ijk->ij", look.normals[face], ray @ pose[:3, :3].T))
    for where, _, _, virtual in mirrors:
        out[where] = np.abs(np.einsum("jk,jk->j", look.normals[face[where]], ray[where] @ virtual[:3, :3].T))
    return np.where(face >= 0, out, 0).astype(np.float32)
