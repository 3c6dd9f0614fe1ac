"""Compute one view of the phone's camera: the true depth, the face that reflects at each pixel, and the colour picture."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from radartwin.testbed.scanner.light import Light, shaded, through_glass
from radartwin.testbed.scanner.look import Look
from radartwin.testbed.scanner.raster import nearest_faces

VIGNETTE = 0.12  # darkening of the corners
GRAIN = 1.2  # standard deviation of the colour noise, counts of 255
NOT_SEEN = -1


@dataclasses.dataclass(frozen=True, eq=False)
class Sight:
    """The first surface that reflects light along each pixel's ray. All arrays have shape (h, w).

    Attributes:
        depth: float32 depth of the reflecting surface in metres, through panes and via mirrors; infinite where the ray leaves the scene.
        face: int32 index of the reflecting face; -1 where the ray leaves the scene.
        first: int32 index of the first surface on the ray, including panes and mirrors; -1 where the ray leaves the scene.
        pane, mirror: whether the ray passes a pane, or is reflected by a mirror.
        cosine: float32 cosine of the angle between the ray and the face's normal; 0 where the ray leaves the scene.
    """

    depth: np.ndarray
    face: np.ndarray
    first: np.ndarray
    pane: np.ndarray
    mirror: np.ndarray
    cosine: np.ndarray


class _Reflection(NamedTuple):
    """The pixels (h, w) of a mirror, the faces and depths (h, w) visible in it, and the mirrored camera's pose."""

    where: np.ndarray
    face: np.ndarray
    depth: np.ndarray
    pose: np.ndarray


class _Hits(NamedTuple):
    """The visible solid faces and their depths (h, w), the panes in front of them, and the reflections in mirrors."""

    face: np.ndarray
    depth: np.ndarray
    pane: np.ndarray
    pane_depth: np.ndarray
    reflections: list[_Reflection]


def sight(look: Look, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]) -> Sight:
    """Return the true depth and the reflecting face of each pixel, for a camera at `pose` with pictures of `size` (width, height)."""
    face, depth, pane, pane_depth, reflections = _hits(look, pose, intrinsics, size)
    first = np.where(face >= 0, look.surface[face], NOT_SEEN)
    first = np.where(pane >= 0, look.surface[pane], first)
    mirrored = np.zeros(face.shape, dtype=bool)
    for mirror in reflections:
        face, depth = np.where(mirror.where, mirror.face, face), np.where(mirror.where, mirror.depth, depth)
        mirrored |= mirror.where
    cosine = _cosine(look, face, pose, intrinsics, reflections)
    return Sight(depth, face, first.astype(np.int32), np.isfinite(pane_depth), mirrored, cosine)


def picture(
    look: Look, light: Light, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int], rng: np.random.Generator
) -> np.ndarray:
    """Render the colour picture (h, w, 3), uint8 sRGB, with vignetting and grain."""
    hits = _hits(look, pose, intrinsics, size)
    linear = shaded(look, light, hits.face, hits.depth, pose, intrinsics)
    for where, face, depth, virtual in hits.reflections:
        linear[where] = 0.9 * shaded(look, light, np.where(where, face, -1), depth, virtual, intrinsics)[where]
    through_glass(look, light, linear, hits.pane, hits.pane_depth, pose, intrinsics)
    height, width = hits.face.shape
    v, u = np.mgrid[:height, :width].astype(np.float32)
    radius = ((u - width / 2) ** 2 + (v - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
    linear *= (light.exposure * (1 - VIGNETTE * radius))[..., None]
    linear = np.where(linear > 0.7, 0.7 + 0.3 * np.tanh((linear - 0.7) / 0.3), linear)  # compress highlights
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-6) ** (1 / 2.4) - 0.055)
    noise = rng.standard_normal((height, width, 1), dtype=np.float32) * np.float32(GRAIN)
    return np.clip(255 * srgb + noise + 0.5, 0, 255).astype(np.uint8)


def _hits(look: Look, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]) -> _Hits:
    face, depth = nearest_faces(look.triangles, look.solid, pose, intrinsics, size)
    pane, pane_depth = np.full_like(face, -1), np.full_like(depth, np.inf)
    if look.clear.any():
        pane, pane_depth = nearest_faces(look.triangles, look.clear, pose, intrinsics, size, depth)
    reflections = []
    if look.mirror.any():
        mirrors = np.unique(look.surface[face[(face >= 0) & look.mirror[face]]])
        reflections = [_reflection(look, int(index), face, pose, intrinsics, size) for index in mirrors]
    return _Hits(face, depth, pane, pane_depth, reflections)


def _reflection(look: Look, index: int, face: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray, size: tuple[int, int]) -> _Reflection:
    """Return the reflection that the camera sees in the mirror with surface index `index`."""
    own = look.surface == index
    where = (face >= 0) & own[face]
    front = int(np.bincount(face[where]).argmax())  # the visible side, because a mirror may be a thin box
    normal, point = look.normals[front], look.triangles[front, 0]
    normal = normal * np.sign((pose[:3, 3] - point) @ normal)
    flip = np.eye(4)
    flip[:3, :3] -= 2 * np.outer(normal, normal)
    flip[:3, 3] = 2 * (point @ normal) * normal
    ahead = ((look.triangles - point) @ normal).max(axis=1) > 1e-3
    virtual = flip @ pose
    return _Reflection(where, *nearest_faces(look.triangles, look.solid & ~own & ahead, virtual, intrinsics, size), virtual)


def _cosine(look: Look, face: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray, reflections: list[_Reflection]) -> np.ndarray:
    v, u = np.indices(face.shape)
    ray = np.stack([(u - intrinsics[0, 2]) / intrinsics[0, 0], (v - intrinsics[1, 2]) / intrinsics[1, 1], np.ones(face.shape)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    out = np.abs(np.einsum("ijk,ijk->ij", look.normals[face], ray @ pose[:3, :3].T))
    for mirror in reflections:
        where = mirror.where
        out[where] = np.abs(np.einsum("jk,jk->j", look.normals[face[where]], ray[where] @ mirror.pose[:3, :3].T))
    return np.where(face >= 0, out, 0).astype(np.float32)
