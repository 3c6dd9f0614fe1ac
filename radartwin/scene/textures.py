"""Define the visible appearance of surfaces: named textures that are drawn procedurally, and meshes with these textures at true size.

A texture (class `Look`) is a pattern with its colours and the size of its bitmap in metres. The bitmap repeats without a seam. Each face of
a mesh is projected onto the side of a box that the face is most parallel to. Texture coordinates are positions on that side in metres,
divided by the size of the bitmap. The same name and seed give the same pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from radartwin.errors import SceneError
from radartwin.scene import patterns

PIXEL_M = 0.004  # default size of a bitmap pixel in metres; a pixel of a phone's camera covers 3 mm at 4 m


class Look(NamedTuple):
    """Describe the texture of a surface: a visible pattern with its colours and its size.

    Attributes:
        draw: function of (rng, (h, w), metres per pixel, colours) that draws a bitmap (h, w, 3) with floats in 0..1.
        colours: colours of the pattern as 0xRRGGBB, the main colour first.
        width_m, height_m: size of the bitmap in metres, which is the period of the pattern.
        metallic: metallic factor (0 to 1) of the material when the mesh is rendered.
        pixel_m: size of a bitmap pixel in metres.
        fits: whether the bitmap is stretched over each side of an object instead of repeated, as for screens and posters.
        wraps: whether the bitmap is the paper label of a can, which is stretched over the can's height and repeated around the can's axis;
            the ends of the can have the colours of the bitmap's bottom row.
    """

    draw: Callable[[np.random.Generator, tuple[int, int], float, np.ndarray], np.ndarray]
    colours: tuple[int, ...]
    width_m: float = 1.2
    height_m: float = 1.2
    metallic: float = 0.0
    pixel_m: float = PIXEL_M
    fits: bool = False
    wraps: bool = False


LOOKS: dict[str, Look] = {
    "wood": Look(patterns.wood, (0xB98A5A, 0x8A5C34), 0.6, 1.2, pixel_m=0.003),
    "dark_wood": Look(patterns.wood, (0x7A4E2E, 0x4C2E1A), 0.6, 1.2, pixel_m=0.003),
    "pale_wood": Look(patterns.wood, (0xDDBE92, 0xB98F5E), 0.6, 1.2, pixel_m=0.003),
    "wood_panelling": Look(patterns.panelling, (0xA8703F, 0x744722), 2.4, 2.4),
    "floorboards": Look(patterns.planks, (0xC79A63, 0x94673A), 1.44, 2.4),
    "court_floor": Look(patterns.long_planks, (0xDDB980, 0xBB9256), 2.4, 0.96),
    "plaster": Look(patterns.plaster, (0xE9E4D8,), 1.6, 1.6),
    "white_plaster": Look(patterns.plaster, (0xF2F1EC,), 1.6, 1.6),
    "concrete": Look(patterns.concrete, (0x9C9A95, 0x6E6C68), 2.4, 2.4),
    "painted_concrete": Look(patterns.painted_concrete, (0xF0EFEA, 0xD8D6CE), 2.4, 2.4),
    "brick": Look(patterns.brick, (0x9A4B36, 0xBEB6A8), 0.9, 0.6, pixel_m=0.0025),
    "carpet": Look(patterns.carpet, (0x5B3F4F, 0x8C6E5A), 1.0, 1.0, pixel_m=0.003),
    "tiles": Look(patterns.tiles, (0xCFC8BC, 0x8C867C), 2.4, 2.4),
    "ceiling_board": Look(patterns.ceiling_board, (0xEDEBE5, 0x8E8B84), 1.2, 1.2, pixel_m=0.003),
    "brushed_metal": Look(patterns.brushed, (0xA9ADB0,), 0.8, 0.8, 0.6, 0.002),
    "painted_metal": Look(patterns.plastic, (0xD5D8D6,), 0.6, 0.6, 0.2),
    "dark_metal": Look(patterns.brushed, (0x4A4D50,), 0.8, 0.8, 0.6, 0.002),
    "red_metal": Look(patterns.plastic, (0xB3221F,), 0.6, 0.6, 0.2),
    "lamp": Look(patterns.plastic, (0xFDFBF2,), 0.6, 0.6),
    "glass": Look(patterns.glass, (0xA9C6C9, 0xDDEBEC), 2.0, 2.0),
    "fabric": Look(patterns.fabric, (0x5C6F82, 0x44566A), 0.3, 0.3, pixel_m=0.0015),
    "red_fabric": Look(patterns.fabric, (0x8C3B35, 0x6A2A28), 0.3, 0.3, pixel_m=0.0015),
    "leather": Look(patterns.leather, (0x6B4228, 0x3F2415), 0.4, 0.4, pixel_m=0.002),
    "plastic": Look(patterns.plastic, (0x2B2D30,), 0.4, 0.4),
    "white_plastic": Look(patterns.plastic, (0xE6E6E2,), 0.4, 0.4),
    "ceramic": Look(patterns.plastic, (0xF4F2EC,), 0.4, 0.4),
    "cardboard": Look(patterns.cardboard, (0xB98F62, 0x9A7349), 0.5, 0.5, pixel_m=0.002),
    "foliage": Look(patterns.foliage, (0x3F6B35, 0x7FA65A), 0.4, 0.4, pixel_m=0.002),
    "soil": Look(patterns.concrete, (0x4A3628, 0x2C2018), 0.6, 0.6),
    "monitor": Look(patterns.monitor, (0x15181C, 0x3B78B5, 0xE6E9EC), 0.6, 0.4, pixel_m=0.002, fits=True),
    "poster": Look(patterns.poster, (0xF3EFE3, 0xC2452D, 0x2F4A66), 0.6, 0.85, pixel_m=0.0025, fits=True),
    "label_red": Look(patterns.label, (0xF4F1E8, 0xC0201F, 0xD9A441), 0.07, 0.1, pixel_m=0.0005, wraps=True),
    "label_green": Look(patterns.label, (0xF4F1E8, 0x2E7D3B, 0xE3C24A), 0.07, 0.1, pixel_m=0.0005, wraps=True),
    "label_blue": Look(patterns.label, (0xE9EEF2, 0x1F4E9B, 0xC9CED2), 0.07, 0.1, pixel_m=0.0005, wraps=True),
    "label_yellow": Look(patterns.label, (0xF6EFD2, 0xD99A1B, 0x7A3E12), 0.07, 0.1, pixel_m=0.0005, wraps=True),
    "green_plastic": Look(patterns.plastic, (0x6F7F2A,), 0.3, 0.3),
    "cyan_plastic": Look(patterns.plastic, (0x2FA7B5,), 0.3, 0.3),
    "yellow_plastic": Look(patterns.plastic, (0xF2C618,), 0.3, 0.3),
    "cream_plastic": Look(patterns.plastic, (0xD9B483,), 0.3, 0.3),
}


@lru_cache(maxsize=128)
def bitmap(name: str, seed: int = 0) -> np.ndarray:
    """Draw the bitmap of the texture `name`: a read-only uint8 array (h, w, 3) with row 0 at the top."""
    look = _look(name)
    shape = (round(look.height_m / look.pixel_m), round(look.width_m / look.pixel_m))
    rng = np.random.default_rng(np.random.SeedSequence([seed, *name.encode()]))
    colours = np.array([patterns.rgb(c) for c in look.colours])
    out = _as_bytes(look.draw(rng, shape, look.pixel_m, colours))
    out.setflags(write=False)
    return out


def textured(mesh: trimesh.Trimesh, name: str, seed: int = 0) -> trimesh.Trimesh:
    """Return a copy of a mesh with the texture `name`; an unknown name raises SceneError.

    Vertices are duplicated only where their faces are projected onto different sides of a box. Faces keep their order and winding.
    """
    look = _look(name)
    if look.wraps:
        return _with_label(mesh, _material(name, seed), look.width_m)
    return _box_projected(mesh, _material(name, seed), (look.width_m, look.height_m), look.fits)


def _look(name: str) -> Look:
    if name not in LOOKS:
        raise SceneError(f"there is no texture {name!r}; choose {', '.join(sorted(LOOKS))}")
    return LOOKS[name]


def with_image(mesh: trimesh.Trimesh, image: np.ndarray, corner: np.ndarray, along: np.ndarray, up: np.ndarray) -> trimesh.Trimesh:
    """Return a copy of a flat mesh that is covered by a picture.

    Args:
        image: (h, w, 3) picture with floats in 0..1 and row 0 at the top.
        corner: (3,) position of the picture's lower left corner, metres.
        along, up: (3,) vectors from the picture's lower left corner to the lower right and to the upper left corner, metres.
    """
    offset = np.asarray(mesh.vertices) - corner
    uv = np.stack([offset @ along / (along @ along), offset @ up / (up @ up)], axis=1)
    return _textured(mesh.vertices, mesh.faces, mesh.vertex_normals, uv, _pbr(_as_bytes(image), 0.0))


def tiled(name: str, size_m: tuple[float, float], pixel_m: float) -> np.ndarray:
    """Repeat the texture `name` over a rectangle of `size_m` (width, height), and return a picture (h, w, 3) with floats in 0..1."""
    look, tile = LOOKS[name], bitmap(name)
    columns = ((np.arange(round(size_m[0] / pixel_m)) + 0.5) * pixel_m % look.width_m / look.width_m * tile.shape[1]).astype(int)
    rows = ((np.arange(round(size_m[1] / pixel_m)) + 0.5) * pixel_m % look.height_m / look.height_m * tile.shape[0]).astype(int)
    return tile[rows[:, None], columns[None, :]] / 255.0


def texture(mesh: trimesh.Trimesh) -> Image.Image | None:
    """Return the picture of a mesh's texture, or None for a mesh without a texture."""
    material = getattr(mesh.visual, "material", None)
    return getattr(material, "image", None) or getattr(material, "baseColorTexture", None)


