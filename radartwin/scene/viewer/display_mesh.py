"""Prepare meshes for display: reduce the faces of large scenes, and find vertex colours, pictures of textures and the planes of walls."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from radartwin.scene.surface import Surface
from radartwin.scene.textures import texture

MAX_FACES = 300_000  # largest number of faces in a web page; a scene with more faces is simplified
WALL_M2 = 0.5  # smallest area of a wall that the page can hide; smaller surfaces block little of the view
WALL_BEHIND_M = 0.12  # largest bulge of a scanned wall behind its mean plane
WALL_SHARE = 0.02  # largest fraction of the room's other points behind a wall, for example points seen through a window
PICTURE_PX = 512  # width and height of a texture's picture in a page, pixels
HATCH, HATCH_PX = ((158, 158, 158), (205, 205, 205)), 4  # two greys of the hatching of unscanned areas, and width of a stripe in pixels
NO_COLOUR = np.array([0, 0, 0, 0], dtype=np.uint8)  # alpha 0 means that the vertex has no scanned colour


def thinned(meshes: Sequence[trimesh.Trimesh], limit: int = MAX_FACES) -> tuple[list[trimesh.Trimesh], float]:
    """Simplify the meshes so that they have at most about `limit` faces in total.

    Returns:
        meshes: the simplified meshes, in the same order.
        cell: size in metres of the grid cells in which vertices were merged; 0 if the meshes did not change.

    All vertices in the same cell of a grid are replaced by their mean (Rossignac and Borrel 1993). The grid covers the whole scene, so that
    neighbouring surfaces stay connected. Meshes of fewer than 1000 faces do not change.
    """
    small = sum(len(m.faces) for m in meshes if len(m.faces) < 1000)
    large = sum(len(m.faces) for m in meshes) - small
    if small + large <= limit:
        return list(meshes), 0.0
    area = sum(float(m.area) for m in meshes if len(m.faces) >= 1000)
    cell = float(np.sqrt(2.5 * area / max(limit - small, 1000)))  # a plane has two triangles per cell, a rough surface a few more
    while True:
        out = [_clustered(m, cell) if len(m.faces) >= 1000 else m for m in meshes]
        if sum(len(m.faces) for m in out) <= limit or cell > 1.0:
            return out, cell
        cell *= 1.25


def _clustered(mesh: trimesh.Trimesh, cell: float) -> trimesh.Trimesh:
    vertices = np.asarray(mesh.vertices)
    # rounding, because truncation would split a noisy level floor at z = 0 into two layers of cells
    keys = np.rint(vertices / cell).astype(np.int64)
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.reshape(-1)
    count = np.bincount(group)
    merged = np.stack([np.bincount(group, vertices[:, k]) / count for k in range(3)], axis=1)
    faces = group[np.asarray(mesh.faces)]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    if len(faces):
        _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
        faces = faces[np.sort(first)]
    out = trimesh.Trimesh(merged, faces, process=False)
    colours = vertex_colours(mesh)
    if colours is not None:
        mean = np.stack([np.bincount(group, colours[:, k]) / count for k in range(4)], axis=1)
        out.visual.vertex_colors = np.round(mean).astype(np.uint8)  # type: ignore[union-attr]
    return out


def vertex_colours(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Return the RGBA colours (V, 4) uint8 of the vertices of a mesh, sampled from its texture if it has one; None without colours."""
    visual: Any = mesh.visual
    if not visual.defined or (visual.kind == "texture" and texture(mesh) is None):
        return None
    return np.asarray((visual.to_color() if visual.kind == "texture" else visual).vertex_colors, dtype=np.uint8)


def pictures(meshes: Sequence[trimesh.Trimesh]) -> tuple[list[bytes], np.ndarray]:
    """Collect the texture pictures and texture coordinates of all meshes.

    Returns:
        pictures: the distinct texture pictures as JPEG data.
        coordinates: (V, 3), for every vertex the texture coordinates u and v (downwards) and the number of the picture; -1 for a vertex
            without a picture.
    """
    numbers: dict[bytes, int] = {}
    coordinates = []
    for mesh in meshes:
        image, uv = texture(mesh), getattr(mesh.visual, "uv", None)
        uvn = np.full((len(mesh.vertices), 3), -1.0)
        if image is not None and uv is not None and len(uv) == len(mesh.vertices):
            stream = io.BytesIO()
            hatched(image).resize((PICTURE_PX, PICTURE_PX)).save(stream, "JPEG", quality=85)
            number = numbers.setdefault(stream.getvalue(), len(numbers))
            uvn = np.column_stack([uv[:, 0], 1 - uv[:, 1], np.full(len(uv), float(number))])
        coordinates.append(uvn)
    return list(numbers), np.vstack(coordinates)


def hatched(image: Image.Image) -> Image.Image:
    """Replace the transparent areas of a picture, which were not scanned, by grey hatching."""
    if not image.mode.endswith("A"):
        return image.convert("RGB")
    pixels = np.array(image.convert("RGBA"))
    row, column = np.nonzero(pixels[..., 3] < 128)
    stripe = (row + column) // HATCH_PX % 2
    pixels[row, column, :3] = np.array(HATCH, dtype=np.uint8)[stripe]
    return Image.fromarray(np.ascontiguousarray(pixels[..., :3]))


def wall_planes(surfaces: Sequence[Surface]) -> list[dict[str, list[float]] | None]:
    """Return a list with the plane {"point", "normal"} of every surface that bounds the room, and None for every other surface.

    The normals point into the room.

    A surface bounds the room if it is flat and the rest of the room lies on a single side of it. The winding direction of its faces does
    not matter.
    """
    room = [s for s in surfaces if s.kind == "room"]
    vertices = [np.asarray(s.mesh.vertices) for s in room]
    cloud = np.vstack([np.zeros((0, 3)), *(v[:: max(1, len(v) // 2000)] for v in vertices)])
    return [_wall_plane(s.mesh, cloud) if s.kind == "room" else None for s in surfaces]


def _wall_plane(mesh: trimesh.Trimesh, cloud: np.ndarray) -> dict[str, list[float]] | None:
    if mesh.area < WALL_M2:
        return None
    normal = np.average(mesh.face_normals, axis=0, weights=mesh.area_faces)
    if np.linalg.norm(normal) < 0.8:
        return None
    normal /= np.linalg.norm(normal)
    point = np.average(mesh.triangles_center, axis=0, weights=mesh.area_faces)
    depth = (cloud - point) @ normal
    behind, front = np.mean(depth < -WALL_BEHIND_M), np.mean(depth > WALL_BEHIND_M)
    if min(behind, front) > WALL_SHARE:
        return None
    inward = normal if behind <= front else -normal
    return {"point": point.round(4).tolist(), "normal": inward.round(5).tolist()}
