"""Transfer the scan's colours to surfaces, as a texture on flat surfaces and as vertex colours on others."""

from __future__ import annotations

import numpy as np
import trimesh
from PIL import Image
from scipy.spatial import KDTree
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from radartwin.reconstruct.outlines.grid import Grid
from radartwin.reconstruct.segmentation.masks import nearest

LARGEST_PX = 1024


def painted(mesh: trimesh.Trimesh, grid: Grid, points: np.ndarray, rgb: np.ndarray, seen: np.ndarray | None = None) -> trimesh.Trimesh:
    """Add a texture of the scanned colours to a flat mesh. Cells without a colour take the nearest colour.

    Args:
        grid: grid of the mesh's plane.
        points: (N, 3) points on the plane.
        rgb: (N, 3) colours of the points, 0..255.
        seen: mask of the scanned grid cells; the other cells become transparent. None means that all cells were scanned.
    """
    cell = max(grid.cell_m, grid.cell_m * max(grid.shape) / LARGEST_PX)
    shape = tuple(int(np.ceil(s * grid.cell_m / cell)) for s in grid.shape)
    at = np.floor((points @ grid.axes.T - grid.low) / cell).astype(int)
    at = np.clip(at, 0, np.array(shape) - 1)
    index = at[:, 0] * shape[1] + at[:, 1]
    count = np.bincount(index, minlength=shape[0] * shape[1])
    picture = np.stack([np.bincount(index, rgb[:, k], minlength=count.size) for k in range(3)], axis=-1) / np.maximum(count, 1)[:, None]
    picture = np.rint(picture).astype(np.uint8).reshape(*shape, 3)[nearest((count > 0).reshape(shape))]
    if seen is not None and not seen.all():
        column, row = (
            np.minimum(((np.arange(n) + 0.5) * cell / grid.cell_m).astype(int), m - 1) for n, m in zip(shape, seen.shape, strict=True)
        )
        picture = np.dstack([picture, np.where(seen[np.ix_(column, row)], 255, 0).astype(np.uint8)])
    uv = (np.asarray(mesh.vertices) @ grid.axes.T - grid.low) / (cell * np.array(shape))
    image = Image.fromarray(np.ascontiguousarray(picture.transpose(1, 0, 2)[::-1]))
    material = PBRMaterial(baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0)
    return trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals, visual=TextureVisuals(uv=uv, material=material), process=False
    )


def coloured(mesh: trimesh.Trimesh, points: np.ndarray, rgb: np.ndarray) -> trimesh.Trimesh:
    """Give each vertex of a mesh the mean colour of the nearest points (N, 3), whose colours are rgb (N, 3)."""
    _, near = KDTree(points).query(np.asarray(mesh.vertices), k=min(16, len(points)))
    near = np.asarray(near).reshape(len(mesh.vertices), -1)
    mean = np.rint(rgb[near].mean(axis=1)).astype(np.uint8)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals, vertex_colors=mean, process=False)