def _box_projected(mesh: trimesh.Trimesh, material: PBRMaterial, size_m: tuple[float, float], fit: bool) -> trimesh.Trimesh:
    faces, vertices, normals = np.asarray(mesh.faces), np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)
    side = np.argmax(np.abs(mesh.face_normals) - [0, 0, 1e-6], axis=1)
    key, index = np.unique(np.stack([faces.ravel(), np.repeat(side, 3)], axis=1), axis=0, return_inverse=True)
    vertex, side = key.T
    points = vertices[vertex]
    plane = np.array([[1, 2], [0, 2], [0, 1]])[side]
    flat = np.take_along_axis(points, plane, axis=1)
    if fit:
        low, high = np.asarray(mesh.bounds)
        uv = (flat - low[plane]) / np.maximum((high - low)[plane], 1e-9)
        # Seen from outside, text in the picture must read from left to right.
        outward = np.take_along_axis(normals[vertex], side[:, None], axis=1)[:, 0]
        mirrored = np.where(side == 1, outward > 0, outward < 0)
        uv[mirrored, 0] = 1 - uv[mirrored, 0]
    else:
        uv = flat / size_m
    if len(key) == len(vertices):  # no vertex is duplicated, so the vertices keep their order
        order = np.argsort(vertex)
        return _textured(vertices, faces, normals, uv[order], material)
    return _textured(points, index.reshape(-1, 3), normals[vertex], uv, material)


