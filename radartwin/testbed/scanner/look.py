"""Describe the appearance of a scene's surfaces: all textures in one array of pixels, texture coordinates, and optical properties.

The optical properties follow from the true materials. A surface of glass and air layers is transparent if air is behind it. Metal reflects
like a mirror. Polished, glazed and glass surfaces have a sheen. All other surfaces are diffuse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radartwin.materials import Layered, layered
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.textures import texture as texture_of

LEVELS = 7  # number of resolution levels of a texture; each level has half the width and height of the previous level
METAL_SHEEN, DIELECTRIC_SHEEN = 0.55, 0.04  # reflectance at normal incidence: brushed metal; glass and lacquer of index 1.5
# Organic materials are bright at the laser's wavelength of 0.94 um for any visible colour: leaves, wood and dyed cloth reflect 0.4 to 0.7
# of the light (Kokaly et al. 2017, USGS Spectral Library Version 7, Data Series 1035).
ORGANIC, ORGANIC_REFLECTANCE = {"wood", "fabric", "leather", "carpet", "paper", "foliage", "hair", "skin"}, 0.4
GLOSSY = {"glass", "tile", "ceramic", "polishedstone", "plastic", "wood", "leather"}
# This table gives the sRGB colour of a surface without texture, by the material of its outermost layer.
PLAIN = {
    "metal": (150, 155, 160), "concrete": (160, 158, 152), "brick": (150, 80, 60), "plasterboard": (228, 222, 210), "wood": (176, 132, 84),
    "plywood": (205, 170, 120), "chipboard": (214, 186, 142), "floorboard": (184, 144, 96), "glass": (180, 205, 210),
    "ceiling_board": (232, 230, 224), "marble": (225, 222, 218), "pet": (200, 215, 215), "hdpe": (225, 225, 220),
}  # fmt: skip
OTHER = (170, 170, 170)


class Look(NamedTuple):
    """The appearance of the F faces of a scene. The pixels of all textures are stored in one array.

    Attributes:
        triangles: (F, 3, 3) corners of each face in world coordinates. normals: (F, 3) unit normal of each face.
        surface: (F,) index in the scene of the surface that each face belongs to.
        clear: (F,) bool, whether each face is transparent.
        metal: (F,) bool, whether each face is metal. organic: (F,) bool, whether each face is bright in the near infrared.
        sheen: (F,) reflectance of each face at normal incidence.
        to_uv: (F, 2, 4) affine map from world coordinates to pixels of the face's texture at its finest resolution level.
        texture: (F,) index of each face's texture, -1 for none. tint: (F, 3) linear colour of each face without texture.
        pool: (P, 3) uint8 sRGB pixels of all levels of all textures.
        levels: (T, LEVELS, 3) offset in `pool`, width and height of each resolution level of each texture.
    """

    triangles: np.ndarray
    normals: np.ndarray
    surface: np.ndarray
    clear: np.ndarray
    metal: np.ndarray
    organic: np.ndarray
    sheen: np.ndarray
    to_uv: np.ndarray
    texture: np.ndarray
    tint: np.ndarray
    pool: np.ndarray
    levels: np.ndarray

    @property
    def solid(self) -> np.ndarray:
        return ~self.clear


def look_of(scene: Scene) -> Look:
    """Compute the appearance of a scene.

    >>> import trimesh
    >>> pane = Surface(trimesh.creation.box((1, 1, 0.01)), Layered([("glass", 0.01)]), "pane")
    >>> bool(look_of(Scene([pane])).clear.all())
    True
    """
    pictures: dict[int, tuple[int, np.ndarray]] = {}
    parts = [_faces(surface, index, pictures) for index, surface in enumerate(scene)]
    joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    pool, levels = _pooled([picture for _, picture in pictures.values()])
    return Look(**joined, pool=pool, levels=levels)


def _faces(surface: Surface, index: int, pictures: dict[int, tuple[int, np.ndarray]]) -> dict[str, np.ndarray]:
    mesh = surface.mesh
    triangles = np.asarray(mesh.triangles, dtype=np.float64)
    count = len(triangles)
    minc = str(surface.provenance.get("minc") or "")
    outer = _outer(surface.material)
    metal = minc == "metal" or (not minc and outer == "metal")
    sheen = METAL_SHEEN if metal else DIELECTRIC_SHEEN if minc in GLOSSY or (not minc and outer in GLOSSY) else 0.0
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-15)[:, None]
    to_uv, texture = np.zeros((count, 2, 4)), np.full(count, -1, np.int32)
    tint = np.tile(to_linear(np.array(PLAIN.get(outer, OTHER), np.uint8)), (count, 1))
    picture, uv = texture_of(mesh), getattr(mesh.visual, "uv", None)
    if picture is not None and uv is not None:
        if id(picture) not in pictures:
            pictures[id(picture)] = (len(pictures), np.asarray(picture.convert("RGB")))
        number, pixels = pictures[id(picture)]
        texture[:] = number
        height, width = pixels.shape[:2]
        # v increases upwards, pixel rows downwards
        corner = np.asarray(uv, dtype=np.float64)[np.asarray(mesh.faces)] * (width, -height) + (-0.5, height - 0.5)
        to_uv = _affine(triangles, normals, corner)
    return {
        "triangles": triangles,
        "normals": normals,
        "surface": np.full(count, index, np.int32),
        "clear": np.full(count, _is_clear(surface)),
        "metal": np.full(count, metal),
        "organic": np.full(count, minc in ORGANIC or (not minc and outer in ("wood", "plywood", "chipboard", "floorboard"))),
        "sheen": np.full(count, sheen),
        "to_uv": to_uv,
        "texture": texture,
        "tint": tint,
    }


def _is_clear(surface: Surface) -> bool:
    """Return whether the surface is transparent, which means that it has only layers of glass and air, with air behind them."""
    stack = layered(surface.material)
    if stack.backing not in ("air", "vacuum"):
        return False
    names = {name for name, _ in stack.layers}
    return "glass" in names and names <= {"glass", "air"}


def to_linear(srgb: np.ndarray) -> np.ndarray:
    """Convert sRGB values from 0 to 255 to linear light from 0 to 1, by IEC 61966-2-1."""
    s = np.asarray(srgb, dtype=np.float64) / 255
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def _outer(material: str | Layered) -> str:
    if isinstance(material, str):
        return material
    return material.layers[0][0] if material.layers else material.backing


def _affine(triangles: np.ndarray, normals: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Return affine maps (F, 2, 4) that map the world corners of each triangle to its texture coordinates `corner` (F, 3, 2)."""
    edges = np.stack([triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0], normals], axis=1)
    sound = np.abs(np.linalg.det(edges)) > 1e-14
    inverse = np.zeros_like(edges)
    inverse[sound] = np.linalg.inv(edges[sound])
    steps = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], np.zeros_like(corner[:, 0])], axis=1)
    linear = np.swapaxes(inverse @ steps, 1, 2)
    shift = corner[:, 0] - (linear @ triangles[:, 0, :, None])[..., 0]
    return np.concatenate([linear, shift[..., None]], axis=2)


def _pooled(pictures: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return one array with the pixels of all resolution levels of all pictures, and the offset, width and height of each level."""
    pixels, levels, offset = [np.zeros((1, 3), np.uint8)], np.zeros((max(len(pictures), 1), LEVELS, 3), np.int64), 1
    for number, picture in enumerate(pictures):
        level = picture
        for n in range(LEVELS):
            height, width = level.shape[:2]
            levels[number, n] = offset, width, height
            pixels.append(level.reshape(-1, 3))
            offset += height * width
            if min(height, width) >= 2:
                even = level[: height // 2 * 2, : width // 2 * 2].reshape(height // 2, 2, width // 2, 2, 3)
                level = (even.mean(axis=(1, 3)) + 0.5).astype(np.uint8)
    return np.vstack(pixels), levels
