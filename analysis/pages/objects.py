"""Draw the meshes of the twelve test objects in a grid. Command: `python -m analysis.pages.objects [FILE]`."""

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from radartwin.io.files import write_atomically
from radartwin.scene import objects
from radartwin.scene.objects import Entry

PATCH_M = 0.004
HALF_M = 0.13  # half width of each picture; all objects have the same scale
LIGHT = np.array([0.5, -0.55, 0.67])
VIEW_DEG = (14.0, -35.0)  # elevation, azimuth


def patches(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Divide a textured mesh into F triangles. Returns their vertices (F, 3, 3) and RGB colours (F, 3) under one lamp."""
    visual: Any = mesh.visual
    image = np.asarray(visual.material.baseColorTexture.convert("RGB")) / 255.0
    both = np.hstack([mesh.vertices, 1e-3 * visual.uv])  # subdivided with the vertices; the factor keeps uv from affecting edge lengths
    points, faces = trimesh.remesh.subdivide_to_size(both, mesh.faces, PATCH_M)[:2]
    corners = points[faces][..., :3]
    u, v = (1e3 * points[faces][..., 3:].mean(axis=1) % 1.0).T
    rows, columns = ((1 - v) * (len(image) - 1)).astype(int), (u * (image.shape[1] - 1)).astype(int)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    lit = 0.45 + 0.6 * np.abs(normal @ LIGHT)
    return corners, np.clip(image[rows, columns] * lit[:, None], 0, 1)


def draw(axes, entry: Entry) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    surfaces = entry.surfaces()
    cut = [patches(surface.mesh) for surface in surfaces]
    triangles = np.concatenate([corners for corners, _ in cut]) - [0, 0, entry.size_m[2] / 2]
    colours = np.concatenate([colour for _, colour in cut])
    axes.add_collection3d(Poly3DCollection(triangles, facecolors=colours, edgecolors=colours, linewidths=0.15))
    axes.set(xlim=(-HALF_M, HALF_M), ylim=(-HALF_M, HALF_M), zlim=(-HALF_M, HALF_M))
    axes.set_box_aspect((1, 1, 1), zoom=1.6)
    axes.view_init(*VIEW_DEG)
    axes.set_axis_off()
    width, depth, height = (1000 * v for v in entry.size_m)
    contents = f", {entry.contents}" if entry.contents else ""
    caption = f"{entry.label}\n{width:.0f} x {depth:.0f} x {height:.0f} mm\n{entry.material_class}{contents}; {entry.shape}"
    axes.text2D(0.5, -0.02, caption, fontsize=8, ha="center", va="top", transform=axes.transAxes)


def objects_figure(path: Path) -> Path:
    """Write a picture of all objects to the file `path`. The objects are in the catalogue's order and at the same scale."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    entries = list(objects.catalogue().values())
    columns = -(-len(entries) // 2)
    figure, grid = plt.subplots(2, columns, figsize=(2 * columns, 5.4), subplot_kw={"projection": "3d"})
    for axes, entry in zip(grid.flat, entries, strict=False):
        draw(axes, entry)
    for axes in grid.flat[len(entries) :]:
        axes.remove()
    figure.subplots_adjust(left=0, right=1, top=1.0, bottom=0.1, wspace=0, hspace=0.2)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=130)
    plt.close(figure)
    write_atomically(path, content.getvalue())
    return path


if __name__ == "__main__":
    print(objects_figure(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures/objects.png")))