def _with_label(mesh: trimesh.Trimesh, material: PBRMaterial, width_m: float) -> trimesh.Trimesh:
    """Put a paper label around a body of revolution about z. Vertices are doubled along the label's seam and at the rims of both ends."""
    faces, vertices, normals = np.asarray(mesh.faces), np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)
    low, high = np.asarray(mesh.bounds)
    repeats = max(1, round(np.pi * float((high - low)[:2].max()) / width_m))
    azimuth_turns = np.arctan2(vertices[:, 1], vertices[:, 0])[faces] / (2 * np.pi) % 1.0
    # for a face across the seam, let the texture coordinates continue beyond a full turn
    over = (np.ptp(azimuth_turns, axis=1, keepdims=True) > 0.5) & (azimuth_turns < 0.5)
    end = np.repeat(np.abs(mesh.face_normals[:, 2:]) > 0.5, 3, axis=1)
    key, index = np.unique(np.stack([faces.ravel(), over.ravel(), end.ravel()], axis=1), axis=0, return_inverse=True)
    vertex, over, end = key.T
    points = vertices[vertex]
    u = repeats * (np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) % 1.0 + over)
    v = np.where(end, 0.0, (points[:, 2] - low[2]) / (high - low)[2])
    return _textured(points, index.reshape(-1, 3), normals[vertex], np.stack([u, v], axis=1), material)


def _textured(vertices: np.ndarray, faces: np.ndarray, normals: np.ndarray, uv: np.ndarray, material: PBRMaterial) -> trimesh.Trimesh:
    visual = TextureVisuals(uv=uv, material=material)
    return trimesh.Trimesh(np.array(vertices), np.array(faces), vertex_normals=np.array(normals), visual=visual, process=False)


def _as_bytes(image: np.ndarray) -> np.ndarray:
    """Convert a picture (h, w, 3) of floats in 0..1 to uint8 values 0..255."""
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)


@lru_cache(maxsize=128)
def _material(name: str, seed: int) -> PBRMaterial:
    return _pbr(bitmap(name, seed), LOOKS[name].metallic)


def _pbr(image: np.ndarray, metallic: float) -> PBRMaterial:
    return PBRMaterial(baseColorTexture=Image.fromarray(image), metallicFactor=metallic, roughnessFactor=0.4 if metallic else 0.9)
