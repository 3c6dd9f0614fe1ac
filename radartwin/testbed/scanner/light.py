"""Model the light in a room: lamps under the ceiling with shadows, ambient light, reflections of the room, and the sky outside.

The light is plausible, not measured, because the pictures only need to be readable by a person or by a model that names materials. A depth
cube map around each lamp gives the lamp's shadows. One colour cube map around the centre of the room gives the reflections in shiny
surfaces, without parallax.
"""

from __future__ import annotations

import numpy as np

from radartwin.testbed.scanner.look import Look
from radartwin.testbed.scanner.raster import nearest_faces
from radartwin.testbed.scanner.shading import Light, Run, glaze, shade

SHADOW_PIXELS, MIRROR_PIXELS = 256, 128
LAMP_SPACING_M, LAMP_DROP_M = 3.0, 0.6  # distance between lamps, and from the ceiling to the lamps, which hang below luminaires
BLUR = 4  # the reflection of the room in brushed metal has the resolution MIRROR_PIXELS / BLUR
BRIGHT = 0.55  # linear picture value (0 to 1) to which the exposure maps the upper quartile of the room's brightness
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


def light_of(look: Look) -> Light:
    """Compute the lamps, shadows and reflections of a scene, and the exposure for a camera at the centre of the room."""
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
    brightness = room[:5].mean(axis=-1)  # leaves out the cube side with the floor, which phone cameras see least
    return light._replace(room=room, blurred=blurred, exposure=BRIGHT / max(float(np.quantile(brightness, 0.75)), 1e-6))


def shaded(look: Look, light: Light, face: np.ndarray, depth: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Return the linear colour (h, w, 3) float32 of pixels that show the face `face` (h, w) at `depth` (h, w); face -1 shows the sky."""
    out = np.empty((*face.shape, 3), np.float32)
    shade(face, depth, np.ascontiguousarray(pose), _lens(intrinsics), look, light, Run.of(face.shape[1]), out)
    return out


def through_glass(look: Look, light: Light, behind: np.ndarray, face: np.ndarray, pose: np.ndarray, intrinsics: np.ndarray) -> None:
    """Add the green tint and the reflections of glass panes to the picture `behind`, in place. `face` is -1 at pixels without a pane."""
    glaze(face, np.ascontiguousarray(pose), _lens(intrinsics), look.normals, light.room, behind)


def _lens(intrinsics: np.ndarray) -> np.ndarray:
    return np.array([intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]])


def _lamps(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    counts = np.maximum(np.round((high - low)[:2] / LAMP_SPACING_M).astype(int), 1)
    x, y = (low[i] + (high - low)[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in range(2))
    height = low[2] + max((high - low)[2] - LAMP_DROP_M, 0.5 * (high - low)[2])
    return np.array([[a, b, height] for a in x for b in y])


def _cube_cameras(position: np.ndarray, pixels: int):
    """Yield the pose and the intrinsics of each of the six cameras of a cube map around `position` (3,)."""
    intrinsics = np.array([[pixels / 2, 0, pixels / 2 - 0.5], [0, pixels / 2, pixels / 2 - 0.5], [0, 0, 1]])
    for axes in CUBE:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes.T, position
        yield pose, intrinsics


def _depths(look: Look, position: np.ndarray) -> np.ndarray:
    """Return the depth cube map (6, S, S) around a lamp at `position` (3,), in metres."""
    size = (SHADOW_PIXELS, SHADOW_PIXELS)
    cameras = _cube_cameras(position, SHADOW_PIXELS)
    return np.stack([nearest_faces(look.triangles, look.solid, pose, intrinsics, size, near_m=0.3)[1] for pose, intrinsics in cameras])


def _extremes(shadows: np.ndarray) -> np.ndarray:
    """Return the smallest and largest depth (..., 2) in a block of 3 x 3 pixels for each pixel."""
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
