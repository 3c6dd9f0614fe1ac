"""Meshes for the eye: coarser where there are too many faces, with colours on their vertices, and told apart as shell or content."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from radartwin.scene.scene import Surface

if TYPE_CHECKING:
    from PIL.Image import Image

MAX_FACES = 300_000  # of a page; beyond it the picture is thinned, the scene is not
SHELL_M2 = 0.5  # smaller surfaces hide nothing
SHELL_BEHIND_M = 0.12  # how far a scan's wall may bulge behind its own mean plane and still be one
SHELL_SHARE = 0.02  # of the rest of the room may lie behind a wall: what a scan saw through a window
PICTURE_PX = 512  # side of the pictures of textures in a page
HATCH, HATCH_PX = ((158, 158, 158), (205, 205, 205)), 4  # greys of what was never scanned, and the width of a stripe in a texture
PALE = np.array([0, 0, 0, 0], dtype=np.uint8)  # alpha 0: no colour of a scan


def thinned(meshes: Sequence[trimesh.Trimesh], limit: int = MAX_FACES) -> tuple[list[trimesh.Trimesh], float]:
    """The meshes with at most about `limit` faces together, and the edge of the grid they were thinned on, 0 if they were not.

    Vertices within one cell of a grid over the whole scene become their mean (Rossignac and Borrel 1993), so that neighbouring
    surfaces stay together. Meshes of fewer than 1000 faces are left alone.
    """
    small = sum(len(m.faces) for m in meshes if len(m.faces) < 1000)
    large = sum(len(m.faces) for m in meshes) - small
    if small + large <= limit:
        return list(meshes), 0.0
    area = sum(float(m.area) for m in meshes if len(m.faces) >= 1000)
    cell = float(np.sqrt(2.5 * area / max(limit - small, 1000)))  # a plane of squares with two triangles each, a little roughened
    while True:
        out = [_clustered(m, cell) if len(m.faces) >= 1000 else m for m in meshes]
        if sum(len(m.faces) for m in out) <= limit or cell > 1.0:
            return out, cell
        cell *= 1.25


def _clustered(mesh: trimesh.Trimesh, cell: float) -> trimesh.Trimesh:
    vertices = np.asarray(mesh.vertices)
    keys = np.rint(vertices / cell).astype(np.int64)  # not floor: a level floor lies about a multiple of any cell, zero
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.reshape(-1)
    count = np.bincount(group)
    merged = np.stack([np.bincount(group, vertices[:, k]) / count for k in range(3)], axis=1)
    faces = group[np.asarray(mesh.faces)]
    kept = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[kept]
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
    """(V, 4) uint8 colours of the vertices, of a texture those at the vertices; None without any."""
    visual = mesh.visual
    if visual is None or not visual.defined:
        return None
    if visual.kind in ("vertex", "face"):
        colours = np.asarray(visual.vertex_colors, dtype=np.uint8)  # type: ignore[union-attr]
        return colours if len(colours) == len(mesh.vertices) else None
    if texture(mesh) is None:
        return None
    return np.asarray(visual.to_color().vertex_colors, dtype=np.uint8)  # type: ignore[union-attr]


def pictures(meshes: Sequence[trimesh.Trimesh]) -> tuple[list[bytes], np.ndarray]:
    """JPEG pictures of the meshes' textures, each once, and for every vertex (V, 3) its place in one: u, v (downwards) and its number,
    -1 for none.
    """
    seen: dict[bytes, int] = {}
    places = []
    for mesh in meshes:
        image, uv = texture(mesh), getattr(mesh.visual, "uv", None)
        place = np.full((len(mesh.vertices), 3), -1.0)
        if image is not None and uv is not None and len(uv) == len(mesh.vertices):
            stream = io.BytesIO()
            hatched(image).resize((PICTURE_PX, PICTURE_PX)).save(stream, "JPEG", quality=85)
            number = seen.setdefault(stream.getvalue(), len(seen))
            place = np.column_stack([uv[:, 0], 1 - uv[:, 1], np.full(len(uv), float(number))])
        places.append(place)
    return list(seen), np.vstack(places)


def hatched(image: Image) -> Image:
    """A picture without alpha: what has none, since nobody scanned it, is hatched in greys."""
    from PIL import Image as pillow

    if not image.mode.endswith("A"):
        return image.convert("RGB")
    pixels = np.array(image.convert("RGBA"))
    row, column = np.nonzero(pixels[..., 3] < 128)
    stripe = (row + column) // HATCH_PX % 2
    pixels[row, column, :3] = np.array(HATCH, dtype=np.uint8)[stripe]
    return pillow.fromarray(np.ascontiguousarray(pixels[..., :3]))


def texture(mesh: trimesh.Trimesh) -> Image | None:
    """The picture a mesh is covered with."""
    material = getattr(mesh.visual, "material", None)
    return getattr(material, "image", None) or getattr(material, "baseColorTexture", None)


def shells(surfaces: Sequence[Surface]) -> list[dict[str, list[float]] | None]:
    """For every surface that bounds the room, its plane: {"point", "normal"}, the normal towards the inside; None for the rest.

    A surface bounds the room when it is flat and the rest of the room lies on one side of it; whichever way its triangles wind.
    """
    room = [s for s in surfaces if s.kind == "room"]
    if not room:
        return [None] * len(surfaces)
    cloud = np.vstack([_sample(np.asarray(s.mesh.vertices)) for s in room])
    out: list[dict[str, list[float]] | None] = []
    for surface in surfaces:
        mesh = surface.mesh
        if surface.kind != "room" or mesh.area < SHELL_M2:
            out.append(None)
            continue
        normal = np.average(mesh.face_normals, axis=0, weights=mesh.area_faces)
        if np.linalg.norm(normal) < 0.8:
            out.append(None)
            continue
        normal /= np.linalg.norm(normal)
        point = np.average(mesh.triangles_center, axis=0, weights=mesh.area_faces)
        depth = (cloud - point) @ normal
        behind, before = np.mean(depth < -SHELL_BEHIND_M), np.mean(depth > SHELL_BEHIND_M)
        if min(behind, before) > SHELL_SHARE:
            out.append(None)
            continue
        inward = normal if behind <= before else -normal
        out.append({"point": point.round(4).tolist(), "normal": inward.round(5).tolist()})
    return out


def _sample(vertices: np.ndarray, most: int = 2000) -> np.ndarray:
    return vertices[:: max(1, len(vertices) // most)]
