"""Draw a scanned scene beside its material map, which shows the same view in colours that stand for the MINC material categories.

The legend of the material map names the simulated material of each visible category, in the order of the MINC categories.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from radartwin.label.z_buffer import Camera, Drawing
from radartwin.materials.minc import CATEGORIES
from radartwin.plotting import style
from radartwin.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

# Each colour resembles the material of its MINC category. The colours of categories that often touch in a room differ in lightness.
COLOURS = {
    "brick": "#b5533c", "carpet": "#6a3d9a", "ceramic": "#c7e9f1", "fabric": "#cc79a7", "foliage": "#3a9d3a", "food": "#e6ab02",
    "glass": "#56b4e9", "hair": "#4d2f12", "leather": "#7b3f00", "metal": "#3f4a54", "mirror": "#a6cee3", "other": "#ff00ff",
    "painted": "#f1e8d2", "paper": "#e8c77a", "plastic": "#009e73", "polishedstone": "#b8a9c9", "skin": "#f2b9a0", "sky": "#9fd3ff",
    "stone": "#9a9a92", "tile": "#8fd3c4", "wallpaper": "#f5b971", "water": "#0072b2", "wood": "#a8672f",
}  # fmt: skip
NO_CATEGORY = "#d0d0d0"
FIELD_DEG = 75.0
PIXELS = 700


def material_map(scene: Scene) -> Figure:
    """Draw two panels: the scanned scene in its own colours, and coloured by MINC category with a legend of the visible categories."""
    figure, axes = style.figure(1, 2, width_in=style.PAGE_WIDTH_IN, height_in=4.1)
    patches = draw_materials(scene, axes)
    figure.legend(handles=patches, loc="outside lower center", ncols=min(2, max(1, len(patches))))
    return figure


def draw_materials(scene: Scene, axes: Sequence[Axes], camera: Camera | None = None) -> list[Patch]:
    """Draw the scene in its own colours on the first of two axes, and in those of its MINC categories on the second.

    Args:
        camera: viewpoint of both pictures; None chooses a corner of the room.
    Returns:
        The entries of a legend of the visible categories.
    """
    import matplotlib.colors
    from matplotlib.patches import Patch

    drawing = Drawing(scene)
    camera = camera or corner_camera(scene, drawing, PIXELS)
    seen = drawing.seen(camera)
    surface_index = drawing.surfaces(seen)
    minc = [str(surface.provenance.get("minc") or "none") for surface in scene]
    palette = np.array([matplotlib.colors.to_rgb(COLOURS.get(name, NO_CATEGORY)) for name in minc] + [(1.0, 1.0, 1.0)])
    # Shading by the cosine of the incidence angle makes edges between faces of the same material visible.
    shade = np.ones(seen.face.shape)
    shade[seen.face >= 0] = 0.7 + 0.3 * np.abs(drawing.facing(camera, seen, seen.face >= 0))
    flat = palette[surface_index] * shade[..., None]
    for axis, picture, title in zip(axes, (drawing.picture(camera, seen), np.clip(flat, 0, 1)), ("scan", "materials"), strict=True):
        axis.imshow(picture, interpolation="nearest")
        axis.set_title(title)
        axis.set_axis_off()
    visible = {minc[k] for k in np.unique(surface_index) if k >= 0}
    line = {"edgecolor": "#555555", "linewidth": 0.4}
    return [
        Patch(facecolor=COLOURS.get(name, NO_CATEGORY), label=f"{name}: {_materials(scene, minc, name)}", **line)
        for name in (*CATEGORIES, "none")
        if name in visible
    ]


def _materials(scene: Scene, minc: list[str], category: str) -> str:
    """Return a text for a MINC category: the name of its material with the largest area, and the number of its other materials."""
    from radartwin.scene.viewer.page import material_label

    areas: dict[str, float] = {}
    for surface, surface_category in zip(scene, minc, strict=True):
        if surface_category == category:
            label = material_label(surface.material)
            areas[label] = areas.get(label, 0.0) + float(surface.mesh.area)
    most = max(areas, key=lambda label: areas[label])
    return most + (f" ({len(areas) - 1} more)" if len(areas) > 1 else "")


def corner_camera(scene: Scene, drawing: Drawing, pixels: int) -> Camera:
    """Return a camera at two thirds of the room height in the corner that shows most surfaces, looking slightly downwards."""
    low, high = scene.bounds
    best, best_score = None, -1.0
    for x in (0.12, 0.88):
        for y in (0.12, 0.88):
            eye = low + (high - low) * np.array([x, y, 0.66])
            target = low + (high - low) * np.array([1 - x, 1 - y, 0.35])
            small = Camera.looking(eye, target, FIELD_DEG, 96)
            seen = drawing.seen(small)
            labels, counts = np.unique(drawing.surfaces(seen)[seen.face >= 0], return_counts=True)
            near = float(np.median(seen.depth[np.isfinite(seen.depth)])) if len(labels) else 0.0
            score = float(np.count_nonzero(counts >= 10)) + near
            if score > best_score:
                best, best_score = Camera.looking(eye, target, FIELD_DEG, pixels), score
    assert best is not None
    return best
