"""A scan beside its material map: the same view in the scan's own colours and in the colours of its materials.

The legend says of each MINC category seen what the tracer gets for it, most of its area first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from radartwin.label.raster import Camera, Drawing
from radartwin.materials.minc import CATEGORIES
from radartwin.plotting import style
from radartwin.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# One colour a category, near what people expect of it, neighbours in a room kept apart by lightness.
COLOURS = {
    "brick": "#b5533c", "carpet": "#6a3d9a", "ceramic": "#c7e9f1", "fabric": "#cc79a7", "foliage": "#3a9d3a", "food": "#e6ab02",
    "glass": "#56b4e9", "hair": "#4d2f12", "leather": "#7b3f00", "metal": "#3f4a54", "mirror": "#a6cee3", "other": "#ff00ff",
    "painted": "#f1e8d2", "paper": "#e8c77a", "plastic": "#009e73", "polishedstone": "#b8a9c9", "skin": "#f2b9a0", "sky": "#9fd3ff",
    "stone": "#9a9a92", "tile": "#8fd3c4", "wallpaper": "#f5b971", "water": "#0072b2", "wood": "#a8672f",
}  # fmt: skip
NONE = "#d0d0d0"  # a material without category
FIELD_DEG = 75.0
PIXELS = 700


def material_map(scene: Scene, camera: Camera | None = None, titles: tuple[str, str] = ("scan", "materials")) -> Figure:
    """Two panels, the labelled scene as scanned and by MINC category, with a legend of the categories seen and their materials.

    Args:
        camera: where from; a corner of the room, looking to the middle, unless given.
    """
    import matplotlib.colors
    from matplotlib.patches import Patch

    drawing = Drawing(scene)
    camera = camera or corner_camera(scene, drawing)
    seen = drawing.seen(camera)
    shown = drawing.surfaces(seen)
    minc = [str(surface.provenance.get("minc") or "none") for surface in scene]
    palette = np.array([matplotlib.colors.to_rgb(COLOURS.get(name, NONE)) for name in minc] + [(1.0, 1.0, 1.0)])
    flat = palette[shown] * _shade(drawing, camera, seen.face)[..., None]
    figure, axes = style.figure(1, 2, width_in=style.PAGE_WIDTH_IN, height_in=4.1)
    for axis, picture, title in zip(axes, (drawing.picture(camera, seen), np.clip(flat, 0, 1)), titles, strict=True):
        axis.imshow(picture, interpolation="nearest")
        axis.set_title(title)
        axis.set_axis_off()
    areas = {
        name: int(sum((shown == k).sum() for k, own in enumerate(minc) if own == name)) for name in (*CATEGORIES, "none") if name in minc
    }
    names = [name for name in areas if areas[name] > 0]
    patches = [
        Patch(facecolor=COLOURS.get(name, NONE), edgecolor="#555555", linewidth=0.4, label=f"{name}: {_materials(scene, minc, name)}")
        for name in names
    ]
    figure.legend(handles=patches, loc="outside lower center", ncols=min(2, max(1, len(patches))), fontsize=6.5)
    return figure


def _materials(scene: Scene, minc: list[str], category: str) -> str:
    """What the tracer gets for the surfaces of a category: the material with most area, and how many others there are."""
    from radartwin.scene.viewer.page import material_label

    areas: dict[str, float] = {}
    for surface, own in zip(scene, minc, strict=True):
        if own == category:
            label = material_label(surface.material)
            areas[label] = areas.get(label, 0.0) + float(surface.mesh.area)
    most = max(areas, key=lambda label: areas[label])
    return most + (f" ({len(areas) - 1} more)" if len(areas) > 1 else "")


def corner_camera(scene: Scene, drawing: Drawing | None = None, pixels: int = PIXELS) -> Camera:
    """From inside the corner that shows most surfaces, at two thirds of the height, towards the opposite lower half."""
    drawing = drawing or Drawing(scene)
    low, high = scene.bounds
    best, most = None, -1.0
    for x in (0.12, 0.88):
        for y in (0.12, 0.88):
            eye = low + (high - low) * np.array([x, y, 0.66])
            target = low + (high - low) * np.array([1 - x, 1 - y, 0.35])
            small = Camera.looking(eye, target, FIELD_DEG, 96)
            seen = drawing.seen(small)
            labels, counts = np.unique(drawing.surfaces(seen)[seen.face >= 0], return_counts=True)
            near = float(np.median(seen.depth[np.isfinite(seen.depth)])) if len(labels) else 0.0
            worth = float(np.count_nonzero(counts >= 10)) + near
            if worth > most:
                best, most = Camera.looking(eye, target, FIELD_DEG, pixels), worth
    assert best is not None
    return best


def _shade(drawing: Drawing, camera: Camera, face: np.ndarray) -> np.ndarray:
    """Brightness (h, w) by how squarely a face is seen, so that edges between equal materials show."""
    rows, columns = np.indices(face.shape)
    rays = np.stack([columns, rows, np.ones(face.shape)], axis=-1) @ np.linalg.inv(camera.intrinsics).T @ camera.pose[:3, :3].T
    facing = np.abs(np.einsum("hwk,hwk->hw", rays, drawing.normal[np.maximum(face, 0)])) / np.linalg.norm(rays, axis=-1)
    return np.where(face >= 0, 0.7 + 0.3 * facing, 1.0)
